"""Define what an epoch of a device begins with, what it yields, and the state of its estimators.

An epoch is a stretch of samples without a restart of the estimators.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec

from fltea.estimator.snapshot import OnlineState
from fltea.records.block import Block
from fltea.records.records import ACCEL_AXES, AXES, AnyRecord, EstimatorInfo, Hello
from fltea.records.stats import AxisStats, DeviceEstimatorStats, TrackerStats

NEVER = 2**62
"""A number that no sample has, and a time at which no sample comes; as in host/native/device.hpp."""


class Moment(NamedTuple):
    """Number, epoch, and times of a sample, as records state them."""

    seq: int
    epoch: int
    device_us: int
    host_ns: int


class Notice(NamedTuple):
    """Kind and text of an `error` record; `host_ns`: its time on the source's monotonic clock [ns]."""

    kind: str
    message: str
    host_ns: int


Item = AnyRecord | Block | Notice
"""What the outputs receive, except that a notice becomes an `error` record first."""


class Beginning(NamedTuple):
    """What is known about the samples of an epoch when it begins.

    `gyro_axes`, `accel`: the axes of each sensor in the samples. `saved`: saved state from which to continue.
    `missing`: number of samples lost just before the epoch, as far as it is known.
    """

    hello: Hello
    gyro_axes: int
    accel: bool
    saved: "Saved | None" = None
    missing: int = 0

    def axes(self, wanted: Sequence[str] | None) -> tuple[dict[str, int], dict[str, int]]:
        """Return both sensors' columns of the axes in `wanted`; None means all axes of the gyroscope."""
        gyro, accel = AXES[: self.gyro_axes], ACCEL_AXES if self.accel else ()
        return (
            {axis: i for i, axis in enumerate(gyro) if wanted is None or axis in wanted},
            {axis: i for i, axis in enumerate(accel) if axis in (wanted or ())},
        )

    def absent(self, wanted: Sequence[str] | None) -> list[str]:
        """Return the wanted axes that the samples do not contain."""
        available = AXES[: self.gyro_axes] + (ACCEL_AXES if self.accel else ())
        return [axis for axis in wanted or () if axis not in available]


class Saved(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Saved state from which the sensors of a device continue; None for a part that was not saved.

    `gyro`, `accel`: state of the filters. `gyro_fit`, `accel_fit`: spectral sums of the live fits.
    `gyro_track`, `accel_track`: state of the bias trackers.
    """

    gyro: OnlineState | None = None
    accel: OnlineState | None = None
    gyro_fit: bytes | None = None
    accel_fit: bytes | None = None
    gyro_track: bytes | None = None
    accel_track: bytes | None = None


@dataclass
class Standing:
    """State of a device's estimators, for `Stats` and `Epoch`."""

    startup_remaining: int = 0
    axes: dict[str, AxisStats] = field(default_factory=dict)
    gyro: EstimatorInfo | None = None
    accel: EstimatorInfo | None = None
    device: DeviceEstimatorStats | None = None
    fit_period_s: float | None = None
    tracker: dict[str, TrackerStats] = field(default_factory=dict)

    def with_board(self, of_board: "Standing") -> "Standing":
        """Return this state, with the board's state for each axis that this computer does not estimate."""
        return Standing(
            max(self.startup_remaining, of_board.startup_remaining),
            of_board.axes | self.axes,
            self.gyro or of_board.gyro,
            self.accel,
            of_board.device,
            self.fit_period_s,
            self.tracker,
        )
