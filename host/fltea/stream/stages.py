"""What a stage of the pipeline is, and what it gets when an epoch begins."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import msgspec

from fltea.estimator.snapshot import OnlineState
from fltea.records.block import Block
from fltea.records.events import Event, Ints, RawBlock
from fltea.records.records import ACCEL_AXES, AXES, AnyRecord, EstimatorInfo, Hello
from fltea.records.stats import AxisStats, DeviceEstimatorStats, TrackerStats

NEVER = 2**62
"""No sample has this number, and none comes at this time."""


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
"""What a stage gives."""


class Beginning(NamedTuple):
    """What a stage gets when an epoch begins.

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


class Saved(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the stages of a device need to go on; None where there is none.

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
    """How a stage gets on; the pipeline puts the stages' together for `Stats` and `Epoch`."""

    startup_remaining: int = 0
    axes: dict[str, AxisStats] = field(default_factory=dict)
    gyro: EstimatorInfo | None = None
    accel: EstimatorInfo | None = None
    device: DeviceEstimatorStats | None = None
    fit_period_s: float | None = None
    tracker: dict[str, TrackerStats] = field(default_factory=dict)


class Stage:
    """Takes samples in blocks, and gives them on with what it makes of them."""

    def begin(self, beginning: Beginning) -> None:
        """Begin an epoch.

        Raises:
            ValueError: settings, or a snapshot, that it cannot begin with.
        """

    def bridge(self, count: int) -> None:
        """Bridge the samples for which the program stood still, at the beginning of an epoch that goes on."""

    def on_block(self, block: Block, host_ns: Ints, missing: int) -> Iterator[Item]:
        """Take samples; host_ns (n,): their arrival, monotonic. missing: how many were lost just before."""
        raise NotImplementedError

    def on_event(self, event: Event) -> Iterator[Item]:
        """Take anything else that the source says; most stages need nothing of it."""
        return iter(())

    def forget(self) -> None:
        """Believe nothing of samples until now: the device, its boot or its sensor may be another."""

    def standing(self) -> Standing:
        """Return how the stage gets on."""
        return Standing()

    def save(self) -> dict[str, Any]:
        """Return what the stage needs to go on, by the fields of `Saved`."""
        return {}


def through(stage: Stage, items: Iterable[Item], raw: RawBlock, missing: int) -> Iterator[Item]:
    """Let a stage take the blocks among what the one before it gives."""
    begin = 0
    for item in items:
        if isinstance(item, Block):
            end = begin + len(item)
            yield from stage.on_block(item, raw.host_ns[begin:end], missing if begin == 0 else 0)
            begin = end
        else:
            yield item
