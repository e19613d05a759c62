"""A device's own estimates in every output, in replays, and on the command line."""

import io
import re
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from fltea.archive.export import export
from fltea.recording.schema import record_schema
from fltea.records.errors import UsageError
from fltea.records.estimate import DeviceAxisEstimate, FlteaEstimate
from fltea.records.events import Opened, TransportEvent
from fltea.records.records import AnyRecord, DeviceEstimates, Epoch, Estimate, Stats
from fltea.records.stats import DeviceEstimatorStats, DeviceStatus, LinkStats, SampleStats
from fltea.settings.config import load_config
from fltea.settings.outputs import RECORDED
from fltea.sinks.metrics import families as metrics_families
from fltea.sinks.metrics.families import Families, Newest
from fltea.sinks.record import KINDS
from fltea.sinks.table import TableSink
from fltea.sources.open_source import check_recordable, open_source
from prometheus_client import CollectorRegistry, generate_latest
from rich.console import Console

from tests.rig.blocks import of
from tests.rig.estimating_board import START_NS, Board, chunks, noise
from tests.rig.mcap_support import record, replay, without
from tests.rig.mqtt_support import Bench, make_bench
from tools.fed_source import FedSource

APART = {"alpha_difference": 3.2e-7, "f_difference": -4.5e-6, "state_difference": 1e-9}
BIAS = {"tracker_bias": 0.234, "tracker_bias_std": 0.012, "tracker_bias_difference": -0.0036}
GOOD = DeviceAxisEstimate(
    fltea=FlteaEstimate(0.4125, 0.03, -2.125, 0.25, 0.1, 0.05, True), age=471, **APART, **BIAS
)
ALONE = DeviceAxisEstimate(
    fltea=FlteaEstimate(0.5, 0.03, -1.0, 0.25, 0.1, None, True), age=9, why_not="other_start"
)
INVALID = DeviceAxisEstimate(fltea=FlteaEstimate(), age=471)
BESIDE = DeviceEstimates(
    500,
    1,
    5_000_000,
    7,
    "joint",
    {"gyro_x": GOOD, "gyro_y": ALONE, "gyro_z": INVALID},
    True,
    device="due",
)
OWN = DeviceEstimatorStats(2, 0, 1, 3, 17, 2400, 1500, 4, 6, {"gyro_x": 1}, {"gyro_x": {"order_gate": 5}})
STATS = Stats(
    epoch=1,
    host_ns=9,
    rate_hz=100.0,
    clock_ppm=0.0,
    startup_remaining=0,
    link=LinkStats(),
    sample_counts=SampleStats(1, 0, 0, 0, 0),
    axes={},
    board=DeviceStatus(0, 0, 0, 0, 0, "user", 43.25, 9100),
    device_estimator=OWN,
    device="due",
)


