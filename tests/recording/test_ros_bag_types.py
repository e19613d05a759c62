"""Tests bags with types that ROS does not define: PX4's, and types whose definition the bag holds."""

import contextlib
import sqlite3
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea.recording.bag_definition import parse_definition, read_columns
from fltea.recording.reading import NotStated
from fltea.recording.ros_bag import open_bag
from fltea.records.errors import UsageError
from fltea.settings.how import How
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tests.rig.bag_support import PX4_FIFO, PX4_GYRO, START_NS, even, told, write_bag, write_types

N = 120
ARRIVALS = (START_NS + np.arange(N) * 5_000_000).tolist()
TIMES_US = [30_000_000 + 5000 * k for k in range(N)]
_random = np.random.default_rng(4)
RADS = _random.normal([0.01, -0.02, 0.005], 0.002, (N, 3)).astype(np.float32)
ACCEL = _random.normal([0.1, 0.2, -9.79], 0.02, (N, 3)).astype(np.float32)

COMBINED = """# Sensor readings in SI-unit form.
uint64 timestamp # time since system start (microseconds)
int32 RELATIVE_TIMESTAMP_INVALID = 2147483647 # (0x7fffffff) of no use
float32[3] gyro_rad
uint32 gyro_integral_dt
int32 accelerometer_timestamp_relative
float32[3] accelerometer_m_s2
uint32 accelerometer_integral_dt
uint8 CLIPPING_X = 1
uint8 accelerometer_clipping
uint8 gyro_clipping
uint8 accelerometer_calibration_count
uint8 gyro_calibration_count
"""
RATES = """uint64 timestamp
uint64 timestamp_sample
float32[3] xyz
{}"""


def combined(k: int) -> dict[str, Any]:
    clipping = dict.fromkeys(
        (
            "accelerometer_clipping",
            "gyro_clipping",
            "accelerometer_calibration_count",
            "gyro_calibration_count",
        ),
        0,
    )
    accel = {
        "accelerometer_timestamp_relative": 0,
        "accelerometer_m_s2": ACCEL[k],
        "accelerometer_integral_dt": 5000,
    }
    return {"timestamp": TIMES_US[k], "gyro_rad": RADS[k], "gyro_integral_dt": 5000, **accel, **clipping}


def sample(k: int) -> dict[str, Any]:
    axes = {axis: float(RADS[k, i]) for i, axis in enumerate("xyz")}
    rest = {"temperature": 30.0, "error_count": 0, "clip_counter": np.zeros(3, np.uint8), "samples": 1}
    return {"timestamp": TIMES_US[k] + 90, "timestamp_sample": TIMES_US[k], "device_id": 7, **axes, **rest}


def rates(k: int) -> dict[str, Any]:
    return {"timestamp": TIMES_US[k] + 90, "timestamp_sample": TIMES_US[k], "xyz": RADS[k]}


PX4: dict[str, tuple[str, str, Callable[[int], dict[str, Any]]]] = {
    "combined": ("SensorCombined", COMBINED, combined),
    "gyro": ("SensorGyro", PX4_GYRO.format(""), sample),
    "rates": ("VehicleAngularVelocity", RATES.format(""), rates),
    "rates_1_14": (
        "VehicleAngularVelocity",
        RATES.format("float32[3] xyz_derivative\n"),
        lambda k: {**rates(k), "xyz_derivative": RADS[k]},
    ),
}


def px4_bag(path: Path, name: str) -> Path:
    kind, definition, make = PX4[name]
    return write_types(
        path, {"/fmu/out/imu": (f"px4_msgs/msg/{kind}", definition, [make(k) for k in range(N)])}, ARRIVALS
    )


def without_definitions(path: Path) -> Path:
    (file,) = path.glob("*.db3")
    with contextlib.closing(sqlite3.connect(file)) as connection, connection:
        connection.execute("DROP TABLE message_definitions")
    return path


@pytest.mark.parametrize("kind", ["mcap", "db3", "old.db3"])
@pytest.mark.parametrize("name", PX4)
def test_types_of_px4(tmp_path: Path, kind: str, name: str) -> None:
    path = px4_bag(tmp_path / f"a.{kind}", name)
    stored = open_bag(without_definitions(path) if kind == "old.db3" else path)
    whole = stored.whole()
    assert stored.rate_hz == pytest.approx(200, rel=1e-9)
    assert whole.gyro == pytest.approx(np.degrees(RADS.astype(np.float64)))
    assert stored.notes == ()
    evidence = {answer.question: answer.evidence for answer in stored.reading}
    assert (evidence["unit"], evidence["columns"]) == ("dialect", "dialect")
    if name == "combined":
        assert whole.accel_ms2 == pytest.approx(ACCEL.astype(np.float64))
    else:
        assert whole.accel_ms2 is None


