"""The recorder: what is in its files, when they end, and what a disk that fails costs."""

import errno
import os
import subprocess
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest
import standin
from fltea.recording.part import AppendOnly
from fltea.recording.scan import Scan
from fltea.recording.schema import record_schema
from fltea.recording.session import LinkMessage, from_metadata
from fltea.records import clock
from fltea.records.errors import UsageError
from fltea.records.events import Chunk, Failed, Opened
from fltea.records.records import ACCEL_AXES, AXES, Error, Estimate, Hello, Sample
from fltea.settings.config import load_config
from fltea.settings.outputs import RecordConfig
from fltea.sinks import record as record_module
from fltea.sinks.record import KINDS, RecordSink
from fltea.sinks.record_session import MOST_NOTES
from fltea.sources.synthetic import parse_noise
from mcap.reader import make_reader
from mcap.records import Message
from mcap_support import MONOTONIC_NS, OFFSET_NS, record, replay, transport
from mcap_support import of as only


def messages(path: Path) -> list[tuple[str, Message]]:
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return [(channel.topic, message) for _, channel, message in reader.iter_messages()]


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.mcap"))


# --- what is in a file ---


def test_every_byte_is_in_the_file_before_anything_reads_it(tmp_path: Path) -> None:
    items = transport(boots=2)
    record(tmp_path, items)
    (path,) = files(tmp_path)
    found = [message for topic, message in messages(path) if topic == "/due/wire"]
    chunks = [item for item in items if isinstance(item, Chunk)]
    assert [message.data for message in found] == [chunk.data for chunk in chunks]
    assert [message.sequence for message in found] == list(range(len(chunks)))
    offset_ns = items[0].unix_offset_ns
    assert [message.log_time - offset_ns for message in found] == [chunk.host_ns for chunk in chunks]
    assert [m.publish_time for m in found] == [chunk.host_ns + chunk.unix_offset_ns for chunk in chunks]
    assert all(a.log_time <= b.log_time for a, b in pairwise(found))
    link = [msgspec.json.decode(m.data) for topic, m in messages(path) if topic == "/due/link"]
    lost = {"event": "failed", "kind": "unplugged", "message": "the port was lost."}
    assert link == [{"event": "opened"}, lost, {"event": "opened"}]


def test_a_wall_clock_that_is_set_moves_no_log_time(tmp_path: Path) -> None:
    hour_ns = 3600 * 10**9
    items = [
        item._replace(unix_offset_ns=OFFSET_NS - (k > 100) * hour_ns) for k, item in enumerate(transport())
    ]
    record(tmp_path, items)
    found = [message for topic, message in messages(files(tmp_path)[0]) if topic == "/due/wire"]
    assert all(0 < b.log_time - a.log_time < 10**9 for a, b in pairwise(found))
    assert found[-1].publish_time == found[-1].log_time - hour_ns


def test_the_library_reads_the_file_by_its_index(tmp_path: Path) -> None:
    records, _ = record(tmp_path, transport())
    with files(tmp_path)[0].open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        numbers = summary.statistics.channel_message_counts.items()
        count = {summary.channels[number].topic: n for number, n in numbers}
        assert count["/due/sample"] == len(only(records, Sample)) == 197
        assert count["/due/estimate"] == len(only(records, Estimate)) == 177
        assert all(index.message_index_length for index in summary.chunk_indexes)
        middle_ns = only(records, Sample)[100].host_ns
        later = list(reader.iter_messages("/due/sample", starting_at=middle_ns))
        assert len(later) == 97
        for _, channel, message in reader.iter_messages():
            if channel.message_encoding == "json":
                assert fits(msgspec.json.decode(message.data), _schema(summary, channel)), message.data
        kinds = {entry.name: entry.metadata for entry in reader.iter_metadata()}
    info = from_metadata(kinds["fltea.session"])
    assert (info.device, info.part, info.hello) == ("due", 0, None)
    assert (kinds["fltea.hello"]["boot_id"], kinds["fltea.hello"]["gyro_lsb_per_dps"]) == ("1", "16.4")


