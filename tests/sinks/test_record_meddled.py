"""Tests of recordings whose file another program removes or changes.

Only the content of the removed or changed file is lost, and the loss is counted.
"""

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fltea.records import clock
from fltea.records.events import Chunk, TransportEvent
from fltea.records.records import Error, Gap, Sample
from fltea.sinks import record as record_module
from fltea.sinks import record_session
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.blocks import of
from tests.rig.mcap_support import MONOTONIC_NS, files, replay, sink_in, transport, wire_data
from tools.faults.daemon import read_recording


class Recorder:
    """A recorder that flushes after each item.

    `told`: errors that the recorder has reported. `all`: all items that it has received.
    """

    def __init__(self, folder: Path, **settings: Any) -> None:
        self.told: list[tuple[str, str]] = []
        self.sink = sink_in(folder, self.told, **settings)
        self.all: list[TransportEvent] = []

    def feed(self, items: list[TransportEvent]) -> None:
        for item in items:
            self.sink.write(item)
            self.sink.flush()
        self.all += items

    def kinds(self) -> list[str]:
        return [kind for kind, _ in self.told]


@pytest.fixture(autouse=True)
def flushed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(record_module, "FLUSH_NS", 0)
    monkeypatch.setattr(clock, "host_ns", lambda: MONOTONIC_NS)


def check_account(folder: Path, recorder: Recorder) -> int:
    """Check that every item is in the files or counted as lost; return how many are lost."""
    found = read_recording(folder)
    came = b"".join(item.data for item in recorder.all if isinstance(item, Chunk))
    assert len(found.wire) + sum(gap.bytes for gap in found.gaps) == len(came)
    chunks = sum(len(wire_data(file)) for file in files(folder))
    assert chunks + sum(gap.chunks for gap in found.gaps) == sum(isinstance(i, Chunk) for i in recorder.all)
    assert came.endswith(wire_data(files(folder)[-1])[-1])
    lost = sum(gap.items for gap in found.gaps)
    assert recorder.sink.lost == lost
    return lost


def delete_file(folder: Path) -> None:
    files(folder)[-1].unlink()


def replace_file(folder: Path) -> None:
    file = files(folder)[-1]
    file.unlink()
    file.touch()


def delete_folder(folder: Path) -> None:
    shutil.rmtree(folder.parent)


@pytest.mark.parametrize("remove", [delete_file, delete_folder])
def test_what_is_recorded_into_a_deleted_file_is_counted_and_a_new_one_begins(
    remove: Callable[[Path], None], tmp_path: Path
) -> None:
    folder = tmp_path / "above" / "recording"
    items, recorder = transport(samples=450), Recorder(folder)
    recorder.feed(items[:150])
    remove(folder)
    recorder.feed(items[150:])
    recorder.sink.close()
    assert recorder.kinds() == ["record_deleted", "record_resumed"]
    assert recorder.told[0][1].startswith(f"{folder}/due_")
    assert "000.mcap was deleted by another program while it was written: 151 items" in recorder.told[0][1]
    assert [file.stem[-3:] for file in files(folder)] == ["001"]
    assert recorder.sink.size_bytes == files(folder)[0].stat().st_size
    assert check_account(folder, recorder) == 151
    again = replay(folder)
    assert [error.kind for error in of(Error, again)] == ["recording_gap"]
    assert "bytes of the wire were not recorded (record_deleted)" in of(Error, again)[0].message
    assert of(Sample, again)[-1].seq == 449


def test_a_file_in_the_place_of_the_deleted_one_is_not_touched(tmp_path: Path) -> None:
    items, recorder = transport(samples=300), Recorder(tmp_path)
    recorder.feed(items[:100])
    replace_file(tmp_path)
    recorder.feed(items[100:])
    recorder.sink.close()
    first, second = files(tmp_path)
    assert (first.stat().st_size, recorder.kinds()[0]) == (0, "record_deleted")
    first.unlink()
    assert check_account(tmp_path, recorder) == 101
    assert second.stem.endswith("001")


