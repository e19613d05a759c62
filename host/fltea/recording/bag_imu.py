"""Where messages of a topic hold a gyroscope's numbers, what is known of these, and the numbers themselves.

Of ROS' sensor_msgs/Imu and of PX4's types that is known; of all others the definition in the bag tells it.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.recording.bag_definition import Definition, parse_definition, read_columns
from fltea.recording.column_names import (
    accel_axis_of,
    accel_unit_of,
    axis_of,
    is_time,
    named_axis,
    rate_unit_of,
    split_seconds,
    time_unit_of,
)
from fltea.recording.reading import Evidence
from fltea.recording.sample_times import SECONDS, Floats, Ints
from fltea.recording.units import accel_unit, rate_unit, time_unit
from fltea.records.errors import UsageError
from fltea.records.records import AXES

Encoding = Literal["ros1", "cdr", "json", "protobuf"]
Texts = Callable[[str], Iterable[str]]
"""What describes a field in words, the nearest first."""

GYRO, ACCEL = "angular_velocity", "linear_acceleration"
_HEAD = "string header.frame_id\nfloat64[13] orientation\n"
_BODY = "".join(
    f"float64 {name}.x\nfloat64 {name}.y\nfloat64 {name}.z\nfloat64[9] {name}_covariance\n"
    for name in (GYRO, ACCEL)
)
IMU_ROS1 = f"uint32 header.seq\nuint32 header.stamp.sec\nuint32 header.stamp.nanosec\n{_HEAD}{_BODY}"
IMU_ROS2 = f"int32 header.stamp.sec\nuint32 header.stamp.nanosec\n{_HEAD}{_BODY}"
IS_IMU = re.compile(r"(?:ros\.)?sensor_msgs[./](?:msg[./])?Imu", re.ASCII)
"""As ROS 1, ROS 2 and what turns their messages into JSON or protobuf call the type."""

UNKNOWN = -1.0
"""In the first place of a covariance: that quantity was not measured."""

FIFO = 32
"""Places for samples in a message of SensorGyroFifo."""

_TIMES = "uint64 timestamp\nuint64 timestamp_sample\n"
PX4 = {
    "SensorCombined": (
        "uint64 timestamp\nfloat32[3] gyro_rad\nuint32 gyro_integral_dt\n"
        "int32 accelerometer_timestamp_relative\nfloat32[3] accelerometer_m_s2\n"
        "uint32 accelerometer_integral_dt\nuint8 accelerometer_clipping",
    ),
    "SensorGyro": (
        f"{_TIMES}uint32 device_id\nfloat32 x\nfloat32 y\nfloat32 z\nfloat32 temperature\n"
        "uint32 error_count\nuint8[3] clip_counter\nuint8 samples",
    ),
    "VehicleAngularVelocity": (
        f"{_TIMES}float32[3] xyz",
        f"{_TIMES}float32[3] xyz\nfloat32[3] xyz_derivative",
    ),
    "SensorGyroFifo": (
        f"{_TIMES}uint32 device_id\nfloat32 dt\nfloat32 scale\nuint8 samples\n"
        f"int16[{FIFO}] x\nint16[{FIFO}] y\nint16[{FIFO}] z",
    ),
}
"""Types of px4_msgs, as PX4 documents its uORB messages; releases differ. For bags without definitions."""

LETTERS = ("x", "y", "z")
_PLACE = re.compile(r"(.+)(?:\.([xyz])|\[([012])\])")
MOST_CHARS = 4000
"""Of a text in which a unit is looked for."""

PX4_PADDING = 3
"""Bytes; a release that has a field more before the axes has more."""

PX4_AXES = {"SensorCombined": "gyro_rad", "VehicleAngularVelocity": "xyz"}


class Said(NamedTuple):
    """A unit, by what it is known, and where that stands."""

    unit: str
    evidence: Evidence
    why: str


class Layout(NamedTuple):
    """What messages of a topic hold: the names of their numbers.

    time: whole seconds and what is added to them, or one number, or none. time_s: seconds in one of each;
    empty where nothing says it. rate, accel_unit: None where nothing says it. by: why these are the axes.
    unread: other fields that look like a gyroscope's. definitions: of ROS' types; the first that fits counts.
    is_known: whether the type is one that is made for this. more: what else is read.
    """

    gyro: tuple[str, ...]
    accel: tuple[str, ...]
    time: tuple[str, ...]
    time_s: tuple[float, ...]
    rate: Said | None
    accel_unit: Said | None
    by: Said
    unread: tuple[str, ...] = ()
    definitions: tuple[Definition, ...] = ()
    is_known: bool = True
    more: tuple[str, ...] = ()


class Imu(NamedTuple):
    """Successive messages. time: (n, k), as the layout names them. gyro, accel: (n, 3), in the file's units.

    row: (n,) which of those given each one is; those that are no such message are not here.
    measured, measured_accel: whether the message says that it holds that quantity.
    """

    row: Ints
    time: Floats
    gyro: Floats
    accel: Floats
    measured: NDArray[np.bool_]
    measured_accel: NDArray[np.bool_]


def title(names: Sequence[str]) -> str:
    """Three names, for a person: `angular_velocity.x, .y, .z`."""
    begin = names[0][:-1]
    if begin and all(name[:-1] == begin for name in names) and begin[-1] in "._":
        return ", ".join([names[0], *(f"{begin[-1]}{name[-1]}" for name in names[1:])])
    return ", ".join(names)


@lru_cache(maxsize=4096)
def ros_layout(kind: str, encoding: Encoding, schema: bytes) -> Layout | None:
    """Return the layout of a type of ROS 1 or 2; None: its messages hold no gyroscope's numbers.

    schema: its definition, in the form of `.msg` files; empty: there is none.
    """
    package, _, name = kind.partition("/")
    name = name.removeprefix("msg/")
    if IS_IMU.fullmatch(kind):
        rate, accel = _by_convention(kind)
        layout = named_layout([f"{part}.{axis}" for part in (GYRO, ACCEL) for axis in "xyz"], kind)
        assert layout is not None
        definition = parse_definition(IMU_ROS1 if encoding == "ros1" else IMU_ROS2)
        time, more = (
            ("header.stamp.sec", "header.stamp.nanosec"),
            (f"{GYRO}_covariance[0]", f"{ACCEL}_covariance[0]"),
        )
        return layout._replace(
            time=time, time_s=(1.0, 1e-9), rate=rate, accel_unit=accel, definitions=(definition,), more=more
        )
    try:
        own = parse_definition(schema.decode(errors="replace")) if schema else None
    except (ValueError, RecursionError):
        own = None
    if package == "px4_msgs" and name in PX4:
        return _px4_layout(name, own)
    if own is None:
        return None
    texts = {place: field.said for field in own.fields for place in _places(field.name, field.many)}
    layout = named_layout(list(texts), kind, lambda place: (*texts[place], own.said))
    return None if layout is None else layout._replace(definitions=(own,), is_known=False)


def _places(name: str, count: int | None) -> list[str]:
    return (
        [name] if count is None else [f"{name}[{i}]" for i in range(len(AXES) if count == len(AXES) else 0)]
    )


def _px4_layout(name: str, own: Definition | None) -> Layout:
    def axes(array: str) -> tuple[str, ...]:
        return tuple(f"{array}[{i}]" for i in range(3))

    definitions = (
        (own,)
        if own is not None
        else tuple(parse_definition(text)._replace(padding=PX4_PADDING) for text in PX4[name])
    )
    time = (
        "timestamp_sample"
        if any(f.name == "timestamp_sample" for f in definitions[0].fields)
        else "timestamp"
    )
    by = Said("", "dialect", f"px4_msgs/{name}")
    is_combined = name == "SensorCombined"
    return Layout(
        axes(PX4_AXES[name]) if name in PX4_AXES else ("x", "y", "z"),
        axes("accelerometer_m_s2") if is_combined else (),
        (time,),
        (1e-6,),
        by._replace(unit="rad/s"),
        by._replace(unit="m/s^2") if is_combined else None,
        by,
        definitions=definitions,
        more=("dt", "scale", "samples") if name == "SensorGyroFifo" else (),
    )


def _by_convention(kind: str) -> tuple[Said | None, Said | None]:
    if IS_IMU.fullmatch(kind) is None:
        return None, None
    why = f"{kind} (REP 103)"
    return Said("rad/s", "convention", why), Said("m/s^2", "convention", why)


def named_layout(names: Sequence[str], kind: str, texts: Texts = lambda _: ()) -> Layout | None:
    """Return what fields with these names are; None: they have no gyroscope's three axes.

    kind: the type. texts: what describes a field in words.

    Raises:
        UsageError: the axes of one sensor state different units.
    """
    gyro, others = _triple(names, axis_of)
    if not gyro:
        return None
    accel, _ = _triple(names, accel_axis_of)
    rate, accel_said = _by_convention(kind)
    time, time_s = _clock(names, texts)
    accel_names = {name: _accel_name(ms2) for name in accel if (ms2 := accel_unit_of(_spoken(name)))}
    return Layout(
        gyro,
        accel,
        time,
        time_s,
        _stated(
            gyro, {name: unit for name in gyro if (unit := rate_unit_of(_spoken(name)))}, texts, rate_unit
        )
        or rate,
        _stated(accel, accel_names, texts, lambda text: text if accel_unit(text) else None) or accel_said,
        Said("", "convention", kind) if rate is not None else Said("", "stated", "their names"),
        others,
    )


def _spoken(name: str) -> str:
    """The name of an axis in an object or array, as a column would be called: `gyro_dps.x` is gyro_x_dps."""
    found = _PLACE.fullmatch(name)
    return name if found is None else named_axis(found[1], "xyz012".index(found[2] or found[3]) % len(AXES))


def _triple(
    names: Sequence[str], axis_in: Callable[[str], str | None]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The first name of each axis, x, y, z, if all are there; and the others."""
    found = [(axis, name) for name in names if (axis := axis_in(_spoken(name))) is not None]
    axes = dict(reversed(found))
    if not {*axes} >= {*LETTERS}:
        return (), ()
    three = tuple(axes[axis] for axis in LETTERS)
    return three, tuple(name for _, name in found if name not in three)


