"""Tests that logs of flight controllers (PX4, ArduPilot) and measuring devices (LabVIEW, ASAM MDF) are read.

In some logs, one message has several samples: those that waited in the sensor's FIFO, or a batch.
"""

import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import asammdf
import nptdms
import numpy as np
import pytest
from fltea.recording.files import Stored
from fltea.recording.reader_process import open_in_process
from fltea.recording.reading import NotStated
from fltea.records.errors import UsageError
from fltea.settings.how import How
from fltea.settings.limits import DEFAULT_LIMITS

from tests.rig.log_files import IMU_FORM, dataflash, ulog
from tests.rig.table_support import open_here

N = 240
TIMES_US = np.arange(N) * 5_000
RADS = np.random.default_rng(1).normal(scale=0.01, size=(N, 3)).astype(np.float32)
OTHER = np.random.default_rng(2).normal(scale=0.02, size=(N, 3)).astype(np.float32)


def opened(kind: str, path: Path, **how: Any) -> Stored:
    """Open a log. All kinds but PX4's (ulg) are opened in a reader process. Their libraries keep files open,
    or have to be patched so that they write no files, which would last in the tests' own process.
    """
    return (
        open_here(kind, path, **how)
        if kind == "ulg"
        else open_in_process(kind, path, How(**how), DEFAULT_LIMITS)
    )


def written(kind: str, path: Path, data: bytes, **how: Any) -> Stored:
    path.write_bytes(data)
    return opened(kind, path, **how)


def refusal(kind: str, path: Path, data: bytes, **how: Any) -> str:
    with pytest.raises(UsageError) as caught:
        written(kind, path, data, **how)
    return str(caught.value)


def rates_of(found: Stored) -> Any:
    return found.whole().gyro


# --- PX4 ---

GYRO_FORM = "uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z;float temperature;"
ANGULAR = "uint64_t timestamp_sample;float[3] xyz;float[3] xyz_derivative;"
FIFO_FORM = "uint64_t timestamp_sample;uint32_t device_id;float dt;float scale;uint8_t samples;"
FIFO_FORM += "int16_t[32] x;int16_t[32] y;int16_t[32] z;"


def two_gyroscopes() -> bytes:
    rows = [
        (place, "QI4f", t + 300, t, 100 + place, *values[k], 25.0)
        for k, t in enumerate(TIMES_US.tolist())
        for place, values in enumerate((RADS, OTHER))
    ]
    return ulog({"sensor_gyro": GYRO_FORM}, [("sensor_gyro", 0), ("sensor_gyro", 1)], rows)


def test_one_of_several_px4_gyroscopes_is_asked_for_by_number(tmp_path: Path) -> None:
    path, data = tmp_path / "log.ulg", two_gyroscopes()
    text = refusal("ulg", path, data)
    each = "sensor_gyro:0 (240 messages, device_id 100), sensor_gyro:1 (240 messages, device_id 101)"
    assert f"{path}: nothing says which sensor is meant of {each}" in text
    assert text.endswith("--topic ?")
    for topic, values in (("sensor_gyro:0", RADS), ("sensor_gyro:1", OTHER)):
        found = opened("ulg", path, topic=topic)
        assert rates_of(found) == pytest.approx(np.degrees(values), rel=1e-6)
        assert (found.rate_hz, found.topic) == (pytest.approx(200.0), topic)
    assert "no topic sensor_gyro:2; it has sensor_gyro:0" in refusal("ulg", path, data, topic="sensor_gyro:2")
    assert "no topic mag; name one by --topic: sensor_gyro." in refusal("ulg", path, data, topic="mag")