def test_a_layout_of_px4_that_is_not_known_is_refused(tmp_path: Path) -> None:
    """A message of a later release of PX4 has an additional field.

    The message is read if the bag holds its definition, and refused otherwise.
    """
    kind, definition, make = "SensorGyro", PX4_GYRO.format("bool is_external\n"), sample
    messages = [{"is_external": False, **make(k)} for k in range(N)]
    path = write_types(
        tmp_path / "a.db3", {"/gyro": (f"px4_msgs/msg/{kind}", definition, messages)}, ARRIVALS
    )
    assert open_bag(path).whole().gyro == pytest.approx(np.degrees(RADS.astype(np.float64)))
    with pytest.raises(UsageError, match=rf"{N} are not of the layout of px4_msgs/msg/SensorGyro"):
        open_bag(without_definitions(path))


def test_samples_of_a_fifo_are_those_of_one_axis_each(tmp_path: Path) -> None:
    many, scale, dt_us = 5, 0.001, 1000.0
    counts = np.arange(N * many * 3).reshape(N * many, 3) % 900 + 1
    messages = []
    for k in range(N):
        axes = np.full((3, 32), 77, np.int16)
        axes[:, :many] = counts[k * many : (k + 1) * many].T
        arrays = dict(zip("xyz", axes, strict=True))
        time = TIMES_US[k]
        head = {"timestamp": time + 9, "timestamp_sample": time, "device_id": 7, "dt": dt_us, "scale": scale}
        messages.append({**head, "samples": many, **arrays})
    messages[50]["samples"] = 200  # this message is damaged: a message can hold at most 32 samples
    topics = {"/fifo": ("px4_msgs/msg/SensorGyroFifo", PX4_FIFO, messages)}
    for kind in ("mcap", "db3"):
        stored = open_bag(write_types(tmp_path / f"a.{kind}", topics, ARRIVALS))
        whole = stored.whole()
        kept = np.delete(np.arange(N * many), np.arange(50 * many, 51 * many))
        assert whole.gyro == pytest.approx(np.degrees(counts[kept] * scale))
        assert whole.seq is not None
        assert whole.seq.tolist() == kept.tolist()
        assert stored.rate_hz == pytest.approx(1000, rel=1e-6)
        assert "1 messages do not have the layout" in told(stored)["bag_messages"]


# --- definitions in bags ---

