"""The records that the program publishes, units in their names.

As JSON each is one object whose first key is `class`. The site shows every field with the text below it.
"""

from typing import Literal

import msgspec

from fltea.records.device_fit import DeviceAxisFit
from fltea.records.fit import AxisFit, Interval, VerdictKind
from fltea.records.stats import (
    AxisStats,
    DeviceEstimatorStats,
    DeviceStatus,
    LinkStats,
    OutputStats,
    SampleStats,
)

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
    """Base of what a sink writes."""

    device: str | None = None
    """Name of the source in this program."""


class Hello(Record, frozen=True, tag="hello"):
    """The device or recording introduces itself.

    At the start, and after each restart of the device or of its sensor.
    """

    source: str
    """Where it comes from."""
    host_ns: int
    """When it was heard [ns]."""
    rate_hz: float
    """Nominal sampling rate [Hz]."""
    sampling_mode: str
    """What starts a sample: `timer`, `data_ready`, `fifo`, `simulated` or `recording`."""
    protocol: str | None = None
    """Version of the wire protocol."""
    schema_hash: str | None = None
    """Hash of its layout."""
    boot_id: int | None = None
    """Differs from boot to boot."""
    device_id: str | None = None
    """Unique identifier of the microcontroller, hexadecimal."""
    firmware_version: str | None = None
    """Version and build."""
    who_am_i: int | None = None
    """The sensor's WHO_AM_I register; 0 while no sensor has answered."""
    sensor: str | None = None
    """The chip that this number means; `no sensor` for 0."""
    sensor_starts: int | None = None
    """Times that the device has set up its sensor since boot; 0: not yet."""
    gyro_range_dps: float | None = None
    """Full scale, plus and minus [deg/s]."""
    gyro_lsb_per_dps: float | None = None
    """Sensitivity [LSB per deg/s]."""
    accel_range_g: float | None = None
    """Full scale, plus and minus [g]."""
    accel_lsb_per_g: float | None = None
    """Sensitivity; null where the source gives m/s² [LSB per g]."""
    gyro_dlpf_hz: float | None = None
    """Bandwidth of the sensor's low-pass filter [Hz]."""


class Placed(Record, frozen=True):
    """Base of what belongs to the sample `seq`."""

    seq: int
    """Number of the sample, unwrapped."""
    epoch: int
    """Epoch that it belongs to."""
    device_us: int
    """Device time, unwrapped [µs]."""
    host_ns: int
    """Host time of sampling, by regression: Unix time as of the beginning of the epoch (of recordings: since
    their beginning, or the host time that they hold) [ns]."""


class Sample(Placed, frozen=True, tag="sample"):
    """One sample in physical units, before its estimate.

    Only with `--samples`.
    """

    gyro_dps: tuple[float, ...]
    """Rates about x, y, z, bias not removed [deg/s]."""
    accel_ms2: tuple[float, ...] | None = None
    """Specific force along x, y, z [m/s²]."""
    temperature_c: float | None = None
    """Die temperature [°C]."""
    flags: int = 0
    """The device's doubts (protocol/README.md, sample flags)."""