def _clock(names: Sequence[str], texts: Texts) -> tuple[tuple[str, ...], tuple[float, ...]]:
    for whole, (fine, unit_s) in split_seconds(names).items():
        return (names[whole], names[fine]), (1.0, unit_s)
    for name in filter(is_time, names):
        said = time_unit_of(name) or _in_words([name], texts, time_unit)
        return (name,), (SECONDS[said],) if said in SECONDS else ()
    return (), ()


def _stated(
    names: Sequence[str], by_name: dict[str, str], texts: Texts, unit_of: Callable[[str], str | None]
) -> Said | None:
    """The unit that all names state, or what describes them does."""
    if len({*by_name.values()}) > 1:
        units = ", ".join(f"{name} in {unit}" for name, unit in by_name.items())
        raise UsageError(f"the axes of one sensor are in different units: {units}.")
    if by_name:
        return Said(next(iter(by_name.values())), "stated", f"the name {next(iter(by_name))}")
    unit = _in_words(names, texts, unit_of) if names else None
    return None if unit is None else Said(unit, "stated", f"what the schema says of {title(names)}")


def _in_words(names: Sequence[str], texts: Texts, unit_of: Callable[[str], str | None]) -> str | None:
    """The unit that the nearest text on these fields names, if it names one alone, and the same for all."""
    found = set()
    for name in names:
        units = filter(None, (units_in(text, unit_of) for text in texts(name)))
        found.add(frozenset(next(units, set())))
    (only,) = found if len(found) == 1 else (frozenset(),)
    return next(iter(only)) if len(only) == 1 else None


