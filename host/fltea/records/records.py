"""Define the records that the program publishes. Names of fields end in their units.

As JSON, each record is one object whose first key is `class`. The documentation shows the text that stands
below each field.
"""

from typing import Literal

import msgspec

from fltea.records.device_fit import DeviceAxisFit
from fltea.records.estimate import AxisEstimate, DeviceAxisEstimate
from fltea.records.fit import AxisFit
from fltea.records.sensor_kind import ACCELEROMETER, GYROSCOPE
from fltea.records.stats import (
    AxisStats,
    DeviceEstimatorStats,
    DeviceStatus,
    LinkStats,
    OutputStats,
    SampleStats,
)

AXES = GYROSCOPE.axes
"""Names of the gyroscope's axes, in the order of every tuple of rates."""

ACCEL_AXES = ACCELEROMETER.axes
"""Names of the accelerometer's axes, in the order of every tuple of specific forces."""

GYRO_UNIT, ACCEL_UNIT = GYROSCOPE.unit, ACCELEROMETER.unit

EpochReason = Literal["start", "restart", "sensor_restart", "discontinuity", "gap", "silence", "resumed"]


class Record(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="class", kw_only=True):
    """Base class of all records that outputs write."""

    device: str | None = None
    """Name in this program of the device or recording that the record is from."""


# Why more than 12 attributes: each is one field of the published record.
class Hello(Record, frozen=True, tag="hello"):
    """The identity and settings of a device or recording.

    This record comes at the start, and after each restart of the device or of its sensor.
    """

    source: str
    """Address of the source."""
    host_ns: int
    """Time at which the HELLO arrived [ns]."""
    rate_hz: float
    """Nominal sampling rate [Hz]."""
    sampling_mode: str
    """What starts a sample: `timer`, `data_ready`, `fifo`, `simulated` or `recording`."""
    protocol: str | None = None
    """Version of the wire protocol."""
    schema_hash: str | None = None
    """Hash of the layout of the protocol's messages."""
    boot_id: int | None = None
    """Identifier of the device's boot. After each restart it has another value."""
    device_id: str | None = None
    """Unique identifier of the microcontroller, hexadecimal."""
    firmware_version: str | None = None
    """Version and build of the firmware."""
    who_am_i: int | None = None
    """The sensor's WHO_AM_I register; 0 while no sensor has answered."""
    sensor: str | None = None
    """Name of the chip that has this WHO_AM_I; `no sensor` for 0."""
    sensor_starts: int | None = None
    """Number of times that the device has set up its sensor since boot; 0 before the first time."""
    gyro_range_dps: float | None = None
    """Full scale of the gyroscope: it measures rates from minus to plus this value [deg/s]."""
    gyro_lsb_per_dps: float | None = None
    """Sensitivity of the gyroscope [LSB per deg/s]."""
    accel_range_g: float | None = None
    """Full scale of the accelerometer: it measures from minus to plus this value [g]."""
    accel_lsb_per_g: float | None = None
    """Sensitivity of the accelerometer; null where the source gives m/s² [LSB per g]."""
    gyro_dlpf_hz: float | None = None
    """Bandwidth of the sensor's low-pass filter [Hz]."""


class Placed(Record, frozen=True):
    """Base class of records that belong to the sample `seq`."""

    seq: int
    """Number of the sample, unwrapped."""
    epoch: int
    """Number of the sample's epoch, which is a run of samples without a restart or a long gap."""
    device_us: int
    """Device time, unwrapped [µs]."""
    host_ns: int
    """Host time at which the sample was taken, by regression on arrival times [ns]. For a device it is Unix
    time, based on the machine's date at the beginning of the epoch. For a recording it is the host time that
    the recording holds. If it holds none, it is the time since the beginning of the recording.
    """


class Sample(Placed, frozen=True, tag="sample"):
    """One sample in physical units.

    With `--samples`, this record comes before the record `estimate` of the sample.
    """

    gyro_dps: tuple[float, ...]
    """Angular rates about x, y, z, with their bias [deg/s]."""
    accel_ms2: tuple[float, ...] | None = None
    """Specific force along x, y, z [m/s²]."""
    temperature_c: float | None = None
    """Die temperature [°C]."""
    flags: int = 0
    """Flags with which the device marks a doubtful sample (protocol/README.md, sample flags)."""


