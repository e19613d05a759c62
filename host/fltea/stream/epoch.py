"""Define the data about an epoch of a device: its beginning, its records, and the state of the estimators.

An epoch is a stretch of samples without a restart of the estimators.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec

from fltea.estimator.snapshot import OnlineState
from fltea.records.block import Block
from fltea.records.records import AnyRecord, EstimatorInfo, Hello
from fltea.records.sensor_kind import ACCELEROMETER, GYROSCOPE, SensorKind
from fltea.records.stats import AxisStats, DeviceEstimatorStats, TrackerStats

NEVER = 2**62
"""Stands for "never" where a sample's number or a time [ns] is asked for: no sample has this number, and none
arrives at this time (host/native/device.hpp).
"""


class Moment(NamedTuple):
    """Number, epoch, and times of a sample, as records state them."""

    seq: int
    epoch: int
    device_us: int
    host_ns: int


class Notice(NamedTuple):
    """Kind and text of an `error` record.

    `host_ns`: time of the record on the source's monotonic clock [ns].
    """

    kind: str
    message: str
    host_ns: int


Item = AnyRecord | Block | Notice
"""What the outputs receive. A notice is first converted into an `error` record."""


class Beginning(NamedTuple):
    """What is known about the samples of an epoch when it begins.

    `gyro_axes`: number of axes of the gyroscope in the samples. `accel`: whether the samples contain an
    accelerometer. `saved`: saved state from which to continue.
    `missing`: number of samples lost just before the epoch, as far as it is known.
    """

    hello: Hello
    gyro_axes: int
    accel: bool
    saved: "Saved | None" = None
    missing: int = 0

    def axes(self, wanted: Sequence[str] | None) -> dict[SensorKind, dict[str, int]]:
        """Return for each sensor, by the names of its wanted axes, the index of each axis's column.

        `wanted`: names of these axes; None stands for all axes of the gyroscope. A sensor without a wanted
        axis is left out.
        """
        chosen = GYROSCOPE.axes if wanted is None else wanted
        found = {
            kind: {axis: i for i, axis in enumerate(available) if axis in chosen}
            for kind, available in self._available().items()
        }
        return {kind: axes for kind, axes in found.items() if axes}

    def absent(self, wanted: Sequence[str] | None) -> list[str]:
        """Return the wanted axes that the samples do not contain."""
        available = [axis for axes in self._available().values() for axis in axes]
        return [axis for axis in wanted or () if axis not in available]

    def _available(self) -> dict[SensorKind, tuple[str, ...]]:
        return {
            GYROSCOPE: GYROSCOPE.axes[: self.gyro_axes],
            ACCELEROMETER: ACCELEROMETER.axes if self.accel else (),
        }


class SavedSensor(NamedTuple):
    """The saved state of one sensor: filters, spectral sums, and bias tracker. What was not saved is None."""

    filters: OnlineState | None
    sums: bytes | None
    tracks: bytes | None


SAVED_FIELDS = ("{}", "{}_fit", "{}_track")
"""The fields of `Saved` that hold the state of one sensor, in the order of the fields of `SavedSensor`. With
the sensor's name in place of {}, they are for example "gyro", "gyro_fit" and "gyro_track".
"""


class Saved(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Saved state from which the sensors of a device continue. A part that was not saved is None.

    `gyro`, `accel`: state of the filters. `gyro_fit`, `accel_fit`: spectral sums of the live fits.
    `gyro_track`, `accel_track`: state of the bias trackers.
    """

    gyro: OnlineState | None = None
    accel: OnlineState | None = None
    gyro_fit: bytes | None = None
    accel_fit: bytes | None = None
    gyro_track: bytes | None = None
    accel_track: bytes | None = None

    def of(self, kind: SensorKind) -> SavedSensor:
        """Return the saved state of one sensor."""
        return SavedSensor(*(getattr(self, field.format(kind.name)) for field in SAVED_FIELDS))


@dataclass
class Standing:
    """State of a device's estimators, for the records `Stats` and `Epoch`."""

    startup_remaining: int = 0
    axes: dict[str, AxisStats] = field(default_factory=dict)
    filters: dict[SensorKind, EstimatorInfo] = field(default_factory=dict)
    device: DeviceEstimatorStats | None = None
    fit_period_s: float | None = None
    tracker: dict[str, TrackerStats] = field(default_factory=dict)

    def with_board(self, of_board: "Standing") -> "Standing":
        """Return this state, to which the board's state is added for axes that only the board estimates."""
        return Standing(
            max(self.startup_remaining, of_board.startup_remaining),
            of_board.axes | self.axes,
            of_board.filters | self.filters,
            of_board.device,
            self.fit_period_s,
            self.tracker,
        )