CUSTOM = """# An IMU with a gyroscope in {unit}.
std_msgs/Header header
string<=20 note
float32[] history
robot_msgs/Axes gyro  {comment}
float64 LIMIT = 3.0
float32 temperature
================================================================================
MSG: robot_msgs/Axes
# a vector
float32 x
float32 y
float32 z
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""


def custom(k: int, x: float = 1.0) -> dict[str, Any]:
    stamp = {"sec": ARRIVALS[k] // 10**9, "nanosec": ARRIVALS[k] % 10**9}
    history = np.ones(k % 4, np.float32)
    gyro = dict(zip("xyz", (x * RADS[k]).tolist(), strict=True))
    text = {"header": {"stamp": stamp, "frame_id": "imu"}, "note": "abc"[: k % 4]}
    return {**text, "history": history, "gyro": gyro, "temperature": 20.0}


def custom_bag(path: Path, unit: str = "what", comment: str = "", name: str = "/raw") -> Path:
    definition = CUSTOM.format(unit=unit, comment=comment and f"# {comment}")
    messages = [custom(k) for k in range(N)]
    return write_types(path, {name: ("robot_msgs/msg/ImuRaw", definition, messages)}, ARRIVALS)


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_a_type_that_its_definition_describes(tmp_path: Path, kind: str) -> None:
    with pytest.raises(NotStated, match=r"nothing says the unit of gyro\.x, \.y, \.z"):
        open_bag(custom_bag(tmp_path / f"a.{kind}"))
    stored = open_bag(custom_bag(tmp_path / f"b.{kind}", "mdps", "in rad/s"))
    assert stored.whole().gyro == pytest.approx(np.degrees(RADS.astype(np.float64)))
    assert stored.rate_hz == pytest.approx(200, rel=1e-9)
    assert not stored.notes
    unit = next(answer for answer in stored.reading if answer.question == "unit")
    assert (unit.value, unit.evidence) == ("rad/s", "stated")
    by_the_head = open_bag(custom_bag(tmp_path / f"c.{kind}", "mdps"))
    assert by_the_head.whole().gyro == pytest.approx(RADS.astype(np.float64) / 1000)


def test_a_type_that_is_made_for_it_comes_first(tmp_path: Path) -> None:
    """A bag has a topic of the type Imu and a topic of its own type with angular rates. The type that is made
    for sensors is preferred, since messages of other types may hold estimates.
    """
    other = custom_bag(tmp_path / "a.db3", "rad/s")
    imu = write_bag(tmp_path / "b.db3", {"/imu": even(90)})
    for first, second in ((other, imu), (imu, other)):
        folder = tmp_path / f"{first.stem}{second.stem}"
        folder.mkdir()
        for number, one in enumerate((first, second)):
            (file,) = one.glob("*.db3")
            (folder / f"c_{number}.db3").write_bytes(file.read_bytes())
        assert (open_bag(folder).samples, open_bag(folder).topic) == (90, "/imu")
        assert open_bag(folder, How(topic="/raw")).samples == N


SCALARS = {
    **{f"int{n}": f"i{n // 8}" for n in (8, 16, 32, 64)},
    **{f"uint{n}": f"u{n // 8}" for n in (8, 16, 32, 64)},
    "float32": "f4",
    "float64": "f8",
    "bool": "u1",
}
FIELDS = st.lists(
    st.tuples(st.sampled_from(sorted(SCALARS)), st.sampled_from(["", "[3]", "[]", "[2]", "text"])),
    min_size=1,
    max_size=9,
)


@pytest.mark.slow
@given(
    fields=FIELDS,
    lengths=st.lists(st.integers(0, 5), min_size=3, max_size=3),
    ros1=st.booleans(),
    data=st.data(),
)
@settings(max_examples=100)
def test_any_definition_is_read_as_rosbags_writes_it(
    fields: Sequence[tuple[str, str]], lengths: list[int], ros1: bool, data: st.DataObject
) -> None:
    lines, wanted = [], []
    for k, (kind, many) in enumerate(fields):
        lines.append(f"string f{k}" if many == "text" else f"{kind}{many} f{k} # {k}")
        places = {"": [f"f{k}"], "[3]": [f"f{k}[2]"], "[2]": [f"f{k}[0]"]}
        wanted += places.get(many, [])
    text = "\n".join([*lines, "float64 CONSTANT=1.5", "uint8 last"])
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(text, "a_msgs/msg/Any"))
    messages, truth = [], []
    for length in lengths:
        values: dict[str, Any] = {"last": 9}
        for k, (kind, many) in enumerate(fields):
            number = data.draw(st.integers(0, 1))
            array = np.full({"[3]": 3, "[2]": 2}.get(many, length), number).astype(
                bool if kind == "bool" else SCALARS[kind]
            )
            one = bool(number) if kind == "bool" else float(number) if kind.startswith("float") else number
            values[f"f{k}"] = "ä" * length if many == "text" else one if many == "" else array
            truth += [number] if many in ("", "[3]", "[2]") else []
        message = store.types["a_msgs/msg/Any"](**values)
        made = store.serialize_ros1 if ros1 else store.serialize_cdr
        messages.append(bytes(made(message, "a_msgs/msg/Any")))
    row, found = read_columns(messages, parse_definition(text), [*wanted, "last"], ros1)
    assert row.tolist() == [0, 1, 2]
    assert found[:, -1].tolist() == [9, 9, 9]
    assert found[:, :-1].ravel().tolist() == truth
    cut = [message[:-9] for message in messages if len(message) > 20]
    assert not len(read_columns(cut, parse_definition(text), [*wanted, "last"], ros1)[0])


@given(text=st.text("uint8 floa64[]<=#\n/MSG:=xyz3.", max_size=300))
@settings(max_examples=300)
def test_any_text_as_a_definition(text: str) -> None:
    with contextlib.suppress(ValueError):
        definition = parse_definition(text)
        read_columns([b"\0\1\0\0" + bytes(40)] * 3, definition, [definition.fields[0].name], is_ros1=False)


@pytest.mark.parametrize("leaf", ["float32 x\n", ""])
def test_a_definition_within_itself_ends(leaf: str) -> None:
    text = "a/B b\n" + "=" * 80 + f"\nMSG: a/B\na/B b\na/B[9] c\n{leaf}"
    with pytest.raises(ValueError, match=r"too many lines|without fields"):
        parse_definition(text)


def test_an_array_that_is_shorter_than_it_should_be(tmp_path: Path) -> None:
    definition = COMBINED.replace("float32[3] gyro_rad", "float32[2] gyro_rad")
    messages = [{**combined(k), "gyro_rad": RADS[k, :2]} for k in range(N)]
    topics = {"/imu": ("px4_msgs/msg/SensorCombined", definition, messages)}
    with pytest.raises(UsageError, match=rf"{N} are not of the layout of px4_msgs/msg/SensorCombined"):
        open_bag(write_types(tmp_path / "a.mcap", topics, ARRIVALS))