def board_items(samples: int = 160, *, estimates: bool = True) -> list[TransportEvent]:
    board = Board() if estimates else Board(None)
    return [Opened(START_NS, 0), *chunks(board.run(noise(samples)))]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record the bytes of a Due that sends estimates. The recording program ignores these estimates."""
    folder = tmp_path_factory.mktemp("own")
    record(folder, board_items())
    return folder


# --- recordings ---


def test_a_recording_of_raw_frames_replays_with_the_estimates_of_the_device(recording: Path) -> None:
    alone = replay(recording, **{"estimator.estimate_on": "device"})
    both = replay(recording, **{"estimator.estimate_on": "both"})
    assert [e.seq for e in of(Estimate, alone)] == list(range(30, 160))
    compared = of(DeviceEstimates, both)
    assert [e.seq for e in compared] == list(range(30, 160))
    assert all(e.comparable for e in compared)
    for one, e in zip(of(Estimate, alone), compared, strict=True):
        assert [a.fltea.alpha for a in one.axes.values()] == [a.fltea.alpha for a in e.axes.values()]


def test_records_of_both_ride_along_with_a_schema_and_can_be_exported(tmp_path: Path) -> None:
    live, _ = record(tmp_path, board_items(), estimate_on="both")
    compared = of(DeviceEstimates, live)
    out = tmp_path / "own.csv"
    assert export([tmp_path], out, "device_estimates", 100).rows == len(compared) == 130
    head, first = out.read_text().splitlines()[:2]
    row = dict(zip(head.split(","), first.split(","), strict=True))
    axis = compared[0].axes["gyro_y"]
    assert float(row["alpha_gyro_y"]) == axis.fltea.alpha
    assert float(row["f_gyro_y_s^-alpha"]) == axis.fltea.f
    assert float(row["alpha_difference_gyro_y"]) == axis.alpha_difference
    assert float(row["state_difference_gyro_y_dps"]) == axis.state_difference
    assert (row["age_gyro_y"], row["valid_gyro_y"], row["seq"]) == ("1", "1", "30")
    again = replay(tmp_path, **{"estimator.estimate_on": "both"})
    assert without(of(Estimate | DeviceEstimates, again), "device") == without(
        of(Estimate | DeviceEstimates, live), "device"
    )


def test_export_of_estimates_that_no_device_made_says_so(recording: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="estimate-on both"):
        export([recording], tmp_path / "none.csv", "device_estimates", 100)


def test_every_class_of_record_can_be_recorded() -> None:
    assert set(KINDS) == set(RECORDED)
    tags = {kind.__struct_config__.tag for kind in AnyRecord.__args__}
    assert set(KINDS) == tags
    schema = msgspec.json.decode(record_schema(DeviceEstimates))
    of_axis = schema["properties"]["axes"]["properties"]["gyro_z"]
    assert of_axis["properties"]["alpha_difference"] == {"type": "number"}
    assert "alpha_difference" not in of_axis["required"]


# --- the other outputs ---


def test_mqtt_has_a_topic_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    bench: Callable[..., Bench] = make_bench(monkeypatch)
    b = bench(estimate_every=50)
    b.write(*(msgspec.structs.replace(BESIDE, seq=seq) for seq in range(500, 601)))
    sent = [one for one in b.connection.sent if one[0] == "fltea/a0/device_estimate"]
    assert [msgspec.json.decode(payload)["seq"] for _, payload, _, _ in sent] == [500, 550, 600]
    assert sent[0][1:] == (msgspec.json.encode(BESIDE), 0, False)


def test_mqtt_publishes_of_a_device_that_sends_few_as_many(monkeypatch: pytest.MonkeyPatch) -> None:
    """This device estimates only every fifth sample. MQTT publishes its estimates at the same rate as those
    of a device that estimates every sample.
    """
    b = make_bench(monkeypatch)(estimate_every=10)
    b.write(*(msgspec.structs.replace(BESIDE, seq=seq) for seq in range(503, 560, 5)))
    assert [one["seq"] for one in b.connection.on("device_estimate")] == [513, 523, 533, 543, 553]


def test_mqtt_keeps_none_of_them_for_a_device_that_is_not_there_yet(monkeypatch: pytest.MonkeyPatch) -> None:
    b = make_bench(monkeypatch)(up=False)
    b.write(BESIDE)
    assert not b.sink._early


def metrics(newest: Newest) -> dict[str, str]:
    registry = CollectorRegistry()
    registry.register(Families({"due": newest}, {}, list))
    lines = generate_latest(registry).decode().splitlines()
    return dict(line.rsplit(" ", 1) for line in lines if not line.startswith("#"))


def test_metrics_of_the_device_s_own_estimator(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metrics_families, "host_ns", lambda: 6 * 10**9)
    found = metrics(Newest(stats=STATS, device_estimate=BESIDE, device_estimate_ns=10**9))
    x, y, z = (f'{{axis="gyro_{axis}",device="due"}}' for axis in "xyz")
    assert found["fltea_device_axis_alpha" + x] == "0.4125"
    assert found["fltea_device_axis_f" + x] == "-2.125"
    assert found["fltea_device_axis_alpha_difference" + x] == "3.2e-07"
    assert found["fltea_device_axis_f_difference" + x] == "-4.5e-06"
    assert found["fltea_device_axis_alpha" + y] == "0.5"
    assert "fltea_device_axis_alpha_difference" + y not in found
    assert [found[f"fltea_device_axis_bias{end}" + x] for end in ("", "_std", "_difference")] == [
        *map(str, BIAS.values())
    ]
    assert "fltea_device_axis_bias" + y not in found
    assert [found["fltea_device_axis_valid" + axis] for axis in (x, y, z)] == ["1.0", "1.0", "0.0"]
    assert "fltea_device_axis_alpha" + z not in found
    due = '{device="due"}'
    assert found["fltea_board_cpu_ratio" + due] == "0.4325"
    assert float(found["fltea_board_longest_step_seconds" + due]) == pytest.approx(9.1e-3)
    assert found["fltea_device_skipped_samples_total" + due] == "17.0"
    assert found["fltea_device_begun_total" + due] == "2.0"
    assert found["fltea_device_queue_samples" + due] == "3.0"
    assert found["fltea_device_estimates_total" + due] == "1500.0"
    assert found["fltea_device_estimates_lost_total" + due] == "4.0"
    assert found["fltea_device_estimates_unplaced_total" + due] == "6.0"
    assert float(found["fltea_device_longest_axis_seconds" + due]) == pytest.approx(2.4e-3)
    stale = metrics(Newest(stats=STATS, device_estimate=BESIDE, device_estimate_ns=10**9 - 1))
    assert not any("fltea_device_axis" in name for name in stale)


def test_metrics_of_a_device_that_does_not_estimate() -> None:
    board = DeviceStatus(0, 0, 0, 0, 0, "user")
    found = metrics(Newest(stats=msgspec.structs.replace(STATS, board=board, device_estimator=None)))
    assert not any(name.startswith(("fltea_device_", "fltea_board_cpu")) for name in found)


def test_table_shows_both_in_eighty_columns() -> None:
    epoch = Epoch(1, "start", 0, 0, 0, 7, None, device="due")
    console = Console(file=io.StringIO(), width=80, force_terminal=False)
    table = TableSink(console)
    for item in (epoch, BESIDE, STATS):
        table.write(item)
    table.close()
    lines = console.file.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    rows = {line.split()[0]: line.split() for line in reversed(lines) if re.match(r"gyro_. ", line)}
    assert rows["gyro_x"] == ["gyro_x", "0.412", "+3.2e-7", "-2.125", "-4.5e-6"]
    assert ["gyro_x", "0.234", "±", "0.024", "-3.6e-3", "-0.3", "σ"] in map(str.split, lines)
    assert sum(line.startswith("gyro_y ") for line in lines) == 1, "the device has no fit of it yet"
    assert rows["gyro_y"] == ["gyro_y", "0.500", "-1.000"]
    assert "gyro_y: not comparable: the device began at another sample" in lines
    assert rows["gyro_z"] == ["gyro_z", "not", "valid"]
    assert "device:  CPU 43.2 %  longest step of an axis 2.40 ms  skipped 17" in lines


def test_table_forgets_the_device_with_the_epoch() -> None:
    console = Console(file=io.StringIO(), width=80, force_terminal=False)
    table = TableSink(console)
    for item in (BESIDE, Epoch(2, "gap", 0, 0, 0, 7, None, device="due")):
        table.write(item)
    table.close()
    assert "gyro_x" not in console.file.getvalue()


# --- settings and the command line ---


@pytest.mark.parametrize("who", ["device", "both"])
@pytest.mark.parametrize("source", ["synthetic:?alpha=0.3", "i2c:///dev/i2c-1?addr=0x68", "replay:rest.csv"])
def test_only_a_wire_has_estimates_of_a_device(who: str, source: str) -> None:
    with pytest.raises(UsageError, match=rf"--estimate-on {who}: .*Arduino Due.*--estimate-on host"):
        open_source(load_config(None, {"source": source, "estimator.estimate_on": who}))


@pytest.mark.parametrize("who", ["device", "both"])
def test_a_state_file_cannot_keep_them(who: str, tmp_path: Path) -> None:
    config = load_config(None, {"estimator.estimate_on": who, "state.file": str(tmp_path / "state")})
    with pytest.raises(UsageError, match=f"begins again with each boot.*--estimate-on {who}"):
        check_recordable(config, FedSource("/dev/due"))


@pytest.mark.parametrize("who", ["device", "both"])
def test_a_device_does_not_estimate_the_accelerometer(who: str) -> None:
    with pytest.raises(UsageError, match=f"estimate_on {who} is not for the accelerometer"):
        load_config(None, {"accel.estimate_on": who})
