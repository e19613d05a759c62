"""If an MCAP recording has holes of zeros or records with wrong lengths, all that is intact before and after
the damage is read.
"""

import re
from itertools import chain
from pathlib import Path

import msgspec
import pytest
from fltea.archive.info import Summary, as_text, summarise
from fltea.recording.part_reader import Part, read_entries, read_info
from fltea.recording.recovery import recover
from fltea.recording.resync import HEAD, WINDOW_BYTES
from fltea.recording.scan import Damage, Scan
from fltea.records.errors import UsageError
from fltea.records.records import Error, Gap, Sample
from fltea.sinks import record as record_module
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode

from tests.rig.blocks import of
from tests.rig.mcap_support import files, kill, record, replay, transport


class Case:
    """A recording in many chunks, for each test to change. The parts of its file are MCAP records, and some
    of these records are chunks.

    `places`: kind, beginning and end of each record. `chunks`: beginning and end of each chunk. `messages`:
    for each chunk, the messages in it. Beginnings and ends are offsets in the file.
    """

    def __init__(self, folder: Path) -> None:
        record(folder, transport(samples=200))
        self.path = files(folder)[0]
        self.whole = self.path.read_bytes()
        self.places, at = [], 8
        while at < len(self.whole) - 8:
            kind, length = HEAD.unpack_from(self.whole, at)
            self.places.append((kind, at, at + HEAD.size + length))
            at = self.places[-1][2]
        self.chunks = [(begin, end) for kind, begin, end in self.places if kind == Opcode.CHUNK]
        head, self.messages = self.whole[: self.chunks[0][0]], []
        for begin, end in self.chunks:
            self.write(head, self.whole[begin:end])
            self.messages.append(self.read())
        self.write(self.whole)
        assert self.read() == self.all

    def __repr__(self) -> str:
        return "the recording"

    @property
    def all(self) -> list[bytes]:
        return list(chain(*self.messages))

    def write(self, *pieces: bytes) -> None:
        self.path.write_bytes(b"".join(pieces))

    def read(self) -> list[bytes]:
        return [entry.data for entry in read_entries(Part(self.path, read_info(self.path)))]

    def punch(self, begin: int, end: int) -> None:
        self.write(self.whole[:begin], bytes(end - begin), self.whole[end:])

    def lie(self, begin: int, length: int, end: int | None = None) -> None:
        claimed = length.to_bytes(8, "little")
        self.write(self.whole[: begin + 1], claimed, self.whole[begin + HEAD.size : end])


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(record_module, "FLUSH_NS", 0)
        return Case(tmp_path_factory.mktemp("holes"))


def test_a_hole_is_read_up_to_and_behind_and_counted(case: Case) -> None:
    begin, end = case.chunks[40][0], case.chunks[70][1] - 20
    case.punch(begin, end)
    again = replay(case.path)
    gap = max(of(Gap, again), key=lambda gap: gap.missing)
    assert (of(Sample, again)[0].seq, of(Sample, again)[-1].seq) == (0, 199)
    assert len(of(Sample, again)) + sum(one.missing for one in of(Gap, again)) == 200
    (told,) = [error.message for error in of(Error, again) if error.kind == "recording_gap"]
    assert f"is damaged at byte {begin} (zeros behind a record that claims " in told
    found = summarise([case.path], 100)
    assert not found.whole
    assert case.chunks[71][0] - begin == found.damaged_bytes
    assert f"{found.damaged_bytes} bytes of the files cannot be read" in as_text(found)
    assert found.counts.lost >= gap.missing > 20
    copy = recover(case.path, in_place=False).out
    assert copy is not None
    assert of(Sample, replay(copy)) == of(Sample, again)
    copy.unlink()


def test_a_hole_that_the_disk_does_not_hold_is_not_read(case: Case) -> None:
    begin = case.chunks[100][0]
    with case.path.open("wb") as file:
        file.write(case.whole[:begin])
        file.seek(1 << 40)
        file.write(case.whole[begin:])
    assert [item.size for item in Scan(case.path) if isinstance(item, Damage)] == [(1 << 40) - begin]
    assert case.read() == case.all


def test_a_hole_at_the_end_leaves_a_file_that_was_finished(case: Case) -> None:
    assert case.places[-1][0] == Opcode.FOOTER
    case.punch(case.chunks[-20][0], case.places[-1][1] - 2000)
    scan = Scan(case.path)
    assert len([item for item in scan if isinstance(item, Damage)]) == 1
    assert (scan.whole, scan.lost_bytes) == (True, 0)
    assert case.read() == list(chain(*case.messages[:-20]))