def _schema(summary, channel) -> dict:
    schema = summary.schemas[channel.schema_id]
    assert schema.encoding == "jsonschema"
    return msgspec.json.decode(schema.data)


def fits(value: object, schema: dict) -> bool:
    """Whether a value fits a schema, as far as ours go."""
    match schema["type"]:
        case "object":
            known = schema["properties"]
            return (
                isinstance(value, dict)
                and set(schema.get("required", ())) <= value.keys()
                and all(fits(item, known[key]) for key, item in value.items() if key in known)
            )
        case "array":
            return isinstance(value, list) and all(fits(item, schema["items"]) for item in value)
        case "string":
            return isinstance(value, str) and value in schema.get("enum", [value])
        case "boolean":
            return isinstance(value, bool)
        case "integer":
            return isinstance(value, int)
        case "number":
            return isinstance(value, int | float) and not isinstance(value, bool)
    raise AssertionError(schema)


@pytest.mark.parametrize("kind", [*KINDS.values(), LinkMessage])
def test_schemas_are_such_as_foxglove_reads(kind: type[msgspec.Struct]) -> None:
    """Its parser knows these words alone, wants the properties of every object, and throws at all else."""

    def check(schema: dict) -> None:
        allowed = {"title", "type", "properties", "required", "items", "enum"}
        assert schema.keys() <= allowed
        assert schema["type"] in ("object", "array", "string", "boolean", "integer", "number")
        if schema["type"] == "object":
            for item in schema["properties"].values():
                check(item)
        if schema["type"] == "array":
            check(schema["items"])

    schema = msgspec.json.decode(record_schema(kind))
    check(schema)
    assert schema["type"] == "object"


def test_plots_find_the_numbers_of_every_axis() -> None:
    schema = msgspec.json.decode(record_schema(Estimate))
    axis = {"alpha", "alpha_std", "f", "f_std", "state", "innovation", "valid", "null_p", "whiteness", "unit"}
    assert schema["properties"]["axes"]["properties"].keys() == {*AXES, *ACCEL_AXES}
    assert schema["properties"]["axes"]["properties"]["gyro_z"]["properties"].keys() == axis


def test_only_the_channels_asked_for(tmp_path: Path) -> None:
    record(tmp_path, transport(), channels=("sample",))
    assert {topic for topic, _ in messages(files(tmp_path)[0])} == {"/due/wire", "/due/link", "/due/sample"}


def test_devices_share_a_folder(tmp_path: Path) -> None:
    for device in ("left", "right"):
        record(tmp_path, transport(seed=len(device)), device=device)
    left, right = files(tmp_path)
    assert left.name.startswith("left_")
    assert {topic.split("/")[1] for topic, _ in messages(right)} == {"right"}
    with pytest.raises(UsageError, match=r"holds 2 recordings; name one of them:\n.*left_.*\n.*right_"):
        replay(tmp_path)
    assert len(only(replay(Path(str(right).removesuffix("_000.mcap"))), Sample)) == 197


def sink_in(folder: Path, told: list[tuple[str, str]] | None = None, **settings: Any) -> RecordSink:
    told = [] if told is None else told
    return RecordSink(RecordConfig(folder=str(folder), **settings), "due", lambda *one: told.append(one))


# --- when a file ends ---


