"""A replay of MCAP files gives the same estimates to the last bit, whatever part of the files is truncated,
damaged or missing.
"""

import os
import tracemalloc
from pathlib import Path

import pytest
from fltea.recording.part_reader import read_entries
from fltea.recording.resync import HEAD
from fltea.records.errors import UsageError
from fltea.records.events import Chunk, Opened, RawBlock, RawSample, Tick, Trouble
from fltea.records.records import Epoch, Error, Estimate, Gap, Hello, Sample
from fltea.records.stats import DeviceStatus
from fltea.settings.config import load_config
from fltea.sinks import record as record_module
from fltea.sources.as_wire import AsWire
from fltea.sources.mcap import McapRecording, find_session
from fltea.sources.open_source import open_source
from fltea.sources.replay import ReplaySource
from fltea.sources.synthetic import SyntheticSource
from fltea.sources.wire_events import WireEvents
from fltea.wire import layout as wire
from fltea.wire.block_reader import FrameReader
from mcap.opcode import Opcode

from tests.rig.blocks import in_samples, of
from tests.rig.mcap_support import OFFSET_NS, SMALL, files, kill, record, replay, transport, without


@pytest.fixture
def many_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write a chunk after every item, which makes the smallest chunks possible."""
    monkeypatch.setattr(record_module, "FLUSH_NS", 0)


# --- a replay gives what the live run gave, to the last bit ---


@pytest.mark.parametrize("rotation", [{}, {"rotate_s": 0.7}])
def test_all_records_of_a_live_run_come_again(rotation: dict[str, float], tmp_path: Path) -> None:
    items = transport(samples=300, boots=3)
    live, _ = record(tmp_path, items, **rotation)
    assert len(files(tmp_path)) == (1 if not rotation else 15)
    again = replay(tmp_path)
    for kind, n in ((Sample, 3 * 297), (Estimate, 3 * 277), (Gap, 6), (Epoch, 3)):
        assert len(of(kind, live)) == n
        # the replay's numbers, times and estimates equal the live ones bit by bit
        assert of(kind, again) == of(kind, live)
    assert without(of(Hello, again), "source", "host_ns") == without(of(Hello, live), "source", "host_ns")
    kinds = [error.kind for error in of(Error, live)]
    assert [error.kind for error in of(Error, again)] == kinds == ["unplugged", "unplugged"]
    assert of(Hello, again)[0].source == f"replay:{tmp_path}"


def test_what_the_line_did_is_counted_again(tmp_path: Path) -> None:
    items = transport(samples=100, boots=2)
    whole = items[20]
    items[20] = whole._replace(data=b"\xff" + whole.data)
    record(tmp_path, items)
    source, live = ReplaySource(tmp_path), WireEvents("/dev/due")
    for _ in source.events():
        pass
    for item in items:
        list(live.feed(item, item.host_ns))
    assert source.link_stats() == live.link_stats()
    assert source.link_stats().bad_frames
    assert source.link_stats().reconnects == 1


def test_host_times_follow_each_epochs_own_clock(tmp_path: Path) -> None:
    """The host's clock was set between two starts of the device.

    Times of samples after the second start follow the new setting of the clock.
    """
    hour_ns = 3600 * 10**9
    items = transport(samples=100, boots=2)
    second = items.index(next(i for i in items[1:] if isinstance(i, Opened)))
    items[second:] = [item._replace(unix_offset_ns=item.unix_offset_ns + hour_ns) for item in items[second:]]
    live, _ = record(tmp_path, items)
    assert of(Sample, live)[-1].host_ns - of(Sample, live)[0].host_ns > hour_ns
    assert of(Sample, replay(tmp_path)) == of(Sample, live)


def test_a_later_file_can_be_replayed_alone(tmp_path: Path) -> None:
    live, _ = record(tmp_path, transport(samples=450), rotate_s=1.55)
    last = files(tmp_path)[2]
    again = replay(last)
    assert isinstance(again[0], Hello)
    numbers = [sample.seq for sample in of(Sample, again)]
    assert numbers == [s.seq for s in of(Sample, live) if s.seq >= numbers[0]]
    # samples are used from the first one on, thanks to the HELLO in the file's metadata
    assert 308 <= numbers[0] <= 313
    gyro = {s.seq: s.gyro_dps for s in of(Sample, live)}
    assert all(sample.gyro_dps == gyro[sample.seq] for sample in of(Sample, again))


def test_files_that_are_missing_are_a_gap(tmp_path: Path) -> None:
    record(tmp_path, transport(samples=600), rotate_s=2.0)
    files(tmp_path)[1].unlink()
    again = replay(tmp_path)
    texts = {error.kind: error.message for error in of(Error, again)}
    assert set(texts) == {"recording_gap", "unread_file"}
    assert "files are missing before" in texts["recording_gap"]
    gap = of(Gap, again)[-1]
    assert 195 <= gap.missing <= 205
    assert of(Sample, again)[-1].seq == 599
    assert len(of(Sample, again)) + sum(g.missing for g in of(Gap, again)) == 600


def spoil(folder: Path, chunk: int, place: int, bits: int) -> None:
    """Flip bits in one byte of a chunk in the only file of a folder."""
    (path,) = files(folder)
    data = bytearray(path.read_bytes())
    begin = [at for at, kind, _ in _places(bytes(data)) if kind == Opcode.CHUNK][chunk]
    data[begin + place] ^= bits
    path.write_bytes(data)


@pytest.mark.usefixtures("many_chunks")
@pytest.mark.parametrize("chunk", [0, 250])
def test_a_damaged_chunk_costs_itself_alone(chunk: int, tmp_path: Path) -> None:
    """A damaged chunk loses only its own content. This holds for the first chunk, too, which describes the
    channels.

    The raw bytes from the port can be read without the description of their channel, since its ID is always
    the same.
    """
    record(tmp_path, transport(samples=500), channels=())
    spoil(tmp_path, chunk, 60, 0xFF)
    again = replay(tmp_path)
    assert [error.kind for error in of(Error, again)] == ["recording_gap", "unread_file"]
    assert all("is damaged at byte" in error.message for error in of(Error, again))
    samples = of(Sample, again)
    assert samples[-1].seq == 499
    assert 0 < 500 - len(samples) <= 110  # after the damage, samples are lost up to the next HELLO


@pytest.mark.usefixtures("many_chunks")
def test_no_changed_byte_of_the_wire_is_ever_believed(tmp_path: Path) -> None:
    record(tmp_path, transport(samples=8), channels=())
    path = files(tmp_path)[0]
    data, (part,) = path.read_bytes(), find_session([path]).parts
    true = {entry.data for entry in read_entries(part)}
    at, _, length = [place for place in _places(data) if place[1] == Opcode.CHUNK][4]
    for flipped in range(at + HEAD.size, at + HEAD.size + length):
        path.write_bytes(data[:flipped] + bytes([data[flipped] ^ 4]) + data[flipped + 1 :])
        found = {entry.data for entry in read_entries(part)}
        assert found <= true, flipped - at


@pytest.mark.usefixtures("many_chunks")
def test_chunks_that_are_not_there_are_noticed_by_their_numbers(tmp_path: Path) -> None:
    record(tmp_path, transport(samples=300), channels=())
    # the chunk becomes a record of an unknown kind, which every reader skips
    spoil(tmp_path, 120, 0, Opcode.CHUNK ^ 0x7F)
    (error,) = of(Error, replay(tmp_path))
    assert error.kind == "recording_gap"
    assert "chunks from the wire are missing" in error.message


def _places(data: bytes) -> list[tuple[int, int, int]]:
    """Return offset, kind and length of every record in a file."""
    found, at = [], 8
    while at < len(data) - 8:
        kind, length = HEAD.unpack_from(data, at)
        found.append((at, kind, length))
        at += HEAD.size + length
    return found


# --- cut at any byte ---


@pytest.mark.slow
@pytest.mark.usefixtures("many_chunks")
def test_cut_at_every_byte_it_gives_what_was_whole_before(tmp_path: Path) -> None:
    items = transport(samples=3)
    record(tmp_path / "whole", items, channels=())
    data = files(tmp_path / "whole")[0].read_bytes()
    ends = [at + HEAD.size + length for at, kind, length in _places(data) if kind == Opcode.CHUNK]
    # a file that ends before the end of the session's metadata is refused
    head = _places(data)[1][0] + HEAD.size + _places(data)[1][2]
    everything = [item for item in items if isinstance(item, Chunk)]
    path = tmp_path / "cut.mcap"
    whole = find_session(files(tmp_path / "whole"))
    before = whole._replace(parts=[whole.parts[0]._replace(path=path)])
    for length in range(len(data)):
        path.write_bytes(data[:length])
        if length < head:
            with pytest.raises(UsageError, match=r"cut\.mcap: is no recording of fltea, or was cut"):
                find_session([path])
            continue
        events = list(McapRecording(before, "x").events())
        chunks = sum(end <= length for end in ends)
        # each item has a chunk of its own; the first item is `Opened`, which has no bytes
        bytes_in = b"".join(item.data for item in everything[: max(0, chunks - 1)])
        frames = FrameReader().feed(bytes_in)
        samples = [frame for frame in frames if isinstance(frame.message, wire.Sample)]
        assert len([event for event in in_samples(events) if isinstance(event, RawSample)]) == len(samples)
        troubles = [event.kind for event in events if isinstance(event, Trouble)]
        assert troubles == ["cut_recording"]
    path.write_bytes(data)
    assert not [e for e in McapRecording(find_session([path]), "x").events() if isinstance(e, Trouble)]


@pytest.mark.usefixtures("many_chunks")
def test_a_file_of_a_power_cut_ends_in_zeros(tmp_path: Path) -> None:
    live, sink = record(tmp_path, transport(samples=100), end=False)
    kill(sink)
    path = files(tmp_path)[0]
    with path.open("ab") as file:
        file.write(bytes(5000))
    again = replay(tmp_path)
    assert of(Error, again)[-1].kind == "cut_recording"
    assert of(Sample, again) == of(Sample, live)


# --- settings of a replay ---


def test_troubles_of_then_do_not_end_a_replay(tmp_path: Path) -> None:
    record(tmp_path, transport(samples=100, boots=2))
    troubles = [event for event in ReplaySource(tmp_path).events() if isinstance(event, Trouble)]
    assert [trouble.kind for trouble in troubles] == ["unplugged"]
    assert not any(trouble.fatal for trouble in troubles)


def test_a_silent_line_is_told_again(tmp_path: Path) -> None:
    items = transport(samples=100)
    record(tmp_path, [*items, Chunk(b"", items[-1].host_ns + 9 * 10**9, OFFSET_NS)])
    events = list(ReplaySource(tmp_path).events())
    (trouble,) = [event for event in events if isinstance(event, Trouble)]
    assert trouble.kind == "silent"
    assert "holds nothing for 5 s. The device was silent then, or the program that" in trouble.message
    assert "port" not in trouble.message
    ticks = [event.host_ns for event in events if isinstance(event, Tick)]
    assert 15 <= len(ticks) <= 18


def test_real_pace_waits_for_what_came(tmp_path: Path, now_ns: list[int]) -> None:
    record(tmp_path, transport(samples=100))
    times = []
    for event in ReplaySource(tmp_path, realtime=True).events():
        if not isinstance(event, DeviceStatus):
            times += [one.host_ns - now_ns[0] for one in in_samples([event])]
    assert len(times) > 98
    assert max(times) - min(times) <= 10


def test_the_offset_is_that_of_the_event(tmp_path: Path) -> None:
    items = transport(samples=60)
    record(tmp_path, items)
    source = open_source(load_config(None, SMALL | {"source": f"replay:{tmp_path}"}))
    offsets = {item.host_ns: item.unix_offset_ns for item in items}
    assert source.unix_offset_ns == items[0].unix_offset_ns
    for event in source.events():
        if isinstance(event, RawBlock):
            assert {source.unix_offset_ns} == {offsets[host_ns] for host_ns in event.host_ns.tolist()}


@pytest.mark.slow
def test_memory_does_not_grow_with_the_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(record_module, "FLUSH_NS", 0)

    def peak(samples: int) -> int:
        folder = tmp_path / str(samples)
        record(folder, transport(samples=samples), channels=())
        source = ReplaySource(folder)
        tracemalloc.start()
        for _ in source.events():
            pass
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert os.path.getsize(files(folder)[0]) > 100 * samples
        return found

    peak(100)
    assert peak(2000) < 1.2 * peak(500) + 20_000


def test_made_up_samples_have_no_temperature_though_their_frames_had_to_state_one(tmp_path: Path) -> None:
    source, encoder = SyntheticSource("?n=60&seed=2", realtime=False), AsWire(lambda: 0)
    record(tmp_path, [item for event in source.events() for item in encoder.encode(event)])
    samples = of(Sample, replay(tmp_path))
    assert len(samples) == 60
    assert {sample.temperature_c for sample in samples} == {None}
