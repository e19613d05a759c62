"""Messages of ROS' type sensor_msgs/Imu as columns.

Behind the name of a frame, which is of any length, its layout is fixed: 37 numbers. So messages that are
alike in length are read at once; a library that knows every type takes some 20 µs for each.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

IMU_TYPES = ("sensor_msgs/Imu", "sensor_msgs/msg/Imu")
"""As ROS 1 and ROS 2 write it."""

Encoding = Literal["ros1", "cdr", "json", "protobuf"]

NUMBERS = 37
GYRO, GYRO_COVARIANCE = slice(13, 16), 16
ACCEL, ACCEL_COVARIANCE = slice(25, 28), 28
"""After an orientation (4) and its covariance (9)."""

UNKNOWN = -1.0
"""In the first place of a covariance: that quantity was not measured."""

LONGEST_PADDING = 7
CDR_HEAD = 4
"""Bytes before a message in CDR that say how it is written."""

PLAIN_CDR = {0: (">", 8), 1: ("<", 8), 6: (">", 4), 7: ("<", 4)}
"""Order of bytes and widest alignment, by the second byte of the head: XCDR 1 and 2."""


class Imu(NamedTuple):
    """Successive messages. stamp_ns, measured: (n,); gyro_rads, accel_ms2: (n, 3); measured_accel: (n,).

    row: (n,) which of those given each one is; those that are no such message are not here.
    measured, measured_accel: whether the message says that it holds that quantity.
    """

    row: NDArray[np.int64]
    stamp_ns: NDArray[np.int64]
    gyro_rads: NDArray[np.float64]
    accel_ms2: NDArray[np.float64]
    measured: NDArray[np.bool_]
    measured_accel: NDArray[np.bool_]


def read_imu(messages: Sequence[bytes], encoding: Encoding) -> Imu:
    """Read messages as they are in a bag, in their order."""
    length = np.fromiter(map(len, messages), np.int64, len(messages))
    rows, stamps, numbers = [], [], []
    for size in np.unique(length).tolist():
        alike = np.flatnonzero(length == size)
        data = np.frombuffer(b"".join([messages[i] for i in alike.tolist()]), np.uint8)
        found = _of_ros1 if encoding == "ros1" else _of_cdr
        for row, stamp_ns, values in found(data.reshape(len(alike), size)):
            rows.append(alike[row])
            stamps.append(stamp_ns)
            numbers.append(values)
    if not rows:
        rows, stamps, numbers = [np.empty(0, np.int64)], [np.empty(0, np.int64)], [np.empty((0, NUMBERS))]
    row = np.concatenate(rows)
    order = np.argsort(row, kind="stable")
    values = np.concatenate(numbers)[order]
    return Imu(
        row[order],
        np.concatenate(stamps)[order],
        values[:, GYRO],
        values[:, ACCEL],
        values[:, GYRO_COVARIANCE] != UNKNOWN,
        values[:, ACCEL_COVARIANCE] != UNKNOWN,
    )


_Found = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]
"""Rows that are messages, their stamps, and their numbers."""


def _of_ros1(data: NDArray[np.uint8]) -> list[_Found]:
    """Of messages alike in length (n, length): number, seconds, nanoseconds, a text, and the numbers."""
    if data.shape[1] < 16:
        return []
    head = np.ascontiguousarray(data[:, :16]).view("<u4").astype(np.int64)
    fits = np.flatnonzero(head[:, 3] == data.shape[1] - 16 - 8 * NUMBERS)
    if not len(fits):
        return []
    begin = data.shape[1] - 8 * NUMBERS
    return [(fits, _stamp_ns(head[fits, 1], head[fits, 2]), _numbers(data[fits, begin:], "<"))]


def _of_cdr(data: NDArray[np.uint8]) -> list[_Found]:
    """Of messages alike in length: a head, seconds, nanoseconds, a text, and the numbers, aligned."""
    if data.shape[1] < CDR_HEAD + 12:
        return []
    found = []
    for kind, (order, widest) in PLAIN_CDR.items():
        written_so = np.flatnonzero((data[:, 0] == 0) & (data[:, 1] == kind))
        if not len(written_so):
            continue
        head = np.ascontiguousarray(data[written_so, CDR_HEAD : CDR_HEAD + 12])
        seconds = head.view(f"{order}i4")[:, 0].astype(np.int64)
        _, nanoseconds, text = head.view(f"{order}u4").astype(np.int64).T
        begin = CDR_HEAD + -(-(12 + text) // widest) * widest
        padding = data.shape[1] - begin - 8 * NUMBERS
        for place in np.unique(begin[(padding >= 0) & (padding <= LONGEST_PADDING)]).tolist():
            fits = np.flatnonzero(begin == place)
            values = _numbers(data[written_so[fits], place : place + 8 * NUMBERS], order)
            found.append((written_so[fits], _stamp_ns(seconds[fits], nanoseconds[fits]), values))
    return found


def _stamp_ns(seconds: NDArray[np.int64], nanoseconds: NDArray[np.int64]) -> NDArray[np.int64]:
    return seconds * 1_000_000_000 + nanoseconds


def _numbers(data: NDArray[np.uint8], order: str) -> NDArray[np.float64]:
    return np.ascontiguousarray(data).view(f"{order}f8").astype(np.float64)
