"""Tests of recordings on a disk that fails.

A recording lacks only what arrived while the disk failed, and the lost items are counted.
"""

import errno
import os
import subprocess
from pathlib import Path
from typing import Any

import msgspec
import pytest
from fltea.recording.append_only import AppendOnly
from fltea.recording.scan import Scan
from fltea.records import clock
from fltea.records.events import Chunk
from fltea.records.records import Error, Hello, Sample
from fltea.sinks import record as record_module

from tests.rig.blocks import of
from tests.rig.mcap_support import MONOTONIC_NS, files, messages, replay, sink_in, transport, wire_data


class Recorder:
    """A recorder whose disk takes a limited number of bytes and then fails in the middle of a block.

    `room`: number of bytes that still fit; None for no limit. `told`: errors that the recorder has reported.
    """

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch, **settings: Any) -> None:
        self.room: int | None = None
        self.number = errno.ENOSPC
        self.now_ns = MONOTONIC_NS
        self.told: list[tuple[str, str]] = []
        self._os_write, self._os_allocate = os.write, os.posix_fallocate
        monkeypatch.setattr(os, "write", self._write)
        monkeypatch.setattr(os, "posix_fallocate", self._allocate)
        monkeypatch.setattr(clock, "host_ns", lambda: self.now_ns)
        monkeypatch.setattr(record_module, "FLUSH_NS", 0)
        self.sink = sink_in(folder, self.told, **settings)

    def feed(self, items: list, room: int | None = None) -> None:
        """Write items to the recorder, while the disk has room for `room` bytes."""
        self.room = room
        for item in items:
            self.now_ns = item.host_ns
            self.sink.write(item)
            self.sink.flush()

    def kinds(self) -> list[str]:
        return [kind for kind, _ in self.told]

    def _write(self, fd: int, data: bytes) -> int:
        if self.room is None:
            return self._os_write(fd, data)
        if not self.room:
            raise OSError(self.number, os.strerror(self.number))
        written = self._os_write(fd, data[: self.room])
        self.room -= written
        return written

    def _allocate(self, fd: int, offset: int, size: int) -> None:
        if self.room is not None and size > self.room:
            raise OSError(self.number, os.strerror(self.number))
        self._os_allocate(fd, offset, size)


@pytest.fixture
def recorder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Recorder:
    return Recorder(tmp_path, monkeypatch)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EROFS])
def test_a_full_disk_costs_what_came_meanwhile_and_says_so_once(
    number: int, tmp_path: Path, recorder: Recorder
) -> None:
    items, sink = transport(samples=3000), recorder.sink
    recorder.number = number
    recorder.feed(items[:300])
    recorder.feed(items[300:1500], room=100)
    torn = files(tmp_path)[0].stat().st_size
    assert recorder.kinds() == ["disk_full" if number in record_module.NO_ROOM else "record_failed"]
    lost_while_full = sink.lost
    # the room is less than the setting resume_mb, so the recording does not resume
    recorder.feed(items[1500:2200], room=10**6)
    assert (len(recorder.told), len(files(tmp_path))) == (1, 1)
    recorder.feed(items[2200:])
    sink.close()
    assert recorder.kinds()[1:] == ["record_resumed"]
    assert files(tmp_path)[0].stat().st_size == torn
    first, second = files(tmp_path)
    scan = Scan(first)
    assert list(scan)
    assert scan.lost_bytes == 0
    in_files = [m for path in (first, second) for m in wire_data(path)]
    link = [msgspec.json.decode(m.data) for topic, m in messages(second) if topic == "/due/link"]
    assert sink.lost == link[0]["items"] == len(items) - 1 - len(in_files) > lost_while_full
    assert link[0]["chunks"] == sink.lost
    everything = b"".join(item.data for item in items if isinstance(item, Chunk))
    assert len(b"".join(in_files)) + link[0]["bytes"] == len(everything)
    assert everything.startswith(b"".join(wire_data(first)))
    assert everything.endswith(b"".join(wire_data(second)))


def test_a_replay_counts_what_a_full_disk_cost(tmp_path: Path, recorder: Recorder) -> None:
    items = transport(samples=2000)
    recorder.feed(items[:500])
    recorder.feed(items[500:900], room=0)
    recorder.feed(items[900:])
    recorder.sink.close()
    records = replay(tmp_path)
    samples = of(Sample, records)
    stats = records[-1] if hasattr(records[-1], "sample_counts") else None
    assert samples[-1].seq == 1999
    assert samples[0].seq == 0
    missing = 2000 - len(samples)
    gaps = [record for record in records if type(record).__name__ == "Gap"]
    assert sum(gap.missing for gap in gaps) == missing > 400
    # the gap is so short that the recording resumed without waiting for the next HELLO
    assert max(gap.missing for gap in gaps) < 1100
    assert [r.kind for r in of(Error, records)] == ["cut_recording", "recording_gap"]
    assert "bytes of the wire were not recorded (disk_full)" in of(Error, records)[1].message
    assert stats is None or stats.sample_counts.lost == missing


def test_a_disk_that_is_full_from_the_start_records_from_when_it_is_not(
    tmp_path: Path, recorder: Recorder
) -> None:
    items = transport(samples=1500)
    recorder.feed(items[:200], room=0)
    assert files(tmp_path) == []
    recorder.feed(items[200:])
    recorder.sink.close()
    assert recorder.kinds() == ["disk_full", "record_resumed"]
    assert len(of(Sample, replay(tmp_path))) > 700


def test_a_full_disk_at_the_very_end_raises_nothing(tmp_path: Path, recorder: Recorder) -> None:
    recorder.feed(transport(samples=100))
    recorder.room = 50
    recorder.sink.close()
    assert recorder.kinds() == ["disk_full"]
    assert len(of(Sample, replay(tmp_path))) == 98


def test_a_real_file_system_that_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mount = tmp_path / "small"
    mount.mkdir()
    made = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=128k", "tmpfs", mount], capture_output=True)
    if made.returncode:
        pytest.skip("mounting a file system needs root")
    try:
        recorder = Recorder(mount, monkeypatch, resume_mb=0.05)
        (mount / "ballast").write_bytes(bytes(80_000))
        items = transport(samples=1600)
        recorder.feed(items[:901])
        assert recorder.kinds() == ["disk_full"]
        (mount / "ballast").unlink()
        recorder.feed(items[901:])
        assert recorder.kinds()[:2] == ["disk_full", "record_resumed"]
        recorder.sink.close()
        records = replay(mount)
        assert [r.kind for r in of(Error, records)][:2] == ["cut_recording", "recording_gap"]
        assert isinstance(records[0], Hello)
    finally:
        subprocess.run(["umount", "-l", mount], check=True)


def test_append_only_never_opens_a_file_that_exists(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"precious")
    with pytest.raises(FileExistsError):
        AppendOnly(tmp_path / "x", 0)
    assert (tmp_path / "x").read_bytes() == b"precious"
