"""The records that the program publishes, units in their names.

As JSON each is one object whose first key is `class` (host/docs/reference/records.md documents every field).
"""

from typing import Literal

import msgspec

from fltea.records.device_fit import DeviceAxisFit
from fltea.records.fit import AxisFit, Interval, VerdictKind

AXES = ("gyro_x", "gyro_y", "gyro_z")
"""Names of the gyroscope's axes, in the order of every tuple of rates."""


ACCEL_AXES = ("accel_x", "accel_y", "accel_z")
"""Names of the accelerometer's axes, in the order of every tuple of specific forces."""

GYRO_UNIT, ACCEL_UNIT = "deg/s", "m/s^2"

Whiteness = Literal["not rejected", "rejected"]
"""What the newest fit says of white noise. While it is not rejected, an order is undefined."""

WhyNot = Literal["device_not_valid", "host_not_valid", "other_start", "device_skipped", "other_settings"]
"""Why a device's estimate cannot be compared with the host's; `why_not` has the words."""

EpochReason = Literal["start", "restart", "sensor_restart", "discontinuity", "gap", "silence", "resumed"]


class Record(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="class", kw_only=True):
    """Base of what a sink writes. device: the name under which the daemon runs the source."""

    device: str | None = None


class Hello(Record, frozen=True, tag="hello"):
    """Who is speaking and what its samples mean; null where a recording does not say."""

    source: str
    host_ns: int
    rate_hz: float
    sampling_mode: str
    protocol: str | None = None
    schema_hash: str | None = None
    boot_id: int | None = None
    device_id: str | None = None
    firmware_version: str | None = None
    who_am_i: int | None = None
    sensor: str | None = None
    sensor_starts: int | None = None
    gyro_range_dps: float | None = None
    gyro_lsb_per_dps: float | None = None
    accel_range_g: float | None = None
    accel_lsb_per_g: float | None = None
    gyro_dlpf_hz: float | None = None


class DeviceStatus(msgspec.Struct, frozen=True):
    """The device's own counters since its boot (protocol/README.md, STATUS).

    cpu_share_percent, longest_step_us: since the status before; None where the source has no such thing.
    """

    i2c_errors: int
    bus_recoveries: int
    sensor_reinits: int
    overruns: int
    dropped_frames: int
    reset_cause: str
    cpu_share_percent: float | None = None
    longest_step_us: int | None = None


class Placed(Record, frozen=True):
    """Base of what belongs to the sample `seq`."""

    seq: int
    epoch: int
    device_us: int
    host_ns: int


class Sample(Placed, frozen=True, tag="sample"):
    """One sample in physical units, times and sequence unwrapped."""

    gyro_dps: tuple[float, ...]
    accel_ms2: tuple[float, ...] | None = None
    temperature_c: float | None = None
    flags: int = 0