class CorrectedAxis(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The rate of one axis less its bias."""

    rate: float | None
    """Sample less the bias that `estimate` has of it; null for the first samples [deg/s]."""
    rate_std: float | None
    """Standard deviation of that bias [deg/s]."""
    moving: bool
    """The sensor is moved, so the bias is predicted and its σ grows."""


class Corrected(Placed, frozen=True, tag="corrected"):
    """The gyroscope's rates less their biases, for those who integrate them.

    Only with `--corrected`. `output.every` thins them like samples; MQTT sends one with every estimate.
    """

    axes: dict[str, CorrectedAxis]
    """Each axis."""


class FlteaEstimate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the paper's filters make of one axis after one sample; null where not valid."""

    alpha: float | None = None
    """Order α."""
    alpha_std: float | None = None
    """Standard deviation of α; once tuned, with what the live fit leaves open."""
    f: float | None = None
    """Parameter f [s^-α]."""
    f_std: float | None = None
    """Standard deviation of f, as that of α [s^-α]."""
    state: float | None = None
    """State x̂ after the sample, without the bias of the start-up window [`unit`]."""
    innovation: float | None = None
    """Sample minus its prediction [`unit`]."""
    valid: bool = False
    """False: the estimate ran away, the axis was constant, or a device sent a number that is not finite."""
    settled: bool = False
    """False: settling, so the figures say little of the noise. Of a device: it goes on with the variances of
    its own fit."""


class AxisEstimate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is known of one axis after one sample; null where nothing is."""

    verdict: VerdictKind | None
    """What the noise is, of the newest fit whose verdict is stable; null before the first."""
    alpha: Interval
    """Order α of that fit; null where undefined."""
    f: Interval
    """Parameter f of that fit; null where undefined [s^-α]."""
    bias: float | None
    """What to subtract from the sample: the sensor's offset and the state of its noise; null for the first
    samples [`unit`]."""
    bias_std: float | None
    """Standard deviation of the bias [`unit`]."""
    state: float | None
    """The state of the noise, without the offset; 0 of white noise; the whole bias of a random walk
    [`unit`]."""
    state_std: float | None
    """Standard deviation of the state [`unit`]."""
    innovation: float | None
    """Sample minus its prediction [`unit`]."""
    moving: bool
    """The sensor is moved, so the bias is predicted and its σ grows."""
    null_p: float | None
    """How often white noise would look at least as unlike white, by the newest `fit`."""
    whiteness: Whiteness | None
    """`not rejected`: there is no order; `rejected`: `null_p` is below the level that holds for all looks;
    null with `null_p`."""
    unit: str
    """`deg/s`, or `m/s^2` for the axes `accel_x`, … that `--channels` names."""
    fltea: FlteaEstimate
    """What the paper's filters make of the sample."""


class Estimate(Placed, frozen=True, tag="estimate"):
    """What is known of each axis after one sample, from the end of the start-up window on.

    Axes of the accelerometer are in it only where `--channels` names them.
    """

    variant: str
    """`triple` or `joint`."""
    axes: dict[str, AxisEstimate]
    """Each axis."""


class DeviceAxisEstimate(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The device's own estimate of one axis after one sample."""

    fltea: FlteaEstimate
    """What the paper's filters on the device make of the sample."""
    unit: str = GYRO_UNIT
    """`deg/s`."""
    age: int
    """Steps of the axis since the device's start-up window, missing samples included; the first is 1."""
    tracker_bias: float | None = None
    """Offset and state by the filter of the device's own fit; null before its first fit of the axis
    [deg/s]."""
    tracker_bias_std: float | None = None
    """Standard deviation of that bias [deg/s]."""
    tracker_state: float | None = None
    """The coloured part of the noise alone; 0 of white noise [deg/s]."""
    tracker_state_std: float | None = None
    """Standard deviation of that state [deg/s]."""
    tracker_bias_difference: float | None = None
    """That bias minus `bias` of `estimate` after the same sample; each goes by a fit of its own [deg/s]."""
    alpha_difference: float | None = None
    """α: the device's minus this computer's after the same sample; null where they cannot be compared."""
    f_difference: float | None = None
    """f: the same [s^-α]."""
    state_difference: float | None = None
    """State: the same [deg/s]."""
    why_not: WhyNot | None = None
    """Why there are no differences: `device_not_valid`, `host_not_valid`: that estimate is not valid;
    `other_start`: the device began at another sample; `device_skipped`: it skipped samples since;
    `other_settings`: settings differ, or the device goes on with those of its own fit."""


class DeviceEstimates(Placed, frozen=True, tag="device_estimate"):
    """What the device itself makes of a sample, beside `estimate`, which is this computer's.

    Only with `--estimate-on both`; with `--estimate-on device` the device's are the records `estimate`. It
    comes after its sample by as much as the device is behind. An axis whose message was lost on the line is
    left out.
    """

    variant: str
    """`triple` or `joint`, of the device."""
    axes: dict[str, DeviceAxisEstimate]
    """Each axis."""
    comparable: bool
    """Whether any axis has differences."""


class DeviceFits(Placed, frozen=True, tag="device_fit"):
    """The device's own maximum-likelihood fit of one axis, every three seconds or later.

    Only with `--estimate-on device` or `both`. It stands at the newest sample when it came. A fit whose bins
    the device sends comes twice: at once, and with `spectrum`.
    """

    axes: dict[str, DeviceAxisFit]
    """Each axis."""


class Fit(Placed, frozen=True, tag="fit"):
    """What the noise of every axis is, by maximum likelihood over all samples so far.

    It comes whenever the record has grown by a hundredth, once a second at most and once a minute at least,
    and within a second after a step or a change of power (`live.period_s` given: that often); once more,
    with curves, at the end of a recording or of `--once`. A fit is of the samples up to `seq` and comes a
    little later; estimates go by it from the next sample on. A replay gives the live run's records.
    """

    samples: int
    """Samples taken, those left out included, of all epochs of the same sensor, and of the earlier run with
    `--state`."""
    axes: dict[str, AxisFit]
    """Each axis."""


class Gap(Record, frozen=True, tag="gap"):
    """Samples are missing."""

    seq: int
    """Number of the first sample that is missing."""
    missing: int
    """How many are."""
    epoch: int
    """Epoch in which they are missing."""
    host_ns: int
    """Host time of the sample after them [ns]."""


class Step(Placed, frozen=True, tag="step"):
    """The bias of an axis has stepped.

    It stands at the first sample after the step, and comes as soon as the samples since then have shown it.
    """

    axis: str
    """Name of the axis."""
    unit: str
    """`deg/s`, or `m/s^2` for axes of the accelerometer."""
    size: float
    """Bias after the step less the bias before it [`unit`]."""
    size_std: float
    """Standard deviation of that size [`unit`]."""
    found_after: int
    """Samples from the step to the one with which it was found."""


class Motion(Placed, frozen=True, tag="motion"):
    """The sensor has begun to move, or is at rest again.

    It stands at the first sample in motion, or at the first at rest. While the sensor moves, the bias of
    every axis is predicted; at rest it is learnt.
    """

    begins: bool
    """Whether a motion begins here; false where it has ended."""
    by: str
    """What showed it: a sensor or an axis, such as `accel` or `gyro_z`, or `caller`, who said so."""
    samples: int | None
    """How long the sensor moved, in samples; null where the motion begins."""
    largest: float | None
    """Largest rate less its bias of any axis while it moved; null where the motion begins [deg/s]."""


class EstimatorInfo(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What an epoch is estimated with, and by whom."""

    variant: str
    """`triple`: the published algorithm; `joint`: one filter on α and h^α f."""
    estimate_on: str
    """Who estimates: `host` (this computer), `device` (by itself) or `both`."""
    memory: str
    """`compressed` or `direct` (the exact window)."""
    guard: str
    """`off` (the printed algorithm), `faithful` or `consistent`."""
    window: int
    """Length L of the memory in samples; 0: unlimited."""
    startup_samples: int
    """Length of the start-up window; 0 if none is needed."""
    bias: tuple[float, ...]
    """What is subtracted from each axis, or one number for all; empty: the mean of the start-up window
    [deg/s, of the accelerometer m/s²]."""
    R: tuple[float, ...]
    """Measurement variance of each axis, or one for all; empty: the variance of the start-up window [the
    square of that]."""
    tuning: str = "startup"
    """`startup`: Q and R stay as at the start; `live`: they are those of the live fit as soon as it knows
    them."""


class Epoch(Record, frozen=True, tag="epoch"):
    """A new stretch of unbroken time begins, and the estimators start again."""

    epoch: int
    """Its number: 1, 2, …"""
    reason: EpochReason
    """`start`; `restart` (another boot); `sensor_restart` (the device has set up its sensor again);
    `discontinuity` (sequence and time disagreed); `gap` (longer than `max_gap`); `silence` (longer than 30
    minutes); `resumed` (goes on from the snapshot of an earlier run)."""
    seq: int
    """Number of its first sample."""
    device_us: int
    """Device time of its first sample [µs]."""
    host_ns: int
    """Host time of its first sample [ns]."""
    boot_id: int | None
    """Boot that it belongs to."""
    estimator: EstimatorInfo | None = None
    """What the gyroscope is estimated with."""
    accel_estimator: EstimatorInfo | None = None
    """The same for the accelerometer, which is always estimated here."""
    resumed_after_s: float | None = None
    """Age of the snapshot that the estimators go on from [s]."""


class Stats(Record, frozen=True, tag="stats"):
    """Health of the whole walk: once a second, when the start-up window is full, and at the end.

    Counts run from the start of the program. For each boot of a device: delivered + lost = sampled, from the
    first sample that is used to the last.
    """

    epoch: int
    """Current epoch; 0 before the first."""
    host_ns: int
    """Now [ns]."""
    rate_hz: float | None
    """Sampling rate by the host's clock, from sequence numbers: losses do not lower it [Hz]."""
    clock_ppm: float | None
    """How much faster than the host's the device's clock runs; null at first, and where no host's clock was
    recorded [1e-6]."""
    startup_remaining: int
    """Samples until the start-up window is full."""
    link: LinkStats
    """What arrived, and what was lost on the way, since the start of the program."""
    sample_counts: SampleStats
    """What became of the samples, since the start of the program."""
    axes: dict[str, AxisStats]
    """Each axis."""
    board: DeviceStatus | None = None
    """The device's own counters since its boot; null before its first STATUS."""
    outputs: dict[str, OutputStats] = {}
    """Each output by its name, as in the table of host/docs/guide/outputs.md; none for sources without a pace
    of their own."""
    device_estimator: DeviceEstimatorStats | None = None
    """The device's own estimator; null without `--estimate-on device` or `both`."""
    fit_period_s: float | None = None
    """Least time between fits: 1, and a twelfth of the number of devices where there are more than 12; null
    where nothing is fitted."""


class Error(Record, frozen=True, tag="error"):
    """Something that a person should know; the program goes on unless `--once` was given."""

    kind: str
    """What kind it is: see Errors and exit codes."""
    message: str
    """What happened, the likely cause, what to do."""
    host_ns: int
    """When it happened [ns]."""


AnyRecord = (
    Hello
    | Sample
    | Corrected
    | Estimate
    | DeviceEstimates
    | DeviceFits
    | Fit
    | Gap
    | Step
    | Motion
    | Epoch
    | Stats
    | Error
)