@settings(max_examples=40, deadline=None)
@given(at=st.floats(0, 1), size=st.one_of(st.integers(1, 40), st.integers(1, 40_000)))
def test_any_hole_costs_the_chunks_that_it_touches_and_no_other(case: Case, at: float, size: int) -> None:
    first, last = case.chunks[0][0], case.chunks[-1][1]
    begin = first + int(at * (last - first))
    end = min(begin + size, last)
    case.punch(begin, end)
    # The bytes from `begin` to `end` were replaced by zeros. If these are only bytes at the beginning of a
    # chunk, which hold its kind and length, the chunk is still read: other fields show its length, too.
    kept = [
        messages
        for (b, e), messages in zip(case.chunks, case.messages, strict=True)
        if not case.whole[max(b, begin) : max(b, min(e, end))].strip(b"\0") or b < begin < end <= b + 9
    ]
    assert case.read() == list(chain(*kept))


LIES = [0, 1, 20, 1000, WINDOW_BYTES, 10**6, 2**31, 2**40, 2**63, 2**64 - 1]


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(which=st.integers(0, 10_000), lie=st.one_of(st.sampled_from(LIES), st.integers(0, 200_000)))
def test_a_length_that_lies_costs_no_chunk_and_is_named(case: Case, which: int, lie: int) -> None:
    """The length of one record is wrong. If it is a chunk's, the chunk's fields show the true length. After
    any other record, the bytes that the wrong length skips are searched for chunks.
    """
    first, *_, last = (k for k, (kind, _, _) in enumerate(case.places) if kind == Opcode.CHUNK)
    kind, begin, end = case.places[first + which % (last - first)]
    if lie == end - begin - HEAD.size:
        return
    case.lie(begin, lie)
    damages = [item for item in Scan(case.path) if isinstance(item, Damage)]
    assert any(f"{lie} bytes" in item.text for item in damages)
    assert case.read() == case.all
    if kind == Opcode.CHUNK:
        assert [item.size for item in damages] == [0]


def test_an_index_whose_wrong_length_ends_where_a_later_record_begins_costs_no_chunk(case: Case) -> None:
    """A wrong length of a message index makes the index end exactly where the chunk after it ends. A reader
    that trusted the length would lose this chunk without notice.
    """
    first = next(k for k, (kind, _, _) in enumerate(case.places) if kind == Opcode.MESSAGE_INDEX)
    begin = case.places[first][1]
    end = next(end for kind, at, end in case.places if kind == Opcode.CHUNK and at > begin)
    lie = end - begin - HEAD.size
    case.lie(begin, lie)
    damages = [item for item in Scan(case.path) if isinstance(item, Damage)]
    assert [item.size for item in damages] == [0]
    assert f"a message index that claims to have {lie} bytes" in damages[0].text
    assert case.read() == case.all


def test_of_a_wrong_length_it_is_not_said_that_the_recording_is_short(case: Case) -> None:
    begin, end = case.chunks[3]
    case.lie(begin, 10**9, end)
    wrong = f"has a wrong length at byte {begin} (a chunk that claims to have {10**9} bytes, but has "
    with pytest.raises(UsageError, match=re.escape(wrong)):
        replay(case.path)
    case.write(case.whole[: end - 10])
    length = end - begin - HEAD.size
    with pytest.raises(
        UsageError, match=f"a record claims to have {length} bytes, but only {length - 10} are left"
    ):
        replay(case.path)


def test_a_search_among_chunks_that_are_none_has_an_end(case: Case) -> None:
    """The file holds many bytes that look like headers of chunks but are none. Together they cost a few
    passes over the file, not one pass each.
    """
    size, fake = 3_000_000, bytearray()
    while len(fake) < size:
        length = min(10**6, size - len(fake))
        head = HEAD.pack(Opcode.CHUNK, length) + bytes(28) + b"\4\0\0\0zstd"
        fake += (head + max(0, length - 44).to_bytes(8, "little")).ljust(77, b"\xff")
    case.write(case.whole[: case.chunks[0][0]], bytes(fake))
    scan = Scan(case.path)
    assert 20 < sum(isinstance(item, Damage) for item in scan) < 200
    assert scan.why == "too much of the file is damaged"


@pytest.mark.parametrize("held", [True, False])
def test_a_file_that_is_written_now_was_not_killed(
    held: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(record_module, "FLUSH_NS", 0)
    _, sink = record(tmp_path, transport(samples=60), end=False)
    if not held:
        kill(sink)
    (error,) = of(Error, replay(tmp_path))
    assert error.kind == ("recording_open" if held else "cut_recording")
    assert ("killed" in error.message) != held


def test_info_says_which_parts_before_the_first_are_missing(tmp_path: Path) -> None:
    record(tmp_path, transport(samples=500), rotate_s=1.0)
    first, second, *rest = files(tmp_path)
    assert summarise([second], 100).missing == "", "it is there, and was not asked for"
    first.unlink()
    found = summarise([tmp_path], 100)
    assert (found.whole, found.missing) == (False, "part 000 is missing")
    assert ", part 000 is missing\n" in as_text(found)
    assert msgspec.json.decode(msgspec.json.encode(found), type=Summary) == found
    second.unlink()
    assert summarise([*rest], 100).missing == "parts 000 to 001 are missing"