def test_what_the_deleted_file_said_is_missing_is_said_again(tmp_path: Path) -> None:
    items, recorder = transport(samples=450), Recorder(tmp_path)
    recorder.feed(items[:80])
    delete_file(tmp_path)
    recorder.feed(items[80:160])
    recorder.sink.on_overflow(7)
    recorder.feed(items[160:240])
    delete_file(tmp_path)
    recorder.feed(items[240:])
    recorder.sink.close()
    assert recorder.kinds() == ["record_deleted", "record_resumed"] * 2
    (gap,) = read_recording(tmp_path).gaps
    # seven of the items were lost in the queue in front of the recorder, which counts them itself
    assert recorder.sink.lost == gap.items - 7
    assert len(b"".join(wire_data(files(tmp_path)[0]))) + gap.bytes == sum(
        len(item.data) for item in items if isinstance(item, Chunk)
    )


def test_a_moved_file_is_finished_where_it_is_and_nothing_is_lost(tmp_path: Path) -> None:
    items, recorder = transport(samples=300), Recorder(tmp_path)
    recorder.feed(items[:150])
    (tmp_path / "away").mkdir()
    moved = tmp_path / "away" / files(tmp_path)[0].name
    files(tmp_path)[0].rename(moved)
    recorder.feed(items[150:])
    recorder.sink.close()
    assert (recorder.kinds(), recorder.sink.lost) == (["record_moved"], 0)
    assert str(moved) in recorder.told[0][1]
    moved.rename(tmp_path / moved.name)
    assert len(files(tmp_path)) == 2
    assert check_account(tmp_path, recorder) == 0
    assert [s.seq for s in of(Sample, replay(tmp_path))][-1] == 299
    assert not of(Error, replay(tmp_path))


def test_a_file_that_is_cut_short_is_read_up_to_there_and_the_rest_is_counted(tmp_path: Path) -> None:
    items, recorder = transport(samples=450), Recorder(tmp_path)
    recorder.feed(items[:200])
    os.truncate(files(tmp_path)[0], files(tmp_path)[0].stat().st_size // 2)
    cut = files(tmp_path)[0].read_bytes()
    recorder.feed(items[200:])
    recorder.sink.close()
    assert recorder.kinds() == ["record_deleted", "record_resumed"]
    assert "was cut short by another program" in recorder.told[0][1]
    assert files(tmp_path)[0].read_bytes() == cut, "no hole was made"
    assert 50 < check_account(tmp_path, recorder) < 150
    again = replay(tmp_path)
    assert (of(Sample, again)[0].seq, of(Sample, again)[-1].seq) == (0, 449)
    assert len(of(Sample, again)) + sum(gap.missing for gap in of(Gap, again)) == 450


def test_a_file_that_is_deleted_at_the_very_end_is_counted_too(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path)
    recorder.feed(transport(samples=100))
    delete_file(tmp_path)
    recorder.sink.close()
    assert recorder.kinds() == ["record_deleted"]
    assert recorder.sink.lost == len(recorder.all)


def test_the_folder_is_not_made_again_below_a_disk_that_was_taken_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, items = tmp_path / "recording", transport(samples=300)
    recorder = Recorder(folder)
    recorder.feed(items[:100])
    shutil.rmtree(folder)
    recorder.sink._session._disk += 1
    recorder.feed(items[100:200])
    assert recorder.kinds() == ["record_deleted", "record_failed"]
    assert record_session.NO_DISK in recorder.told[1][1]
    assert not folder.exists()
    folder.mkdir()  # as if somebody had created the folder again: now the recorder uses it
    monkeypatch.setattr(clock, "host_ns", lambda: MONOTONIC_NS + record_module.RETRY_NS)
    recorder.feed(items[200:])
    recorder.sink.close()
    assert recorder.kinds()[2:] == ["record_resumed"]
    assert check_account(folder, recorder) == 200


def cut(file: Path) -> None:
    os.truncate(file, max(file.stat().st_size * 3 // 4, min(file.stat().st_size, 2000)))


@pytest.mark.slow
@given(st.lists(st.tuples(st.integers(1, 40), st.sampled_from([delete_file, "cut", "rotate"])), max_size=5))
@settings(max_examples=15, deadline=None)
def test_whatever_is_taken_away_and_when_all_is_accounted_for(
    tmp_path_factory: pytest.TempPathFactory, story: list[tuple[int, Any]]
) -> None:
    folder = tmp_path_factory.mktemp("story")
    rest, recorder = transport(samples=250), Recorder(folder)
    for count, what in story:
        recorder.feed(rest[:count])
        rest = rest[count:]
        if what == "rotate":
            recorder.sink._finish()
        elif what == "cut":
            cut(files(folder)[-1])
        else:
            what(folder)
    recorder.feed(rest)
    recorder.sink.close()
    check_account(folder, recorder)
