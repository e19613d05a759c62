"""Finds a gyroscope's fields in the messages of a topic, states their units, and reads them.

The layouts of ROS's sensor_msgs/Imu and of PX4's message types are built in. For other types, the bag must
hold the definition.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.recording.bag_definition import LIST, Definition, Words, parse_definition, read_columns
from fltea.recording.bag_names import IS_IMU, Layout, Said, Texts, by_convention, named_layout
from fltea.recording.column_names import tells_sensors
from fltea.recording.one_sensor import as_word
from fltea.recording.sample_times import Floats, Ints, Marks
from fltea.records.records import AXES

Encoding = Literal["ros1", "cdr", "json", "protobuf"]

GYRO, ACCEL = "angular_velocity", "linear_acceleration"
_HEAD = "string header.frame_id\nfloat64[13] orientation\n"
_BODY = "".join(
    f"float64 {name}.x\nfloat64 {name}.y\nfloat64 {name}.z\nfloat64[9] {name}_covariance\n"
    for name in (GYRO, ACCEL)
)
IMU_ROS1 = f"uint32 header.seq\nuint32 header.stamp.sec\nuint32 header.stamp.nanosec\n{_HEAD}{_BODY}"
IMU_ROS2 = f"int32 header.stamp.sec\nuint32 header.stamp.nanosec\n{_HEAD}{_BODY}"

FRAME = "frame_id"
"""Header field for the name of the sensor's coordinate frame. Some programs store a count of images in it
instead.
"""

UNKNOWN = -1.0
"""Value of a covariance matrix's first element by which a message states that the quantity was not measured.
"""

FIFO = 32
"""Number of samples that a message of PX4's type SensorGyroFifo has room for."""

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
"""PX4's message types as its uORB documentation gives them, for bags without definitions.

Some types have several definitions, since releases of PX4 differ.
"""

PX4_PADDING = 3
"""Largest number of padding bytes at the end of a PX4 message. More bytes show a release of PX4 with other
fields.
"""

PX4_AXES = {"SensorCombined": "gyro_rad", "VehicleAngularVelocity": "xyz"}


class Imu(NamedTuple):
    """Numbers that were read from successive messages.

    `row`: index of each message in the batch (n,); messages that do not fit the layout are left out. `time`:
    times (n, k), in the k fields that the layout names. `gyro`, `accel`: (n, 3) in the file's units.
    `measured`, `measured_accel`: whether rates, and accelerations, were measured according to each message
    (n,). `tell`: for each field that distinguishes sensors, its values (n,).
    """

    row: Ints
    time: Floats
    gyro: Floats
    accel: Floats
    measured: NDArray[np.bool_]
    measured_accel: NDArray[np.bool_]
    tell: tuple[NDArray[np.str_], ...] = ()

    def rows(self, kept: Marks) -> "Imu":
        """Return the values of those messages that `kept` marks (n,); the field `tell` stays empty."""
        time, gyro, accel = self.time[kept], self.gyro[kept], self.accel[kept]
        return Imu(self.row[kept], time, gyro, accel, self.measured[kept], self.measured_accel[kept])


@lru_cache(maxsize=4096)
def ros_layout(kind: str, encoding: Encoding, schema: bytes, sensor: str | None = None) -> Layout | None:
    """Return the layout of a type of ROS 1 or 2; None if its messages hold no angular rates.

    `schema`: definition of the type in the format of `.msg` files, empty if unknown. `sensor`: the gyroscope
    to read if a message holds several.
    """
    package, _, name = kind.partition("/")
    name = name.removeprefix("msg/")
    if IS_IMU.fullmatch(kind):
        rate, accel = by_convention(kind)
        layout = named_layout([f"{part}.{axis}" for part in (GYRO, ACCEL) for axis in "xyz"], kind)
        assert layout is not None
        definition = parse_definition(IMU_ROS1 if encoding == "ros1" else IMU_ROS2)
        time, more = (
            ("header.stamp.sec", "header.stamp.nanosec"),
            (f"{GYRO}_covariance[0]", f"{ACCEL}_covariance[0]"),
        )
        layout = layout._replace(time=time, time_s=(1.0, 1e-9), rate=rate, accel_unit=accel, more=more)
        return layout._replace(definitions=(definition,), tell=_telling(definition))
    try:
        own = parse_definition(schema.decode(errors="replace")) if schema else None
    except (ValueError, RecursionError):
        own = None
    if package == "px4_msgs" and name in PX4:
        return _px4_layout(name, own)
    if own is None:
        return None
    texts = {place: field.said for field in own.fields for place in _places(field.name, field.many)}
    words = Texts(lambda place: (*texts[place], own.said))
    layout = named_layout(list(texts), kind, words, sensor)
    return layout and layout._replace(definitions=(own,), is_known=False, tell=_telling(own))


