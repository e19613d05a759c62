"""Messages of MCAP files that are no ROS', objects of JSON or of protobuf, as those of sensor_msgs/Imu.

Their fields are found by their names, as columns of text are. Angular rates whose names state no unit are
taken for rad/s, as programs for robots write them.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np

from fltea.recording.bag_imu import Imu
from fltea.recording.column_names import (
    accel_axis_of,
    accel_unit_of,
    axis_of,
    is_time,
    rate_unit_of,
    split_seconds,
    time_unit_of,
)
from fltea.recording.files import PER_UNIT
from fltea.recording.sample_times import LONGEST_S, SECONDS
from fltea.recording.text_labels import decode_object
from fltea.recording.text_times import with_seconds
from fltea.settings.extras import load

NS = 1_000_000_000
Decoder = Callable[[bytes], dict[str, Any]]


def read_objects(messages: Sequence[bytes], encoding: str, kind: str, schema: bytes) -> Imu:
    """Read messages as they are in a file, in their order; what is none is left out.

    kind, schema: of the messages, by the channel.
    """
    decode = decode_object if encoding == "json" else decoder_of(kind, schema)
    rows, stamps, numbers = [], [], []
    for row, message in enumerate(messages):
        try:
            found = decode(message)
        except (ValueError, RecursionError):  # msgspec's and protobuf's errors are ValueErrors
            continue
        gyro = _triple(
            found, axis_of, lambda name: PER_UNIT[rate_unit_of(name) or "rad/s"] / PER_UNIT["rad/s"]
        )
        if gyro is not None:
            accel = _triple(found, accel_axis_of, lambda name: accel_unit_of(name) or 1.0)
            rows.append(row)
            stamps.append(_stamp_ns(found))
            numbers.append([*gyro, *(accel or [np.nan] * 3), accel is not None])
    values = np.array(numbers, np.float64).reshape(-1, 7)
    measured = np.ones(len(rows), np.bool_)
    has_accel = values[:, 6] > 0
    accel_ms2 = np.where(has_accel[:, np.newaxis], values[:, 3:6], 0.0)
    stamp_ns = np.array(stamps, np.int64)
    return Imu(np.array(rows, np.int64), stamp_ns, values[:, :3], accel_ms2, measured, has_accel)


@lru_cache(maxsize=8)
def decoder_of(kind: str, schema: bytes) -> Decoder:
    """Return what decodes messages that a FileDescriptorSet describes.

    Raises:
        UsageError: the library is not installed.
    """
    load("google.protobuf", "google", "ros", "Messages of protobuf need")
    from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory

    pool = descriptor_pool.DescriptorPool()
    try:
        for file in descriptor_pb2.FileDescriptorSet.FromString(schema).file:
            pool.Add(file)
        message_class = message_factory.GetMessageClass(pool.FindMessageTypeByName(kind))
    except Exception as error:  # whatever protobuf raises on a schema that is damaged
        reason = str(error)

        def refuse(_: bytes) -> dict[str, Any]:
            raise ValueError(reason)

        return refuse

    def decode(data: bytes) -> dict[str, Any]:
        try:
            found = json_format.MessageToDict(
                message_class.FromString(data),
                preserving_proto_field_name=True,
                always_print_fields_with_no_presence=True,
            )
        except Exception as error:  # DecodeError has no base of its own
            raise ValueError(str(error)) from error
        return decode_object(msgspec.json.encode(found))

    return decode


def _triple(
    found: dict[str, Any], axis_in: Callable[[str], str | None], scale: Callable[[str], float]
) -> list[float] | None:
    """Three numbers of one sensor; None if they are not all there."""
    axes = {axis: name for name in found if (axis := axis_in(name)) is not None}
    values = [found[axes[axis]] for axis in "xyz" if axis in axes]
    if len(values) != 3 or not all(isinstance(value, int | float) for value in values):
        return None
    return [float(value) * scale(axes[axis]) for value, axis in zip(values, "xyz", strict=True)]


def _stamp_ns(found: dict[str, Any]) -> int:
    """The time that a message states; 0 without one, and then that of its arrival is taken."""
    names = list(found)
    for whole, (fine, unit_s) in split_seconds(names).items():
        try:
            return int(found[names[whole]]) * NS + round(int(found[names[fine]]) * unit_s * NS)
        except (TypeError, ValueError):
            return 0
    for name in filter(is_time, names):
        value = found[name]
        text = with_seconds(str(value))  # protobuf gives whole numbers of 64 bits as text, too
        if text.replace(".", "", 1).isdigit():
            is_date = text != str(value)
            seconds = float(text) * (1.0 if is_date else SECONDS[time_unit_of(name) or "s"])
            return round(seconds * NS) if seconds < LONGEST_S else 0
    return 0
