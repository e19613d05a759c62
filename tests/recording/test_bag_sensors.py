"""If one topic of a bag holds several sensors, the user chooses one, and samples of two sensors are never
mixed.
"""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea.recording.bag_sensors import Sensors
from fltea.recording.reading import NotStated
from fltea.recording.ros_bag import open_bag
from fltea.records.errors import UsageError
from fltea.settings.how import How
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.bag_support import (
    KINDS,
    PX4_FIFO,
    PX4_GYRO,
    START_NS,
    Messages,
    write_bag,
    write_objects,
    write_publishers,
    write_types,
)

N, RATE_HZ = 400, 200.0
STAMPS = (START_NS + np.arange(N) * 5_000_000).tolist()
LEFT, RIGHT = np.random.default_rng(3).normal(0.2, 0.1, (2, N // 2, 3))
"""Rates of two sensors in deg/s, whose messages alternate."""
BOTH = np.stack([LEFT, RIGHT], axis=1).reshape(N, 3)


def frames(path: Path, names: Sequence[str], topics: Sequence[str] = ("/imu",)) -> Path:
    """Write a bag of Imu messages that have these frame ids in turn."""
    return write_bag(path, dict.fromkeys(topics, Messages(STAMPS, np.radians(BOTH), frame=names)))


def objects(**more: Sequence[Any]) -> list[dict[str, Any]]:
    return [
        {"timestamp_ns": t, "gyro_dps": dict(zip("xyz", row, strict=True))}
        | {name: values[k % len(values)] for name, values in more.items()}
        for k, (t, row) in enumerate(zip(STAMPS, BOTH.tolist(), strict=True))
    ]


@pytest.mark.parametrize("kind", KINDS)
def test_frames_in_one_topic(tmp_path: Path, kind: str) -> None:
    path = frames(tmp_path / f"a.{kind}", ["imu_a", "imu_bcd"])
    with pytest.raises(
        NotStated, match=r"column header\.frame_id tells several apart \(imu_a, imu_bcd\).*: --sensor \?$"
    ):
        open_bag(path)
    for given_as, gyro in (
        ("imu_a", LEFT),
        ("imu_bcd", RIGHT),
        ("header.frame_id=imu_bcd", RIGHT),
        ("/imu:imu_a", LEFT),
        ("imu:imu_bcd", RIGHT),
    ):
        stored = open_bag(path, How(topic=given_as))
        assert stored.whole().gyro == pytest.approx(gyro)
        assert stored.rate_hz == pytest.approx(RATE_HZ / 2)
        assert stored.topic == "/imu"
        assert (stored.reading[0].evidence, stored.notes) == ("given", ())
    with pytest.raises(
        UsageError, match=r"'imu_c', nor .*: header\.frame_id has imu_a, imu_bcd\. It holds:\n  /imu"
    ):
        open_bag(path, How(topic="imu_c"))
    with pytest.raises(NotStated, match=r"apart \(imu_a, imu_bcd\).*: --sensor /imu:\?$"):
        open_bag(path, How(topic="/imu"))


def test_a_topic_first_and_then_a_sensor(tmp_path: Path) -> None:
    path = frames(tmp_path / "a.bag", ["a", "b"], ["/one", "/two"])
    with pytest.raises(NotStated, match=r"which of its 2 Imu topics is meant.*: --topic \?\n"):
        open_bag(path)
    with pytest.raises(NotStated, match=r": --units rad/s --sensor /two:\?$"):
        open_bag(path, How(topic="/two", units="rad/s"))
    with pytest.raises(UsageError, match=r"no Imu messages of the topic 'a'\. It holds:\n  /one"):
        open_bag(path, How(topic="a"))
    assert open_bag(path, How(topic="/two:b")).whole().gyro == pytest.approx(RIGHT)


@pytest.mark.parametrize(
    ("column", "values"),
    [
        ("source", ["l", "r"]),
        ("which", [5, 4]),
        ("sensor_id", [0, 1]),
        ("id", [7, 3]),
        ("imu", ["left", "right"]),
        ("frame_id", ["a", "b"]),
    ],
)
def test_sensors_in_json(tmp_path: Path, column: str, values: list[Any]) -> None:
    path = write_objects(tmp_path / "a.mcap", objects(**{column: values}), STAMPS)
    both = ", ".join(sorted(map(str, values)))
    with pytest.raises(NotStated, match=rf"column {column} tells several apart \({both}\).*: --sensor \?$"):
        open_bag(path)
    for value, gyro in zip(values, (LEFT, RIGHT), strict=True):
        assert open_bag(path, How(topic=str(value))).whole().gyro == pytest.approx(gyro)


def test_all_that_is_missing_is_asked_for_at_once(tmp_path: Path) -> None:
    some = [{"sensor_id": k % 2, "gyro": row} for k, row in enumerate(BOTH.tolist())]
    path = write_objects(tmp_path / "a.mcap", some, [START_NS] * N)
    with pytest.raises(
        NotStated,
        match=r"which sensor .*; and the unit .*; and the rate.*: --sensor \? --units \? --rate \?\n",
    ) as asked:
        open_bag(path)
    assert "--units deg/s     σ in deg/s" in str(asked.value)
    stored = open_bag(path, How(topic="1", units="deg/s", rate_hz=100.0))
    assert stored.whole().gyro == pytest.approx(RIGHT)


def test_fields_that_do_not_take_turns_tell_no_sensors(tmp_path: Path) -> None:
    noise = np.random.default_rng(5).integers(0, 2, N).tolist()
    states = ["cold"] * (N // 2) + ["warm"] * (N // 2)
    path = write_objects(tmp_path / "a.mcap", objects(parity=noise, state=states, note=["-"]), STAMPS)
    assert open_bag(path).whole().gyro == pytest.approx(BOTH)


@pytest.mark.parametrize("column", ["i", "sensor_id", "id"])
def test_a_field_that_counts_tells_no_sensors(tmp_path: Path, column: str) -> None:
    path = write_objects(tmp_path / "a.mcap", objects(**{column: range(N)}), STAMPS)
    assert open_bag(path).whole().gyro == pytest.approx(BOTH)
    counted = write_objects(tmp_path / "b.mcap", objects(frame_id=range(7)), STAMPS)
    assert open_bag(counted).samples == N
    states = write_objects(tmp_path / "c.mcap", objects(sensor=["warm", "cold"]), STAMPS)
    with pytest.raises(NotStated, match=r"1/1 says that all messages are from one sensor"):
        open_bag(states)
    assert open_bag(states, How(topic="1/1")).whole().gyro == pytest.approx(BOTH)


def test_of_two_fields_the_one_that_differs_tells_sensors(tmp_path: Path) -> None:
    path = write_objects(tmp_path / "a.mcap", objects(device=["board"], sensor_id=[0, 1]), STAMPS)
    with pytest.raises(NotStated, match="column sensor_id tells"):
        open_bag(path)
    assert open_bag(path, How(topic="1")).whole().gyro == pytest.approx(RIGHT)
    alike = write_objects(tmp_path / "b.mcap", objects(device=["l", "r"], sensor_id=[0, 1]), STAMPS)
    for value in ("r", "1", "sensor_id=1", "device=r"):
        assert open_bag(alike, How(topic=value)).whole().gyro == pytest.approx(RIGHT)


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_devices_of_px4(tmp_path: Path, kind: str) -> None:
    rads = np.radians(BOTH).astype(np.float32)
    rest = {"temperature": 30.0, "error_count": 0, "clip_counter": np.zeros(3, np.uint8), "samples": 1}
    messages = [
        {"timestamp": t // 1000, "timestamp_sample": t // 1000, "device_id": 2490378 + k % 2, **rest}
        | dict(zip("xyz", map(float, rads[k]), strict=True))
        for k, t in enumerate(STAMPS)
    ]
    path = write_types(
        tmp_path / f"a.{kind}", {"/gyro": ("px4_msgs/msg/SensorGyro", PX4_GYRO.format(""), messages)}, STAMPS
    )
    with pytest.raises(NotStated, match=r"device_id tells several apart \(2490378, 2490379\)"):
        open_bag(path)
    assert open_bag(path, How(topic="2490379")).whole().gyro == pytest.approx(RIGHT, rel=1e-6)


def test_devices_of_px4_by_their_fifos(tmp_path: Path) -> None:
    many, counts = 4, np.random.default_rng(1).integers(-90, 90, (2, N // 2, 4, 3))
    messages = []
    for k in range(N):
        axes = np.zeros((3, 32), np.int16)
        axes[:, :many] = counts[k % 2, k // 2].T
        time_us = (STAMPS[0] // 1000) + (k // 2) * 10_000
        fields = {"timestamp": time_us, "timestamp_sample": time_us, "device_id": 8 + k % 2}
        messages.append(
            fields | {"dt": 2500.0, "scale": 0.001, "samples": many} | dict(zip("xyz", axes, strict=True))
        )
    path = write_types(
        tmp_path / "a.mcap", {"/fifo": ("px4_msgs/msg/SensorGyroFifo", PX4_FIFO, messages)}, STAMPS
    )
    with pytest.raises(NotStated, match=r"device_id tells several apart \(8, 9\)"):
        open_bag(path)
    stored = open_bag(path, How(topic="9"))
    assert stored.whole().gyro == pytest.approx(np.degrees(counts[1].reshape(-1, 3) * 0.001), rel=1e-6)
    assert stored.rate_hz == pytest.approx(400)


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_two_programs_that_write_one_topic(tmp_path: Path, kind: str) -> None:
    """Two programs publish one topic with the same frame id, so only the publisher of a message distinguishes
    the two sensors.
    """
    left, right = (Messages(STAMPS[k::2], np.radians(BOTH[k::2])) for k in range(2))
    path = write_publishers(tmp_path / f"a.{kind}", {"/left": left, "/right": right})
    with pytest.raises(NotStated, match=r"publisher tells several apart \(/left, /right\)"):
        open_bag(path)
    assert open_bag(path, How(topic="/right")).whole().gyro == pytest.approx(RIGHT)
    half = N // 2
    before, after = (Messages(STAMPS[one], np.radians(BOTH[one])) for one in (slice(half), slice(half, N)))
    again = write_publishers(tmp_path / f"b.{kind}", {"/imu_17": before, "/imu_23": after})
    assert open_bag(again).whole().gyro == pytest.approx(BOTH)


# --- two gyroscopes in one message ---


def pairs(left: str, right: str, **more: Any) -> list[dict[str, Any]]:
    """Return messages that each hold both sensors. `left`, `right`: names such as `imu.gyro`."""

    def put(name: str, row: list[float], into: dict[str, Any]) -> None:
        group, _, leaf = name.rpartition(".")
        (into.setdefault(group, {}) if group else into)[leaf] = dict(zip("xyz", row, strict=True))

    found = []
    for t, one, other in zip(STAMPS, LEFT.tolist(), RIGHT.tolist(), strict=False):
        message: dict[str, Any] = {"timestamp_ns": t, **more}
        put(left, one, message)
        put(right, other, message)
        found.append(message)
    return found


@pytest.mark.parametrize(
    ("left", "right", "called"),
    [
        ("imu0.gyro_dps", "imu1.gyro_dps", ["imu0", "imu1"]),
        ("gyro0_dps", "gyro1_dps", ["gyro0_dps", "gyro1_dps"]),
        ("left.gyro_dps", "right.gyro_dps", ["left", "right"]),
        ("a.gyro_dps", "a.gyro_raw_dps", ["a.gyro_dps", "a.gyro_raw_dps"]),
    ],
)
def test_two_gyroscopes_in_a_message(tmp_path: Path, left: str, right: str, called: list[str]) -> None:
    path = write_objects(tmp_path / "a.mcap", pairs(left, right), STAMPS[: N // 2])
    with pytest.raises(
        NotStated, match=rf"which gyroscope is meant of {', '.join(called)}\. .*: --sensor \?$"
    ):
        open_bag(path)
    for name, gyro in zip(called, (LEFT, RIGHT), strict=True):
        stored = open_bag(path, How(topic=name))
        assert stored.whole().gyro == pytest.approx(gyro)
        by = {answer.question: answer.evidence for answer in stored.reading}
        assert (by["sensor"], by["columns"], by["unit"]) == ("given", "given", "stated")


def test_the_accelerometer_and_the_unit_of_the_sensor_that_is_meant(tmp_path: Path) -> None:
    some = pairs("imu0.gyro", "imu1.gyro")
    for one in some:
        one["imu0"] |= {"accel": {"x": 0.1, "y": 0.0, "z": 1.0}, "unit": "rad/s"}
        one["imu1"] |= {"accel": {"x": 0.2, "y": 0.0, "z": 9.81}}
    path = write_objects(tmp_path / "a.mcap", some, STAMPS[: N // 2])
    with pytest.raises(NotStated, match=r"of imu0, imu1\. "):
        open_bag(path)
    left = open_bag(path, How(topic="imu0")).whole()
    assert left.gyro == pytest.approx(np.degrees(LEFT))
    assert left.accel_ms2 is not None
    assert left.accel_ms2[0] == pytest.approx([0.980665, 0, 9.80665])
    with pytest.raises(NotStated, match=r"the unit of imu1\.gyro\.x.*: --sensor /imu:imu1 --units \?\n"):
        open_bag(path, How(topic="/imu:imu1"))


# --- rows of one sensor ---


@given(
    rows=st.lists(st.tuples(st.sampled_from("ab"), st.sampled_from("xyz"), st.booleans()), max_size=60),
    cuts=st.lists(st.integers(0, 60), max_size=3),
    value=st.sampled_from([None, "a", "b", "y", "q", "two=z"]),
)
def test_what_is_kept_is_of_one_sensor(
    rows: list[tuple[str, str, bool]], cuts: list[int], value: str | None
) -> None:
    sensors = Sensors("a.bag", ["one", "two"], value)
    edges = sorted({0, len(rows), *(cut for cut in cuts if cut < len(rows))})
    kept = []
    for begin, end in itertools.pairwise(edges):
        part = rows[begin:end]
        marks = sensors.keep([np.array([row[k] for row in part], np.str_) for k in range(2)])
        kept += [row for row, mark in zip(part, marks, strict=True) if mark]
    for place in range(2):
        assert len({row[place] for row in kept}) <= 1
    if len({row[:2] for row in rows}) > 1 and value is None:
        assert sensors.which is not None
    if value is not None and not kept and rows:
        assert sensors.lacks()