def test_a_px4_topic_of_two_devices_is_no_sensor(tmp_path: Path) -> None:
    rows = [(0, "QI4f", t, t, 7 + k // 100, *RADS[k], 25.0) for k, t in enumerate(TIMES_US.tolist())]
    data = ulog({"sensor_gyro": GYRO_FORM}, [("sensor_gyro", 0)], rows)
    text = refusal("ulg", tmp_path / "log.ulg", data)
    assert "whose sensor_gyro is of several sensors one after the other (device_id 7, 8, 9)" in text


def test_the_unit_of_a_px4_topic_is_its_documentations(tmp_path: Path) -> None:
    rows = [(0, "Q6f", t + 300, t, *RADS[k], 0, 0, 0) for k, t in enumerate(TIMES_US.tolist())]
    data = ulog({"vehicle_angular_velocity": ANGULAR}, [("vehicle_angular_velocity", 0)], rows)
    found = written("ulg", tmp_path / "log.ulg", data)
    assert rates_of(found) == pytest.approx(np.degrees(RADS), rel=1e-6)
    assert found.rate_hz == pytest.approx(200.0)
    units = [(one.value, one.evidence) for one in found.reading if one.question == "unit"]
    assert units == [("rad/s", "dialect")]


def queue(counts: Iterable[int], true_us: float, dt_us: float) -> tuple[bytes, Any]:
    """Return a PX4 log with messages of a sensor's queue, and the samples in them. Such a queue (FIFO)
    holds the samples since it was last read, so each message has several samples: `counts` says how many.
    """
    counts = list(counts)
    raw = np.random.default_rng(3).integers(-200, 200, size=(sum(counts), 3))
    rows, end = [], 0
    for count in counts:
        one = np.zeros((3, 32), np.int16)
        one[:, :count] = raw[end : end + count].T
        # a message has an array of 32 entries; those after its last sample still hold older values
        one[:, count:] = 9999
        end += count
        last_us = round((end - 1) * true_us) + 1_000_000
        rows.append((0, "QIffB96h", last_us + 90, last_us, 7, dt_us, 0.001, count, *one.reshape(-1)))
    return ulog({"sensor_gyro_fifo": FIFO_FORM}, [("sensor_gyro_fifo", 0)], rows), raw


@pytest.mark.parametrize("true_us", [125.0, 126.5])
def test_samples_of_a_px4_queue_follow_each_other_in_time(true_us: float, tmp_path: Path) -> None:
    data, raw = queue([8, 8, 7, 9, 8] * 20, true_us, 125.0)
    found = written("ulg", tmp_path / "log.ulg", data)
    whole = found.whole()
    assert whole.gyro == pytest.approx(np.degrees(raw * 0.001))
    assert whole.seq.tolist() == list(range(800))
    assert found.rate_hz == pytest.approx(1e6 / true_us, rel=2e-3)


# --- ArduPilot ---

GYR_FORM = "QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ"
ISBH_FORM = "QHBBHHQf", "TimeUS,N,type,instance,mul,smp_cnt,SampleUS,smp_rate"
ISBD_FORM = "QHHaaa", "TimeUS,N,seqno,x,y,z"


def imu_rows(name: str, number: int | None, values: Any) -> list[tuple[Any, ...]]:
    sensor = () if number is None else (number,)
    return [
        (name, int(t), *sensor, *values[k], 0, 0, -9.8, 0, 0, 25.0, 1, 1, 1000, 1000)
        for k, t in enumerate(TIMES_US)
    ]


@pytest.mark.slow
def test_one_of_several_ardupilot_sensors_is_asked_for_by_number(tmp_path: Path) -> None:
    path = tmp_path / "log.bin"
    pairs = zip(imu_rows("IMU", 0, RADS), imu_rows("IMU", 1, OTHER), strict=True)
    data = dataflash({"IMU": IMU_FORM}, [row for pair in pairs for row in pair])
    text = refusal("ardupilot", path, data)
    assert "which sensor is meant of IMU:0 (240 messages), IMU:1 (240 messages)" in text
    with pytest.raises(NotStated):  # `NotStated` is the error whose message shows a whole command
        opened("ardupilot", path)
    for topic, values in (("IMU:1", OTHER), ("0", RADS), ("IMU[1]", OTHER)):
        found = opened("ardupilot", path, topic=topic)
        assert rates_of(found) == pytest.approx(np.degrees(values), rel=1e-6)
        assert found.rate_hz == pytest.approx(200.0)
        assert found.whole().accel_ms2[:, 2] == pytest.approx(np.full(N, -9.8), rel=1e-6)
    assert "without IMU:2; it has IMU:0" in refusal("ardupilot", path, data, topic="2")
    assert "no GYR messages; it has those of IMU" in refusal("ardupilot", path, data, topic="GYR")


def test_old_logs_of_ardupilot_have_a_message_for_each_sensor(tmp_path: Path) -> None:
    form = IMU_FORM[0].replace("QB", "Q", 1), IMU_FORM[1].replace("I,", "", 1)
    rows = [*imu_rows("IMU", None, RADS), *imu_rows("IMU2", None, OTHER)]
    path = tmp_path / "log.bin"
    path.write_bytes(dataflash({"IMU": form, "IMU2": form}, rows))
    assert rates_of(opened("ardupilot", path, topic="IMU:1")) == pytest.approx(np.degrees(OTHER), rel=1e-6)


def test_ardupilots_raw_messages_come_before_the_filtered_ones(tmp_path: Path) -> None:
    raw = [("GYR", int(t) + 400, 0, int(t), *OTHER[k]) for k, t in enumerate(TIMES_US)]
    data = dataflash({"IMU": IMU_FORM, "GYR": GYR_FORM}, [*imu_rows("IMU", 0, RADS), *raw])
    found = written("ardupilot", tmp_path / "log.bin", data)
    assert rates_of(found) == pytest.approx(np.degrees(OTHER), rel=1e-6)
    assert "GYR is read; there is IMU too (--topic)." in found.notes[-1].text


@pytest.mark.slow
def test_batches_of_ardupilot_have_a_scale_and_a_rate(tmp_path: Path) -> None:
    """Batches of the accelerometer and of other sensors stand between those of the gyroscope.

    One message of a batch of the gyroscope is lost.
    """
    rng, rows, expected = np.random.default_rng(4), [], []
    for batch in range(6):
        kind, sensor = (1, 0) if batch % 2 == 0 else ((0, 0) if batch % 4 == 1 else (1, 1))
        begin_us = 1_000_000 + batch * 100_000
        rows.append(("ISBH", begin_us + 5, batch, kind, sensor, 900, 64, begin_us, 1000.0))
        values = rng.integers(-300, 300, size=(2, 3, 32))
        for number in range(2):
            if (batch, number) != (2, 0):
                rows.append(("ISBD", begin_us + 9, batch, number, *values[number].reshape(-1).tolist()))
                if (kind, sensor) == (1, 0):
                    expected.append(values[number].T / 900)
    data = dataflash({"ISBH": ISBH_FORM, "ISBD": ISBD_FORM}, rows)
    found = written("ardupilot", tmp_path / "log.bin", data, topic="ISB:0")
    whole = found.whole()
    assert whole.gyro == pytest.approx(np.degrees(np.concatenate(expected)))
    assert found.rate_hz == pytest.approx(1000.0)
    assert whole.seq[[0, 63, 64, 95, 96]].tolist() == [0, 63, 232, 263, 400]
    assert "ISB:0 (3 messages), ISB:1 (1 messages)" in refusal("ardupilot", tmp_path / "log.bin", data)


def test_a_log_of_ardupilot_without_samples_says_what_it_has(tmp_path: Path) -> None:
    data = dataflash({"GPS": ("QB", "TimeUS,Status")}, [("GPS", 1, 3)] * 40)
    text = refusal("ardupilot", tmp_path / "log.bin", data)
    assert "no messages GYR or IMU or ISB; it has FMT, GPS" in text


# --- LabVIEW (TDMS) ---


def tdms(path: Path, segments: list[dict[str, Any]], properties: dict[str, Any], **how: Any) -> Stored:
    with nptdms.TdmsWriter(path) as out:
        for channels in segments:
            out.write_segment(
                [nptdms.ChannelObject("IMU", name, values, properties) for name, values in channels.items()]
            )
    return opened("tdms", path, **how)


AXES = {f"Gyro {axis}": RADS[:, i] for i, axis in enumerate("XYZ")}


def test_tdms_has_units_and_the_step_of_its_samples(tmp_path: Path) -> None:
    path = tmp_path / "a.tdms"
    found = tdms(path, [AXES], {"wf_increment": 0.005, "unit_string": "rad/s"})
    assert rates_of(found) == pytest.approx(np.degrees(RADS), rel=1e-6)
    assert (found.rate_hz, found.notes) == (pytest.approx(200.0), ())
    with pytest.raises(UsageError, match="nothing says the unit"):
        tdms(path, [AXES], {"wf_increment": 0.005})
    assert rates_of(opened("tdms", path, units="dps")) == pytest.approx(RADS)


@pytest.mark.slow
def test_tdms_has_units_of_its_step_and_rates_of_groups_and_files(tmp_path: Path) -> None:
    path = tmp_path / "a.tdms"
    of_channel = {"wf_increment": 5.0, "wf_xunit_string": "ms", "unit_string": "rad/s"}
    assert tdms(path, [AXES], of_channel).rate_hz == pytest.approx(200.0)
    with pytest.raises(UsageError, match="nothing says the rate"):
        tdms(path, [AXES], {**of_channel, "wf_xunit_string": "m"})
    for of_file, of_group in (({"SampleRate": 200.0}, {}), ({}, {"sampling rate": "0.2 kHz"})):
        with nptdms.TdmsWriter(path) as out:
            channels = [nptdms.ChannelObject("IMU", name, values) for name, values in AXES.items()]
            group = nptdms.GroupObject("IMU", {**of_group, "units": "rad/s"})
            out.write_segment([nptdms.RootObject(of_file), group, *channels])
        found = opened("tdms", path)
        assert found.rate_hz == pytest.approx(200.0)
        assert rates_of(found) == pytest.approx(np.degrees(RADS), rel=1e-6)


def test_tdms_in_parts_does_not_tell_whether_it_paused(tmp_path: Path) -> None:
    halves = [{name: values[part] for name, values in AXES.items()} for part in (slice(99), slice(99, None))]
    found = tdms(tmp_path / "a.tdms", halves, {"wf_increment": 0.005, "unit_string": "rad/s"})
    assert rates_of(found) == pytest.approx(np.degrees(RADS), rel=1e-6)
    assert "was written in 2 parts" in found.notes[0].text


def test_channels_of_tdms_with_different_steps_are_no_sensor(tmp_path: Path) -> None:
    path = tmp_path / "a.tdms"
    with nptdms.TdmsWriter(path) as out:
        for k, (name, values) in enumerate(AXES.items()):
            step = {"wf_increment": 0.005 * (1 + k), "unit_string": "rad/s"}
            out.write_segment([nptdms.ChannelObject("IMU", name, values, step)])
    with pytest.raises(UsageError, match=r"which of the rates .* 200, .* 100, "):
        opened("tdms", path)


STEP, UNIT = {"wf_increment": 0.005}, {"unit_string": "rad/s"}


@pytest.mark.parametrize(
    ("first", "second", "change"),
    [
        ({}, {"wf_increment": 0.0025}, "wf_increment 0.0025 for IMU.Gyro X, and before it 0.005"),
        ({}, {"unit_string": "deg/s"}, "unit_string deg/s for IMU.Gyro X, and before it rad/s"),
        (
            {"NI_Scale[0]_Linear_Slope": 1.0},
            {"NI_Scale[0]_Linear_Slope": 2.0},
            "NI_Scale[0]_Linear_Slope 2 for IMU.Gyro X, and before it 1",
        ),
    ],
)
def test_parts_of_tdms_with_another_rate_or_unit_are_left_out(
    first: dict[str, Any], second: dict[str, Any], change: str, tmp_path: Path
) -> None:
    """The library gives for all parts what the last one states."""
    path = tmp_path / "a.tdms"
    with nptdms.TdmsWriter(path) as out:
        for rows, more in ((slice(160), first), (slice(160, 200), second), (slice(200, None), {})):
            stated = STEP | UNIT | first | more
            out.write_segment(
                [nptdms.ChannelObject("IMU", name, one[rows], stated) for name, one in AXES.items()]
            )
    found = opened("tdms", path)
    assert rates_of(found) == pytest.approx(np.degrees(RADS[:160]), rel=1e-6)
    assert found.rate_hz == pytest.approx(200.0)
    note = next(note for note in found.notes if note.kind == "recording_gap")
    assert f"part 2 of 3 states {change}" in note.text
    assert "left out (80 rows)" in note.text


def test_parts_of_tdms_with_another_rate_of_all_channels_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.tdms"
    with nptdms.TdmsWriter(path) as out:
        for rows, rate_hz in ((slice(160), 200.0), (slice(160, None), 400.0)):
            channels = [nptdms.ChannelObject("IMU", name, one[rows], UNIT) for name, one in AXES.items()]
            out.write_segment([nptdms.RootObject({"SampleRate": rate_hz}), *channels])
    found = opened("tdms", path)
    assert (found.samples, found.rate_hz) == (160, pytest.approx(200.0))
    assert "states SampleRate 400 for the file, and before it 200" in found.notes[0].text


@pytest.mark.parametrize(
    "other",
    [{"wf_increment": 0.00502}, {"unit_string": "radians/s"}, {"wf_start_offset": 0.8}, {"note": "b"}],
)
def test_parts_of_tdms_that_state_the_same_in_other_words_are_read(
    other: dict[str, Any], tmp_path: Path
) -> None:
    path = tmp_path / "a.tdms"
    with nptdms.TdmsWriter(path) as out:
        out.write_segment([nptdms.ChannelObject("IMU", name, one[:0]) for name, one in AXES.items()])
        for rows, more in ((slice(160), {"wf_start_offset": 0.0, "note": "a"}), (slice(160, None), other)):
            channels = [
                nptdms.ChannelObject("IMU", name, one[rows], STEP | UNIT | more) for name, one in AXES.items()
            ]
            out.write_segment(channels)
    assert opened("tdms", path).samples == N


# --- ASAM MDF, of vehicles (MF4) ---


def mf4(path: Path, groups: dict[str, list[asammdf.Signal]]) -> Path:
    with asammdf.MDF(version="4.10") as file:
        for name, signals in groups.items():
            file.append(signals, acq_name=name)
        file.save(path, overwrite=True, compression=2)
    return path


def signals(values: Any, times_s: Any, **more: Any) -> list[asammdf.Signal]:
    return [
        asammdf.Signal(values[:, i], times_s, unit="rad/s", name=f"gyro_{axis}", **more)
        for i, axis in enumerate("xyz")
    ]


@pytest.mark.slow
def test_groups_of_mf4_keep_their_clocks(tmp_path: Path) -> None:
    left, right = TIMES_US / 1e6, TIMES_US / 5e5 + 0.001
    path = mf4(tmp_path / "a.mf4", {"left": signals(RADS, left), "right": signals(OTHER, right)})
    with pytest.raises(
        UsageError, match=r"which gyroscope is meant of left \(240 rows\), right \(240 rows\)"
    ):
        opened("mf4", path)
    for topic, values, rate_hz in (("left", RADS, 200.0), ("right", OTHER, 100.0)):
        found = opened("mf4", path, topic=topic)
        assert rates_of(found) == pytest.approx(np.degrees(values), rel=1e-6)
        assert found.rate_hz == pytest.approx(rate_hz)
    mixed = ["left.gyro_x", "right.gyro_y"]
    with pytest.raises(
        UsageError, match="belong to the groups left, right, and each group has a clock of its own"
    ):
        opened("mf4", path, columns=mixed, time_column="left.time")


@pytest.mark.slow
def test_what_mf4_says_is_not_valid_is_missing(tmp_path: Path) -> None:
    bad = np.zeros(N, bool)
    bad[[5, 6, 100]] = True
    values = RADS.copy()
    values[bad] = 1.0
    path = mf4(tmp_path / "a.mf4", {"imu": signals(values, TIMES_US / 1e6, invalidation_bits=bad)})
    found = opened("mf4", path)
    assert rates_of(found) == pytest.approx(np.degrees(RADS[~bad]), rel=1e-6)
    assert found.whole().seq.tolist() == np.flatnonzero(~bad).tolist()


@pytest.mark.slow
def test_damaged_logs_are_refused_with_a_reason(tmp_path: Path) -> None:
    whole = {
        "ulg": two_gyroscopes(),
        "ardupilot": dataflash({"IMU": IMU_FORM}, imu_rows("IMU", 0, RADS)),
        "tdms": b"TDSm" + struct.pack("<IIQQ", 14, 4713, 1 << 40, 1 << 40) + bytes(40),
        "mf4": b"MDF     4.10    " + bytes(200),
    }
    for kind, data in whole.items():
        path = tmp_path / f"a.{kind}"
        path.write_bytes(data[:150])
        with pytest.raises(
            UsageError, match=r"cannot be read as|holds no columns|is a PX4 log with no|no messages"
        ):
            open_in_process(kind, path, How(), DEFAULT_LIMITS)