class CorrectedAxis(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The rate of one axis less its bias, and the deviation of that; null while the bias is not known."""

    rate: float | None
    rate_std: float | None
    moving: bool


class Corrected(Placed, frozen=True, tag="corrected"):
    """The gyroscope's rates in deg/s less their biases, for those who integrate them (`output.corrected`)."""

    axes: dict[str, CorrectedAxis]


class FlteaEstimate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the paper's filters make of one axis after one sample; null where not valid.

    state, innovation: in the unit of the axis. settled: the filters work with variances that are known, and
    their innovations are white; until then the figures say little of the noise.
    """

    alpha: float | None = None
    alpha_std: float | None = None
    f: float | None = None
    f_std: float | None = None
    state: float | None = None
    innovation: float | None = None
    valid: bool = False
    settled: bool = False


class AxisEstimate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is known of one axis after one sample; null where nothing is.

    verdict, alpha, f: of the newest fit whose verdict is stable. bias: what to subtract from the sample, the
    offset and the state of the noise; the deviations are those of the tracker. innovation: measurement minus
    prediction. All in `unit`. moving: the sensor is, so it predicts. null_p and whiteness are of the fit that
    the record `fit` tells of, the newest one before the sample. fltea: the paper's filters.
    """

    verdict: VerdictKind | None
    alpha: Interval
    f: Interval
    bias: float | None
    bias_std: float | None
    state: float | None
    state_std: float | None
    innovation: float | None
    moving: bool
    null_p: float | None
    whiteness: Whiteness | None
    unit: str
    fltea: FlteaEstimate


class Estimate(Placed, frozen=True, tag="estimate"):
    """The estimates of all axes after one sample; the accelerometer's only where `--channels` names them."""

    variant: str
    axes: dict[str, AxisEstimate]


class DeviceAxisEstimate(FlteaEstimate, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The device's own estimate of one axis after one sample; null where not valid.

    age: steps since the device's start-up window, the first one is 1. The differences are the device's
    estimate minus that of the host's filters after the same sample; null where the two cannot be compared,
    and why_not says why. tracker_*: bias and state by the filter of the device's own fit; null before its
    first fit. tracker_bias_difference: that bias minus the one that `estimate` has of the same sample; each
    goes by a fit of its own, so they differ, by far where one of these says white noise.
    """

    unit: str = GYRO_UNIT
    age: int
    tracker_bias: float | None = None
    tracker_bias_std: float | None = None
    tracker_state: float | None = None
    tracker_state_std: float | None = None
    tracker_bias_difference: float | None = None
    alpha_difference: float | None = None
    f_difference: float | None = None
    state_difference: float | None = None
    why_not: WhyNot | None = None


class DeviceEstimates(Placed, frozen=True, tag="device_estimate"):
    """The device's own estimates after one sample, beside the host's, which `Estimate` holds.

    comparable: at least one axis has differences.
    """

    variant: str
    axes: dict[str, DeviceAxisEstimate]
    comparable: bool


class DeviceFits(Placed, frozen=True, tag="device_fit"):
    """The device's own maximum-likelihood fit of one axis, beside `Fit`, which is this computer's.

    The place is that of the newest sample when it came. A fit whose bins the device sends comes twice: at
    once, and with `spectrum`.
    """

    axes: dict[str, DeviceAxisFit]


class Fit(Placed, frozen=True, tag="fit"):
    """The maximum-likelihood fit of all axes after the sample `seq`; comes a few samples later.

    samples: of how many. Epochs of the same sensor are fitted together.
    """

    samples: int
    axes: dict[str, AxisFit]


class Gap(Record, frozen=True, tag="gap"):
    """`missing` samples are lost, the first of them numbered `seq`."""

    seq: int
    missing: int
    epoch: int
    host_ns: int


class EstimatorInfo(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What an epoch is estimated with, and by whom: host, device or both; window 0 is unlimited.

    tuning: who sets Q and R while it runs: startup (nobody) or live (the live fit).
    """

    variant: str
    estimate_on: str
    memory: str
    guard: str
    window: int
    startup_samples: int
    bias: str | float | tuple[float, ...]
    R: str | float | tuple[float, ...]
    tuning: str = "startup"


class Epoch(Record, frozen=True, tag="epoch"):
    """A new stretch of unbroken time: the estimator starts again with the sample `seq`."""

    epoch: int
    reason: EpochReason
    seq: int
    device_us: int
    host_ns: int
    boot_id: int | None
    estimator: EstimatorInfo | None
    accel_estimator: EstimatorInfo | None = None
    resumed_after_s: float | None = None


class LinkStats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What arrived and what was lost on the way, since the start of the program."""

    bytes: int = 0
    frames: int = 0
    bad_frames: dict[str, int] = {}
    unknown_type: int = 0
    refused: int = 0
    overflow_bytes: int = 0
    reconnects: int = 0


class SampleStats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What became of the samples, since the start of the program."""

    delivered: int
    lost: int
    gaps: int
    duplicates: int
    before_hello: int


class TrackerStats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the tracker of an axis's bias gets on.

    model: the noise that it goes by, in words. nis: mean normalised innovation squared, which is 1 of a right
    model, and lag1 the correlation of neighbouring innovations, 0; holds: whether they are white; null before
    there are enough. moved: samples in motion. restarts: how often it began again, at another offset.
    bias, bias_std: after the newest sample, for those who read no estimates. heading_std: of the angle, in
    deg, so many seconds after the last sample at rest; empty before there is a model.
    K: random walk of the offset, per s and √s, that the samples show in time and the model does not hold.
    """

    model: str
    nis: float | None
    lag1: float | None
    holds: bool | None
    moved: int
    restarts: int
    K: Interval = Interval()
    heading_std: dict[int, float] = {}
    bias: float | None = None
    bias_std: float | None = None


class AxisStats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the start-up window gave an axis, and how often it had to start again.

    bias: in `unit`; R, Q: variances in use, in its square; Q is null where a device estimates. tuned: they
    are those of the live fit. describes_noise: false where the innovations are not white, or the fit
    that stands has no order or another one: the filter's α and f, and their deviations, say nothing then.
    """

    bias: float | None
    R: float | None
    restarts: int
    interventions: dict[str, int]
    innovation_lag1: float | None = None
    innovation_nis: float | None = None
    unit: str = GYRO_UNIT
    Q: float | None = None
    tuned: bool = False
    describes_noise: bool | None = None
    tracker: TrackerStats | None = None


class DeviceEstimatorStats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the device's own estimator gets on.

    begun, skipped, longest_axis_us and longest_slice_us (of a fit) are since its boot. fit_every: samples
    from one round of its fits to the next, 0 if it makes none. Since the start of the program: estimates
    of an axis that came; lost: those that did not; unplaced: those that came and fit no sample (before
    the epoch, or its sample was lost); fits that came; fits_refused: those whose numbers or bins no fit
    can have, or before the first sample. restarts are since the device's start-up window, interventions
    by cause since the axis last began.
    """

    begun: int
    startup_remaining: int
    every: int
    queue: int
    skipped: int
    longest_axis_us: int
    estimates: int
    lost: int
    unplaced: int
    restarts: dict[str, int]
    interventions: dict[str, dict[str, int]]
    fit_every: int = 0
    fits: int = 0
    fits_refused: int = 0
    longest_slice_us: int = 0


class OutputStats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What an output did with its records, since the start of the program.

    dropped: lost because it was too slow or broken. queued: waiting as of now.
    """

    written: int
    dropped: int
    queued: int


class Stats(Record, frozen=True, tag="stats"):
    """Health of the whole walk, once a second and at the end.

    fit_period_s: seconds of samples between two `fit` records at least; null where nothing is fitted.
    """

    epoch: int
    host_ns: int
    rate_hz: float | None
    clock_ppm: float | None
    startup_remaining: int
    link: LinkStats
    samples: SampleStats
    axes: dict[str, AxisStats]
    board: DeviceStatus | None
    outputs: dict[str, OutputStats] = {}
    device_estimator: DeviceEstimatorStats | None = None
    fit_period_s: float | None = None


class Error(Record, frozen=True, tag="error"):
    """Something that a person should know; the program goes on unless `--once` was given."""

    kind: str
    message: str
    host_ns: int


AnyRecord = (
    Hello | Sample | Corrected | Estimate | DeviceEstimates | DeviceFits | Fit | Gap | Epoch | Stats | Error
)
