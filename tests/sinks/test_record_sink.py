"""Tests of the recorder: what its files contain, and when it ends a file and begins another."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest
from fltea.recording.part_reader import read_info
from fltea.recording.schema import encode_message, record_schema
from fltea.recording.session import LinkMessage, from_metadata
from fltea.records import clock
from fltea.records.errors import UsageError
from fltea.records.estimate import AxisEstimate
from fltea.records.events import Chunk, Failed, Opened, TransportEvent
from fltea.records.records import ACCEL_AXES, AXES, Error, Estimate, Sample
from fltea.service.hub import Hub
from fltea.service.open_outputs import open_outputs
from fltea.settings.config import load_config
from fltea.settings.outputs import FEW_DEVICES, RECORDED, RecordConfig
from fltea.sinks import record as record_module
from fltea.sinks.record import KINDS
from fltea.sinks.record_session import MOST_NOTES
from fltea.sources.synthetic import parse_noise
from fltea.wire.messages import encode
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from tests.rig.blocks import of
from tests.rig.host_support import hello
from tests.rig.mcap_support import (
    MONOTONIC_NS,
    OFFSET_NS,
    files,
    messages,
    metadata_of,
    record,
    replay,
    sink_in,
    transport,
    wire_data,
    wire_entries,
    wire_of,
    written,
)
from tools import standin
from tools.made_up_board import HELLO

# --- what is in a file ---


def test_every_byte_is_in_the_file_before_anything_reads_it(tmp_path: Path) -> None:
    items = transport(boots=2)
    record(tmp_path, items)
    (path,) = files(tmp_path)
    found = wire_of(path)
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
    found = wire_of(files(tmp_path)[0])
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
        assert count["/due/sample"] == len(of(Sample, records)) == 197
        assert count["/due/estimate"] == len(of(Estimate, records)) == 177
        assert all(index.message_index_length for index in summary.chunk_indexes)
        middle_ns = of(Sample, records)[100].host_ns
        later = list(reader.iter_messages("/due/sample", starting_at=middle_ns))
        assert len(later) == 97
        for _, channel, message in reader.iter_messages():
            if channel.message_encoding == "json":
                schema = summary.schemas[channel.schema_id]
                assert schema.encoding == "jsonschema"
                assert fits(msgspec.json.decode(message.data), msgspec.json.decode(schema.data)), message.data
    kinds = dict(metadata_of(files(tmp_path)[0]))
    info = from_metadata(kinds["fltea.session"])
    assert (info.device, info.part, info.hello) == ("due", 0, None)
    assert (kinds["fltea.hello"]["boot_id"], kinds["fltea.hello"]["gyro_lsb_per_dps"]) == ("1", "16.4")


TYPES = {"string": str, "boolean": bool, "integer": int, "number": int | float, "object": dict, "array": list}


def fits(value: Any, schema: dict) -> bool:
    """Return whether a value fits a JSON schema. Only the keywords that our schemas use are checked."""
    kind = schema["type"]
    if not isinstance(value, TYPES[kind]) or (isinstance(value, bool) and kind != "boolean"):
        return False
    if kind == "array":
        return all(fits(item, schema["items"]) for item in value)
    if kind != "object":
        return value in schema.get("enum", [value])
    known = schema["properties"]
    are_there = set(schema.get("required", ())) <= value.keys()
    return are_there and all(fits(item, known[key]) for key, item in value.items() if key in known)


@pytest.mark.parametrize("kind", [*KINDS.values(), LinkMessage])
def test_schemas_are_such_as_foxglove_reads(kind: type[msgspec.Struct]) -> None:
    """The parser of Foxglove knows only these keywords, needs the properties of every object, and refuses
    everything else.
    """

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


def without_nulls(value: Any) -> Any:
    if isinstance(value, list):
        return [without_nulls(item) for item in value]
    if not isinstance(value, dict):
        return value
    return {key: without_nulls(item) for key, item in value.items() if item is not None}


@given(st.text(), st.text('":,null{}\\'), st.none() | st.floats(), st.none() | st.text('":,null\\'))
def test_what_is_null_is_left_out_whatever_texts_say(a: str, b: str, x: float | None, c: str | None) -> None:
    for one in (Error(a, b, 1, device=c), hello(source=a, sampling_mode=b, firmware_version=c, rate_hz=x)):
        whole = msgspec.json.decode(msgspec.json.encode(one))
        assert msgspec.json.decode(encode_message(one)) == without_nulls(whole)


def test_plots_find_the_numbers_of_every_axis() -> None:
    schema = msgspec.json.decode(record_schema(Estimate))
    axis = set(AxisEstimate.__struct_fields__)
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
    assert len(of(Sample, replay(Path(str(right).removesuffix("_000.mcap"))))) == 197


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
    wire = [message for path in paths for message in wire_of(path)]
    assert b"".join(m.data for m in wire) == b"".join(i.data for i in items if isinstance(i, Chunk))
    assert [message.sequence for message in wire] == list(range(len(wire)))
    for path in paths[1:]:
        metadata = dict(metadata_of(path))
        assert from_metadata(metadata["fltea.session"]).hello is not None
        assert metadata["fltea.hello"]["boot_id"] == "1"


def test_a_board_that_says_ever_new_things_leaves_few_notes(tmp_path: Path) -> None:
    """If a board sends ever new HELLOs, the recorder writes few of them as metadata, since the index of
    metadata stays in memory until the file ends.

    The recorded bytes of the port contain every HELLO anyway.
    """
    items: list[TransportEvent] = [Opened(MONOTONIC_NS, OFFSET_NS)]
    items += [
        Chunk(standin.Device(parse_noise("seed=1"), boot_id=k).booted(), MONOTONIC_NS + k, OFFSET_NS)
        for k in range(1, 3 * MOST_NOTES)
    ]
    record(tmp_path, items)
    notes = [name for name, _ in metadata_of(files(tmp_path)[0])]
    assert notes.count("fltea.hello") == MOST_NOTES
    assert len(wire_data(files(tmp_path)[0])) == len(items) - 1


def test_what_a_device_said_before_it_was_lost_is_not_carried_over(tmp_path: Path) -> None:
    items = transport(samples=120)
    later_ns = items[-1].host_ns + 2 * 10**9
    items += [Failed("unplugged", "gone.", later_ns, OFFSET_NS), Opened(later_ns + 2 * 10**9, OFFSET_NS)]
    record(tmp_path, items, rotate_s=1.9)
    ((_, metadata),) = metadata_of(files(tmp_path)[-1])
    assert from_metadata(metadata).hello is None


def test_what_a_device_said_before_it_was_refused_is_not_carried_over(tmp_path: Path) -> None:
    items = transport(samples=120)
    bad = encode(HELLO._replace(sample_rate=0), 0, 0)
    later_ns = items[-1].host_ns + 2 * 10**9
    items += [Chunk(bad, items[-1].host_ns, OFFSET_NS), Chunk(b"\0", later_ns, OFFSET_NS)]
    record(tmp_path, items, rotate_s=1.9)
    first, last = (from_metadata(dict(metadata_of(path))["fltea.session"]) for path in files(tmp_path))
    assert (first.part, last.part, last.hello) == (0, 1, None)


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
    on_disk_ns = wire_entries(files(tmp_path)[0])[-1].log_ns - read_info(files(tmp_path)[0]).offset_ns
    assert 0 <= now_ns[0] - on_disk_ns <= record_module.FLUSH_NS + 20_000_000
    sink.close()


def test_an_error_of_another_output_may_come_first(tmp_path: Path) -> None:
    sink = sink_in(tmp_path)
    error = Error("output_lost", "the broker is away.", OFFSET_NS, device="due")
    written(sink, error, *transport(samples=100))
    assert sink.lost == 0
    assert [topic for topic, _ in messages(files(tmp_path)[0])].count("/due/error") == 1
    assert len(of(Sample, replay(tmp_path))) == 98


# --- what is refused ---


def test_many_devices_are_recorded_without_what_comes_with_each_sample() -> None:
    unset, chosen = RecordConfig(), RecordConfig(channels=("sample",))
    assert set(unset.for_devices(FEW_DEVICES).channels or ()) == set(RECORDED)
    rest = set(unset.for_devices(FEW_DEVICES + 1).channels or ())
    assert {"sample", "estimate"}.isdisjoint(rest)
    assert {"fit", "stats", "gap", "error"} <= rest
    assert chosen.for_devices(300) == chosen


@pytest.mark.parametrize("devices", [FEW_DEVICES, FEW_DEVICES + 1])
def test_the_number_of_devices_decides_when_the_outputs_are_opened(tmp_path: Path, devices: int) -> None:
    common = {"source": "synthetic:", "record.folder": str(tmp_path), "format": "none"}
    configs = [load_config(None, common | {"name": f"d{k}"}) for k in range(devices)]
    hub = Hub(lambda error: None)
    open_outputs(configs, hub)
    sinks: list[Any] = [sink_queue.sink for device, sink_queue in hub.sink_queues() if device is not None]
    hub.close()
    assert len(sinks) == devices
    assert {"sample" in sink._channels.kinds for sink in sinks} == {devices <= FEW_DEVICES}


def test_channels_that_there_are_not() -> None:
    with pytest.raises(UsageError, match=r'record\.channels must be a list of "corrected", '):
        load_config(None, {"record.channels": ["samples"]})


def test_folder_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(
        UsageError, match=r"--record .*/file/sub: the folder cannot be made \(Not a directory\)"
    ):
        sink_in(tmp_path / "file/sub")


def test_a_too_slow_recorder_marks_the_place(tmp_path: Path) -> None:
    items = transport(samples=400)
    sink = sink_in(tmp_path, rotate_s=1.2)  # the files are 1.2 s long, so that each contains a HELLO
    for item in items[:150]:
        sink.write(item)
    sink.on_overflow(33)
    written(sink, *items[183:])
    records = replay(tmp_path)
    (error,) = of(Error, records)
    assert error.kind == "recording_gap"
    assert "33 items" in error.message
    after = next(s.seq for s in of(Sample, records) if s.seq > 160)
    assert after in (200, 201)  # samples are rejected until the next HELLO, which comes every second