def _telling(definition: Definition) -> tuple[str, ...]:
    """Return the names of fields that may distinguish sensors. They hold whole numbers or texts."""
    fields = definition.fields
    kinds = {None: "iu", LIST: "u"}
    return tuple(
        field.name
        for field in fields
        if field.code[0] in kinds.get(field.many, "")
        and (tells_sensors(field.name) or field.name.rpartition(".")[2] == FRAME)
    )


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
        tell=_telling(definitions[0]),
        more=("dt", "scale", "samples") if name == "SensorGyroFifo" else (),
    )


def read_ros(
    messages: Sequence[bytes], layout: Layout, *, is_ros1: bool, check: Callable[[], None] = lambda: None
) -> Imu:
    """Read ROS messages in the bag's order. `check`: function that is called often and may raise an error."""
    is_fifo = "samples" in layout.more
    gyro = [f"{axis}[{i}]" for axis in layout.gyro for i in range(FIFO)] if is_fifo else [*layout.gyro]
    wanted = [*layout.time, *gyro, *layout.accel, *layout.more, *layout.tell]
    row, values, words = np.empty(0, np.int64), np.empty((0, len(wanted))), Words()
    for definition in layout.definitions:
        row, values = read_columns(messages, definition, wanted, is_ros1, words, check)
        if len(row):
            break
    values, tell = np.split(values, [len(wanted) - len(layout.tell)], axis=1)
    if is_fifo:
        message, values = _samples_of_fifo(values)
        row, tell, gyro = row[message], tell[message], gyro[: len(AXES)]
    parts = np.cumsum([len(layout.time), len(gyro), len(layout.accel)])
    time, rates, accel, more = np.split(values, parts, axis=1)
    known = more != UNKNOWN if layout.more and not is_fifo else np.ones((len(row), 2), np.bool_)
    if not layout.accel:
        accel, known[:, 1] = np.zeros_like(rates), False
    told = tuple(_as_texts(column, name, words) for name, column in zip(layout.tell, tell.T, strict=True))
    return Imu(row, time, rates, accel, known[:, 0], known[:, 1], told)


def _as_texts(column: Floats, name: str, words: Words) -> NDArray[np.str_]:
    """Return the values of a field that distinguishes sensors, as texts."""
    numbers, places = np.unique(column, return_inverse=True)
    known = words.of(name)
    return np.array([known[int(one)] if known else as_word(one) for one in numbers], np.str_)[places]


def _samples_of_fifo(values: Floats) -> tuple[Ints, Floats]:
    """Return the index of the message, the time [µs] and the rates [rad/s] of each sample.

    A message holds several samples.

    `values`: columns with the time of the last sample [µs], the samples of each axis, the sampling period
    [µs], the scale [rad/s], and the number of samples.
    """
    dt_us, scale, count = values[:, -3], values[:, -2], values[:, -1]
    kept = (count >= 1) & (count <= FIFO)
    many = count[kept].astype(np.int64)
    message = np.repeat(np.flatnonzero(kept), many)
    nth = np.arange(len(message)) - np.repeat(np.cumsum(many) - many, many)
    time_us = values[message, 0] - (count[message] - 1 - nth) * dt_us[message]
    axes = values[:, 1:-3].reshape(len(values), len(AXES), FIFO)
    return message, np.column_stack([time_us, axes[message, :, nth] * scale[message, np.newaxis]])