class CorrectedAxis(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The angular rate of one axis minus its bias."""

    rate: float | None
    """Sample minus the bias in the record `estimate`; null for the first samples [deg/s]."""
    rate_std: float | None
    """Standard deviation of the subtracted bias [deg/s]."""
    moving: bool
    """Whether the sensor is moving, so that the bias is only predicted and its σ grows."""


class Corrected(Placed, frozen=True, tag="corrected"):
    """The gyroscope's rates minus their biases, for programs that integrate them.

    This record comes only with `--corrected`. As with samples, only every `output.every`-th record is
    written; MQTT sends one record with every estimate.
    """

    axes: dict[str, CorrectedAxis]
    """Corrected rate of each axis, by the name of the axis."""


class Estimate(Placed, frozen=True, tag="estimate"):
    """The estimates of each axis after one sample, from the end of the start-up window on.

    The record includes axes of the accelerometer only if `--channels` names them.
    """

    variant: str
    """Variant of the estimator: `triple` (the paper's three filters) or `joint` (one filter for α and f)."""
    axes: dict[str, AxisEstimate]
    """Estimates of each axis, by the name of the axis."""


class DeviceEstimates(Placed, frozen=True, tag="device_estimate"):
    """The device's own estimates after a sample, with `--estimate-on both` only.

    The record `estimate` then has the estimates of this computer. (With `--estimate-on device`, it has the
    device's.) A `device_estimate` comes later than its sample, since the device needs time to estimate. It
    leaves out an axis whose message was lost in transit.
    """

    variant: str
    """Variant of the device's estimator: `triple` or `joint`, as in the record `estimate`."""
    axes: dict[str, DeviceAxisEstimate]
    """The device's estimates of each axis, by the name of the axis."""
    comparable: bool
    """Whether the differences from this computer's estimates are known for at least one axis."""


class DeviceFits(Placed, frozen=True, tag="device_fit"):
    """The device's own maximum-likelihood fit of one axis, made every three seconds or less often.

    This record comes only with `--estimate-on device` or `both`. `seq` is the number of the newest sample at
    the time at which the fit arrived. If the device also sends the spectrum of a fit, the record comes twice:
    at once without `spectrum`, and later with `spectrum`.
    """

    axes: dict[str, DeviceAxisFit]
    """The device's fit of each axis, by the name of the axis."""


class Fit(Placed, frozen=True, tag="fit"):
    """The noise of every axis, by maximum likelihood over all samples so far.

    This record comes whenever the number of samples has grown by a hundredth, once a second at most and once
    a minute at least. It also comes within a second after a step of the bias or a change of the noise's
    power. If `live.period_s` is given, the record comes once in each such period instead. A last record, with
    curves, comes at the end of a recording, or of a run with `--once`. A fit uses the samples up to `seq` and
    is published a little later. From the first sample after its publication, the fit is used for the records
    `estimate`. A replay gives the same records as the live run.
    """

    samples: int
    """Number of samples received from the same sensor in all epochs. Samples that the fit leaves out are
    included, and with `--state` the samples of the earlier run.
    """
    axes: dict[str, AxisFit]
    """The fit of each axis, by the name of the axis."""


class Gap(Record, frozen=True, tag="gap"):
    """Samples are missing."""

    seq: int
    """Number of the first sample that is missing."""
    missing: int
    """Number of missing samples."""
    epoch: int
    """Number of the epoch in which the samples are missing."""
    host_ns: int
    """Host time of the first sample after the gap [ns]."""


class Step(Placed, frozen=True, tag="step"):
    """The bias of an axis has stepped.

    The record's `seq` is that of the first sample after the step. The record is published later, as soon as
    enough samples have shown the step.
    """

    axis: str
    """Name of the axis."""
    unit: str
    """`deg/s`, or `m/s^2` for axes of the accelerometer."""
    size: float
    """Bias after the step minus the bias before it [`unit`]."""
    size_std: float
    """Standard deviation of `size` [`unit`]."""
    found_after: int
    """Number of samples from the step to its detection."""


class Motion(Placed, frozen=True, tag="motion"):
    """The sensor has begun to move, or is at rest again.

    The record's `seq` is that of the first sample in motion, or of the first sample at rest. While the sensor
    moves, the bias of every axis is predicted; at rest it is estimated from the samples.
    """

    begins: bool
    """True where a motion begins; false where it has ended."""
    by: str
    """What showed that the sensor moved: a sensor or an axis, such as `accel` or `gyro_z`. `caller` means
    that the program that passed the samples said so.
    """
    samples: int | None
    """Duration of the motion in samples; null where the motion begins."""
    largest: float | None
    """Largest rate of any axis during the motion, minus the bias of this axis [deg/s]; null where the motion
    begins.
    """


class EstimatorInfo(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The settings of the estimator of an epoch."""

    variant: str
    """`triple`: the paper's three filters; `joint`: one filter for α and h^α f (h: the sampling period)."""
    estimate_on: str
    """Which computer estimates: `host` (this one), `device` (the board) or `both`."""
    memory: str
    """How the filters keep past samples: `compressed` (approximate, in constant memory) or `direct`
    (exact).
    """
    guard: str
    """The guard that keeps the filters from diverging: `off` (none, as in the paper), `faithful` (bounds), or
    `consistent` (bounds; also, the filters of α and f count the variance of the state, which the paper's
    filters leave out).
    """
    window: int
    """Length L of the filters' memory in samples; 0 means unlimited."""
    startup_samples: int
    """Length of the start-up window, from which bias and R come, in samples; 0 if none is needed."""
    bias: tuple[float, ...]
    """Bias that is subtracted from each axis, or one number for all axes [deg/s, for the accelerometer m/s²].
    An empty list means that the bias is the mean of the start-up window.
    """
    R: tuple[float, ...]
    """Measurement variance of each axis, or one number for all axes [(deg/s)², for the accelerometer
    (m/s²)²]. An empty list means the variance of the start-up window.
    """
    tuning: str = "startup"
    """`startup`: the filters' variances Q (of a step of the state) and R (of the measurement) stay as at the
    start; `live`: Q and R come from the live fit as soon as it knows them.
    """


class Epoch(Record, frozen=True, tag="epoch"):
    """A new epoch, a period of samples without a long gap, begins, and the estimators start again."""

    epoch: int
    """Number of the epoch: 1, 2, …"""
    reason: EpochReason
    """`start`; `restart` (another boot); `sensor_restart` (the device set up its sensor again);
    `discontinuity` (sample number and device time disagreed); `gap` (longer than `max_gap`); `silence`
    (longer than 30 minutes); `resumed` (goes on from the snapshot of an earlier run).
    """
    seq: int
    """Number of the epoch's first sample."""
    device_us: int
    """Device time of the epoch's first sample [µs]."""
    host_ns: int
    """Host time of the epoch's first sample [ns]."""
    boot_id: int | None
    """Identifier of the device's boot to which the epoch belongs."""
    estimator: EstimatorInfo | None = None
    """Settings of the gyroscope's estimator."""
    accel_estimator: EstimatorInfo | None = None
    """Settings of the accelerometer's estimator, which always runs on this computer."""
    resumed_after_s: float | None = None
    """Age of the snapshot from which the estimators continue [s]."""


class Stats(Record, frozen=True, tag="stats"):
    """Counts and health of source, estimators and outputs.

    This record comes once a second, when the start-up window is full, and at the end. Counts begin at the
    start of the program. For each boot of a device, `delivered` + `lost` counts all samples that the device
    took from its first used sample to its last used one.
    """

    epoch: int
    """Number of the current epoch; 0 before the first epoch."""
    host_ns: int
    """Time of this record [ns]."""
    rate_hz: float | None
    """Sampling rate by the host's clock [Hz]. It is computed from sequence numbers, so lost samples do not
    lower it. Null at first, and if the samples do not arrive in real time, such as those of a file through a
    pipe.
    """
    clock_ppm: float | None
    """How much faster the device's clock runs than the host's, as a fraction [1e-6]. Null at first, for a
    recording without host times, for text without times, and if the samples do not arrive in real time.
    """
    startup_remaining: int
    """Number of samples until the start-up window is full."""
    link: LinkStats
    """Counts of what arrived from the source and what was lost in transit, since the start of the program."""
    sample_counts: SampleStats
    """Counts of used, lost and refused samples, since the start of the program."""
    axes: dict[str, AxisStats]
    """Bias, measurement variance R, filters and bias tracker of each axis, by the name of the axis."""
    board: DeviceStatus | None = None
    """The device's own counters since its boot; null before its first STATUS."""
    outputs: dict[str, OutputStats] = {}
    """Counts of each output by its name, as in the table of host/docs/guide/outputs.md; empty for sources
    that do not run in real time."""
    device_estimator: DeviceEstimatorStats | None = None
    """State of the device's own estimator; null without `--estimate-on device` or `both`."""
    fit_period_s: float | None = None
    """Shortest time between fits [s]. It is 1 s, or with more than 12 devices as many twelfths of a second as
    there are devices. Null if no axis is fitted.
    """


class Error(Record, frozen=True, tag="error"):
    """A message to a person about a problem. The program continues, unless `--once` was given."""

    kind: str
    """Kind of the problem, one of those in host/docs/reference/errors.md."""
    message: str
    """What happened, the likely cause, what to do."""
    host_ns: int
    """Time of the problem [ns]."""


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