def units_in(text: str, unit_of: Callable[[str], str | None]) -> set[str]:
    """Return the units that a text in words names, up to three words long."""
    words = re.findall(r"[^\s,;:()\[\]]+", text[:MOST_CHARS])
    found, taken = set[str](), set[int]()
    for size in (3, 2, 1):
        for at in range(len(words) - size + 1):
            unit = unit_of(" ".join(words[at : at + size]).rstrip("."))
            if unit is not None and at not in taken:
                found.add(unit)
                taken.update(range(at, at + size))
    return found


def _accel_name(ms2: float) -> str:
    return next(
        (name for name in ("m/s^2", "g", "mg", "mm/s^2") if accel_unit(name) == ms2), f"{ms2:g} m/s^2"
    )


def read_ros(messages: Sequence[bytes], layout: Layout, *, is_ros1: bool) -> Imu:
    """Read messages as they are in a bag, in their order."""
    is_fifo = "samples" in layout.more
    gyro = [f"{axis}[{i}]" for axis in layout.gyro for i in range(FIFO)] if is_fifo else [*layout.gyro]
    wanted = [*layout.time, *gyro, *layout.accel, *layout.more]
    row, values = np.empty(0, np.int64), np.empty((0, len(wanted)))
    for definition in layout.definitions:
        row, values = read_columns(messages, definition, wanted, is_ros1)
        if len(row):
            break
    if is_fifo:
        row, values = _samples_of_fifo(row, values)
        gyro = gyro[: len(AXES)]
    parts = np.cumsum([len(layout.time), len(gyro), len(layout.accel)])
    time, rates, accel, more = np.split(values, parts, axis=1)
    known = more != UNKNOWN if layout.more and not is_fifo else np.ones((len(row), 2), np.bool_)
    if not layout.accel:
        accel, known[:, 1] = np.zeros_like(rates), False
    return Imu(row, time, rates, accel, known[:, 0], known[:, 1])


def _samples_of_fifo(row: Ints, values: Floats) -> tuple[Ints, Floats]:
    """One row a sample, of: µs of the last, places for each axis, µs between two, rad/s in 1, how many."""
    dt_us, scale, count = values[:, -3], values[:, -2], values[:, -1]
    kept = (count >= 1) & (count <= FIFO)
    many = count[kept].astype(np.int64)
    message = np.repeat(np.flatnonzero(kept), many)
    nth = np.arange(len(message)) - np.repeat(np.cumsum(many) - many, many)
    time_us = values[message, 0] - (count[message] - 1 - nth) * dt_us[message]
    axes = values[:, 1:-3].reshape(len(values), len(AXES), FIFO)
    return row[message], np.column_stack([time_us, axes[message, :, nth] * scale[message, np.newaxis]])