@pytest.mark.parametrize("rotation", [{"rotate_s": 0.5}, {"rotate_mb": 0.02}])
def test_files_end_by_age_and_size_and_nothing_falls_between(
    rotation: dict[str, float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(record_module, "FLUSH_NS", 0)
    items = transport(samples=300)
    record(tmp_path, items, **rotation)
    paths = files(tmp_path)
    assert len(paths) >= 4
    assert [path.stem[-3:] for path in paths] == [f"{k:03d}" for k in range(len(paths))]
    assert len({path.stem[:-4] for path in paths}) == 1
    wire = [message for path in paths for topic, message in messages(path) if topic == "/due/wire"]
    assert b"".join(m.data for m in wire) == b"".join(i.data for i in items if isinstance(i, Chunk))
    assert [message.sequence for message in wire] == list(range(len(wire)))
    for path in paths[1:]:
        with path.open("rb") as file:
            metadata = {entry.name: entry.metadata for entry in make_reader(file).iter_metadata()}
        assert from_metadata(metadata["fltea.session"]).hello is not None
        assert metadata["fltea.hello"]["boot_id"] == "1"


def test_a_board_that_says_ever_new_things_leaves_few_notes(tmp_path: Path) -> None:
    """The index of all metadata stays in memory until the file ends; the bytes hold every HELLO anyway."""
    sink = sink_in(tmp_path)
    hellos = [
        Chunk(standin.Device(parse_noise("seed=1"), boot_id=k).boot(), MONOTONIC_NS + k, OFFSET_NS)
        for k in range(1, 3 * MOST_NOTES)
    ]
    for item in (Opened(MONOTONIC_NS, OFFSET_NS), *hellos):
        sink.write(item)
    sink.close()
    with files(tmp_path)[0].open("rb") as file:
        notes = [entry for entry in make_reader(file).iter_metadata() if entry.name == "fltea.hello"]
    assert len(notes) == MOST_NOTES
    assert len(wire_data(files(tmp_path)[0])) == len(hellos)


def test_what_a_device_said_before_it_was_lost_is_not_carried_over(tmp_path: Path) -> None:
    items = transport(samples=120)
    later_ns = items[-1].host_ns + 2 * 10**9
    items += [Failed("unplugged", "gone.", later_ns, OFFSET_NS), Opened(later_ns + 2 * 10**9, OFFSET_NS)]
    record(tmp_path, items, rotate_s=1.9)
    with files(tmp_path)[-1].open("rb") as file:
        (metadata,) = make_reader(file).iter_metadata()
    assert from_metadata(metadata.metadata).hello is None


def test_a_second_run_touches_nothing_of_the_first(tmp_path: Path) -> None:
    record(tmp_path, transport(samples=50))
    before = {path: path.read_bytes() for path in files(tmp_path)}
    record(tmp_path, transport(samples=50))
    assert len(files(tmp_path)) == 2
    assert all(path.read_bytes() == data for path, data in before.items())


def test_what_came_is_on_disk_within_a_second(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now_ns = [MONOTONIC_NS]
    monkeypatch.setattr(clock, "host_ns", lambda: now_ns[0])
    sink = sink_in(tmp_path)
    for item in transport(samples=300):
        now_ns[0] = item.host_ns
        sink.write(item)
        sink.flush()
        if isinstance(item, Chunk) and item.host_ns > MONOTONIC_NS + 2 * 10**9:
            break
    on_disk = _last_wire_ns(files(tmp_path)[0])
    assert 0 <= now_ns[0] - on_disk <= record_module.FLUSH_NS + 20_000_000
    sink.close()


def _last_wire_ns(path: Path) -> int:
    from fltea.sources.mcap import Part, read_entries, read_info

    info = read_info(path)
    entries = [e for e in read_entries(Part(path, info)) if getattr(e, "topic", "") == "wire"]
    return entries[-1].log_ns - info.offset_ns


def test_an_error_of_another_output_may_come_first(tmp_path: Path) -> None:
    sink = sink_in(tmp_path)
    sink.write(Error("output_lost", "the broker is away.", OFFSET_NS, device="due"))
    for item in transport(samples=100):
        sink.write(item)
    sink.close()
    assert sink.lost == 0
    assert [topic for topic, _ in messages(files(tmp_path)[0])].count("/due/error") == 1
    assert len(only(replay(tmp_path), Sample)) == 98


# --- what is refused ---


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"rotate_mb": 0}, "rotate_mb must be a number above 0 MB"),
        ({"rotate_s": -1}, "rotate_s must be a number above 0 s"),
        ({"resume_mb": float("nan")}, "resume_mb must be a number of at least 0 MB"),
        ({"channels": ["samples"]}, 'record.channels must be a list of "device_estimate", '),
    ],
)
def test_settings_that_make_no_sense(settings: dict[str, object], text: str) -> None:
    with pytest.raises(UsageError, match=text):
        load_config(None, {f"record.{name}": value for name, value in settings.items()})


