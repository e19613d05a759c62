"""What an epoch of a device begins with, what comes out of it, and how it stands."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec

from fltea.estimator.snapshot import OnlineState
from fltea.records.block import Block
from fltea.records.records import ACCEL_AXES, AXES, AnyRecord, EstimatorInfo, Hello
from fltea.records.stats import AxisStats, DeviceEstimatorStats, TrackerStats

NEVER = 2**62
"""No sample has this number, and none comes at this time; as of host/native/device.hpp."""


class Moment(NamedTuple):
    """Number, epoch, and times of a sample, as records state them."""

    seq: int
    epoch: int
    device_us: int
    host_ns: int


class Notice(NamedTuple):
    """Kind and text of an `error` record; host_ns: when, on the source's monotonic clock."""

    kind: str
    message: str
    host_ns: int


Item = AnyRecord | Block | Notice
"""What goes on to the outputs, but for a notice, which becomes an `error` record."""


class Beginning(NamedTuple):
    """What is known of the samples of an epoch when it begins.

    gyro_axes, accel: what its samples hold. saved: what to go on from. missing: samples lost just before, as
    far as anybody knows.
    """

    hello: Hello
    gyro_axes: int
    accel: bool
    saved: "Saved | None" = None
    missing: int = 0

    def axes(self, wanted: Sequence[str] | None) -> tuple[dict[str, int], dict[str, int]]:
        """Axes of both sensors and their columns, as `channels` wants them; None: the gyroscope's."""
        gyro, accel = AXES[: self.gyro_axes], ACCEL_AXES if self.accel else ()
        return (
            {axis: i for i, axis in enumerate(gyro) if wanted is None or axis in wanted},
            {axis: i for i, axis in enumerate(accel) if axis in (wanted or ())},
        )

    def absent(self, wanted: Sequence[str] | None) -> list[str]:
        """Return which of the wanted axes there are not."""
        available = AXES[: self.gyro_axes] + (ACCEL_AXES if self.accel else ())
        return [axis for axis in wanted or () if axis not in available]


class Saved(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the sensors of a device need to go on; None where there is none.

    gyro, accel: the filters. gyro_fit, accel_fit: sums of the live fits. gyro_track, accel_track: what the
    trackers know.
    """

    gyro: OnlineState | None = None
    accel: OnlineState | None = None
    gyro_fit: bytes | None = None
    accel_fit: bytes | None = None
    gyro_track: bytes | None = None
    accel_track: bytes | None = None


@dataclass
class Standing:
    """How the estimators of a device get on, for `Stats` and `Epoch`."""

    startup_remaining: int = 0
    axes: dict[str, AxisStats] = field(default_factory=dict)
    gyro: EstimatorInfo | None = None
    accel: EstimatorInfo | None = None
    device: DeviceEstimatorStats | None = None
    fit_period_s: float | None = None
    tracker: dict[str, TrackerStats] = field(default_factory=dict)

    def fit_worker(self, of_board: "Standing") -> "Standing":
        """Return this computer's with the board's, which counts where this computer estimates nothing."""
        return Standing(
            max(self.startup_remaining, of_board.startup_remaining),
            of_board.axes | self.axes,
            self.gyro or of_board.gyro,
            self.accel,
            of_board.device,
            self.fit_period_s,
            self.tracker,
        )