def test_folder_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(
        UsageError, match=r"--record .*/file/sub: the folder cannot be made \(Not a directory\)"
    ):
        RecordSink(RecordConfig(folder=str(tmp_path / "file/sub")), "due", lambda kind, text: None)


# --- a disk that fails ---


class Disk:
    """Lets only so much be written, then fails as a disk does: after a part of the block."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.room: int | None = None
        self.number = errno.ENOSPC
        self.now_ns = MONOTONIC_NS
        write, allocate = os.write, os.posix_fallocate
        monkeypatch.setattr(os, "write", lambda fd, data: self._write(write, fd, data))
        monkeypatch.setattr(os, "posix_fallocate", lambda *a: self._allocate(allocate, *a))
        monkeypatch.setattr(clock, "host_ns", lambda: self.now_ns)
        monkeypatch.setattr(record_module, "FLUSH_NS", 0)

    def _write(self, write, fd: int, data: bytes) -> int:
        if self.room is None:
            return write(fd, data)
        if not self.room:
            raise OSError(self.number, os.strerror(self.number))
        written = write(fd, data[: self.room])
        self.room -= written
        return written

    def _allocate(self, allocate, fd: int, offset: int, size: int) -> None:
        if self.room is not None and size > self.room:
            raise OSError(self.number, os.strerror(self.number))
        allocate(fd, offset, size)


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    return Disk(monkeypatch)


def feed(sink: RecordSink, disk: Disk, items: list) -> None:
    for item in items:
        disk.now_ns = item.host_ns
        sink.write(item)
        sink.flush()


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EROFS])
def test_a_full_disk_costs_what_came_meanwhile_and_says_so_once(
    number: int, tmp_path: Path, disk: Disk
) -> None:
    told: list[tuple[str, str]] = []
    items = transport(samples=3000)
    sink = sink_in(tmp_path, told)
    disk.number = number
    feed(sink, disk, items[:300])
    disk.room = 100
    feed(sink, disk, items[300:1500])
    torn = files(tmp_path)[0].stat().st_size
    assert [kind for kind, _ in told] == ["disk_full" if number in record_module.NO_ROOM else "record_failed"]
    lost_while_full = sink.lost
    disk.room = 10**6  # less than resume_mb
    feed(sink, disk, items[1500:2200])
    assert (len(told), len(files(tmp_path))) == (1, 1)
    disk.room = None
    feed(sink, disk, items[2200:])
    sink.close()
    assert [kind for kind, _ in told][1:] == ["record_resumed"]
    assert files(tmp_path)[0].stat().st_size == torn
    first, second = files(tmp_path)
    assert _unreadable_bytes(first) == 0
    in_files = [m for path in (first, second) for m in wire_data(path)]
    link = [msgspec.json.decode(m.data) for topic, m in messages(second) if topic == "/due/link"]
    assert sink.lost == link[0]["items"] == len(items) - 1 - len(in_files) > lost_while_full
    assert link[0]["chunks"] == sink.lost
    everything = b"".join(item.data for item in items if isinstance(item, Chunk))
    assert len(b"".join(in_files)) + link[0]["bytes"] == len(everything)
    assert everything.startswith(b"".join(wire_data(first)))
    assert everything.endswith(b"".join(wire_data(second)))


def _unreadable_bytes(path: Path) -> int:
    scan = Scan(path)
    for _ in scan:
        pass
    return scan.lost_bytes


def wire_data(path: Path) -> list[bytes]:
    from fltea.sources.mcap import Part, read_entries, read_info

    entries = read_entries(Part(path, read_info(path)))
    return [entry.data for entry in entries if getattr(entry, "topic", "") == "wire"]


def test_a_replay_counts_what_a_full_disk_cost(tmp_path: Path, disk: Disk) -> None:
    items = transport(samples=2000)
    sink = sink_in(tmp_path)
    feed(sink, disk, items[:500])
    disk.room = 0
    feed(sink, disk, items[500:900])
    disk.room = None
    feed(sink, disk, items[900:])
    sink.close()
    records = replay(tmp_path)
    samples = only(records, Sample)
    stats = records[-1] if hasattr(records[-1], "samples") else None
    assert samples[-1].seq == 1999
    assert samples[0].seq == 0
    missing = 2000 - len(samples)
    gaps = [record for record in records if type(record).__name__ == "Gap"]
    assert sum(gap.missing for gap in gaps) == missing > 400
    assert max(gap.missing for gap in gaps) < 1100  # it resumed, and did not wait for the next HELLO
    assert [r.kind for r in only(records, Error)] == ["cut_recording", "recording_gap"]
    assert "bytes of the wire were not recorded (disk_full)" in only(records, Error)[1].message
    assert stats is None or stats.samples.lost == missing


def test_a_disk_that_is_full_from_the_start_records_from_when_it_is_not(tmp_path: Path, disk: Disk) -> None:
    told: list[tuple[str, str]] = []
    items = transport(samples=1500)
    sink = sink_in(tmp_path, told)
    disk.room = 0
    feed(sink, disk, items[:200])
    assert files(tmp_path) == []
    disk.room = None
    feed(sink, disk, items[200:])
    sink.close()
    assert [kind for kind, _ in told] == ["disk_full", "record_resumed"]
    assert len(only(replay(tmp_path), Sample)) > 700


def test_a_full_disk_at_the_very_end_raises_nothing(tmp_path: Path, disk: Disk) -> None:
    told: list[tuple[str, str]] = []
    sink = sink_in(tmp_path, told)
    feed(sink, disk, transport(samples=100))
    disk.room = 50
    sink.close()
    assert [kind for kind, _ in told] == ["disk_full"]
    assert len(only(replay(tmp_path), Sample)) == 98


def test_a_real_file_system_that_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mount = tmp_path / "small"
    mount.mkdir()
    made = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=128k", "tmpfs", mount], capture_output=True)
    if made.returncode:
        pytest.skip("mounting a file system needs root")
    told: list[tuple[str, str]] = []
    now_ns = [MONOTONIC_NS]
    monkeypatch.setattr(clock, "host_ns", lambda: now_ns[0])
    monkeypatch.setattr(record_module, "FLUSH_NS", 0)
    try:
        sink = sink_in(mount, told, resume_mb=0.05)
        (mount / "ballast").write_bytes(bytes(80_000))
        items = transport(samples=1600)
        for k, item in enumerate(items):
            now_ns[0] = item.host_ns
            sink.write(item)
            sink.flush()
            if k == 900:
                assert [kind for kind, _ in told] == ["disk_full"]
                (mount / "ballast").unlink()
        assert [kind for kind, _ in told][:2] == ["disk_full", "record_resumed"]
        sink.close()
        records = replay(mount)
        assert [r.kind for r in only(records, Error)][:2] == ["cut_recording", "recording_gap"]
        assert isinstance(records[0], Hello)
    finally:
        subprocess.run(["umount", "-l", mount], check=True)


def test_a_too_slow_recorder_marks_the_place(tmp_path: Path) -> None:
    items = transport(samples=400)
    sink = sink_in(tmp_path, rotate_s=1.2)  # so that the file's head knows a HELLO
    for item in items[:150]:
        sink.write(item)
    sink.on_overflow(33)
    for item in items[183:]:
        sink.write(item)
    sink.close()
    records = replay(tmp_path)
    (error,) = only(records, Error)
    assert error.kind == "recording_gap"
    assert "33 items" in error.message
    after = next(s.seq for s in only(records, Sample) if s.seq > 160)
    assert after in (200, 201)  # nothing is believed before the next HELLO, which comes every second


def test_append_only_never_opens_a_file_that_exists(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"precious")
    with pytest.raises(FileExistsError):
        AppendOnly(tmp_path / "x", 0)
    assert (tmp_path / "x").read_bytes() == b"precious"
