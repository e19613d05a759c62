"""Parts of the record `stats`: counts of data, of filters and outputs, and the device's own counters."""

import msgspec

from fltea.records.fit import Interval

CAUSE_WORDS = {
    "order_box": "α held inside [0, 2]",
    "order_sigma": "a sigma point of α held",
    "order_variance": "the variance of α held",
    "order_gate": "an outlier softened for α",
    "parameter_box": "f held inside its bounds",
    "parameter_variance": "the variance of f held",
    "parameter_gate": "an outlier softened for f",
    "state_bound": "the state held near the sample",
    "memory_order": "an order beyond the memory's range",
}
"""Causes for which the guard, which keeps the filters from diverging, corrects them. The keys are those in
records, and the values are the words that people read.
"""


class DeviceStatus(msgspec.Struct, frozen=True):
    """The device's own counters since its boot (protocol/README.md, STATUS)."""

    i2c_errors: int
    """I²C transfers that failed."""
    bus_recoveries: int
    """Number of times that a blocked bus was freed (for an I²C source: opened again)."""
    sensor_reinits: int
    """Number of times that the sensor was set up again."""
    overruns: int
    """Number of sampling instants at which the device took no sample."""
    dropped_frames: int
    """Number of frames that the device could not send."""
    reset_cause: str
    """Cause of the last reset: `power_up`, `backup`, `watchdog`, `software`, `user` or `unknown`."""
    cpu_share_percent: float | None = None
    """Share of the time in which the board's main loop was busy [%]."""
    longest_step_us: int | None = None
    """Longest duration of one pass of the device's main loop since the device's last report [µs]."""


# The sources count in `LinkStats`. Gaps and other findings in the samples are counted in `SampleStats`.
class LinkStats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Counts of bytes and frames that arrived or were lost in transit, since the start of the program."""

    bytes: int = 0
    """Bytes received."""
    frames: int = 0
    """Number of undamaged frames (for an I²C source: of samples)."""
    bad_frames: dict[str, int] = {}
    """Damaged frames by reason (protocol/README.md), and lines of text without a sample; `partial` is normal
    after the port is opened. For an I²C source: number of restarts of the FIFO by cause (`overflow`,
    `misaligned`, `out_of_step`, `broken_transfer`).
    """
    unknown_type: int = 0
    """Intact frames of a type that this version does not know."""
    refused: int = 0
    """Number of frames from a device with another protocol version."""
    overflow_bytes: int = 0
    """Bytes thrown away because the program was too slow."""
    reconnects: int = 0
    """Number of times that the port was opened again."""

    @property
    def damaged(self) -> dict[str, int]:
        """Damaged frames by reason, without those that are normal after the port is opened."""
        return {reason: count for reason, count in self.bad_frames.items() if reason != "partial"}


# `fltea.stream.decode` makes these counts from those of the native code, for live devices and `fltea info`.
class SampleStats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Counts of used, lost and refused samples, since the start of the program."""

    delivered: int
    """Samples that were passed to the estimator."""
    lost: int
    """Number of samples that are missing in gaps, between samples that were delivered. What is missing before
    the first sample or after the last one has no number; if it is a part of a recording that cannot be read,
    an `error` record says so.
    """
    gaps: int
    """Number of gaps."""
    duplicates: int
    """Samples that arrived a second time and were dropped."""
    before_hello: int
    """Samples that could not be used because no HELLO had arrived yet."""
    rate_differs: int = 0
    """Samples that were not used because the device's clock contradicts the rate that its HELLO states."""


class BiasCheck(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How well Bias(T) was right: the tracker's forecast of the mean bias over the next T seconds.

    Each forecast is compared with the mean of the samples of these T seconds.
    """

    pieces: int
    """Number of compared periods. Each period has T seconds, and the sensor was at rest in all of it."""
    rms: float
    """Root mean square of the forecasts' errors, each divided by its σ. It is 1 if Bias(T) and its σ are
    right.
    """


# Why more than 12 attributes: each is one field of the published record.
class TrackerStats(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """State and checks of the tracker of an axis's bias, which is a Kalman filter."""

    model: str
    """The tracker's noise model: the parts of the fit, or `walks` (random walks) before the first fit."""
    nis: float | None
    """Mean normalised innovation squared of the tracker; 1 if the model is right; null before 200
    innovations.
    """
    lag1: float | None
    """Correlation of neighbouring innovations of the tracker; 0 if the model is right; null before 200
    innovations.
    """
    holds: bool | None
    """Whether the tracker's last 1,000 innovations are white; null before 200 innovations."""
    moved: int
    """Number of samples in motion, during which the tracker only predicted the bias."""
    restarts: int
    """Number of restarts of the tracker. It restarts if the sensor, at rest, shows for ten seconds or longer
    another bias than the tracker's.
    """
    K: Interval = Interval()
    """Random walk K of the bias, estimated from the samples in the time domain [`unit`/√s]; null if the bias
    may be constant.
    """
    heading_std: dict[int, float] = {}
    """Standard deviation of the heading after a time without rest [deg]. The keys are this time in seconds:
    1, 10, 60, 600, 3,600."""
    bias: float | None = None
    """The bias after the newest sample [`unit`]."""
    bias_std: float | None = None
    """Standard deviation of `bias` [`unit`]."""
    steps: int = 0
    """Number of steps of the axis's bias."""
    moving: bool = False
    """Whether the sensor is moving at the newest sample."""
    checked: dict[int, BiasCheck] = {}
    """Comparisons of Bias(T) with the mean of the T seconds that followed. The keys are T: 1, 10, 60 s."""
    bias_for_s: float = 1.0
    """The published bias is a forecast: the mean of the bias over the coming `bias_for_s` seconds [s]."""


class AxisStats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Bias and measurement variance R that are used for an axis, and the state of the axis's filters."""

    bias: float | None
    """Bias in use (for an accelerometer it includes gravity); null until the start-up window is full
    [`unit`].
    """
    R_in_use: float | None
    """Measurement variance in use [`unit` squared]."""
    restarts: int
    """Number of restarts of the axis's filters in this epoch."""
    interventions: dict[str, int]
    """For each cause, number of samples in which the guard corrected the axis's filters since their last
    start.
    """
    innovation_lag1: float | None = None
    """Correlation of neighbouring innovations of the paper's filters over the last 1,000 innovations; 0 ±
    0.03 if they are white.
    """
    innovation_nis: float | None = None
    """Mean normalised innovation squared of the paper's filters; 1 if their model is right."""
    unit: str = "deg/s"
    """`deg/s`, or `m/s^2` for axes of the accelerometer."""
    Q_in_use: float | None = None
    """Variance Q of one step of the state from one sample to the next, as the filters use it; null if a
    device estimates [`unit` squared].
    """
    tuned: bool = False
    """Whether the filters use a live fit: their variances Q and R are those of the fit, and they started with
    the fit's α and f (setting `estimator.tuning`).
    """
    describes_noise: bool | None = None
    """False if the filters' α and f do not describe the noise, for one of three reasons: the innovations are
    not white (Ljung–Box p below 0.001), the fit has no order, or α is outside the fit's interval. Null at
    first.
    """
    tracker: TrackerStats | None = None
    """State of the tracker of the axis's bias; null if there is no tracker."""


# Why more than 12 attributes: each is one field of the published record.
class DeviceEstimatorStats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """State and counts of the device's own estimator."""

    begun: int
    """How often the device's estimator has begun to fill a start-up window since the device's boot."""
    startup_remaining: int
    """Number of samples until the device's start-up window is full."""
    every: int
    """Number of samples from one estimate of the device to the next."""
    queue: int
    """Number of samples that wait for the device's estimator."""
    skipped: int
    """Number of samples that the device's estimator has skipped since the device's boot, because it had
    fallen behind.
    """
    longest_axis_us: int
    """Longest computing time of one step of one axis's filters since the device's boot [µs]."""
    estimates: int
    """Number of estimates (of one axis each) that arrived."""
    lost: int
    """Number of estimates that the device sent and that did not arrive."""
    unplaced: int
    """Number of estimates that arrived but belong to no known sample. Such a sample was lost, precedes the
    epoch, or is more than 256 samples old.
    """
    restarts: dict[str, int]
    """Number of restarts of each axis's filters since the device's start-up window."""
    interventions: dict[str, dict[str, int]]
    """For each axis and cause, number of samples in which the guard corrected the axis's filters since their
    last start.
    """
    fit_every: int = 0
    """Number of samples from one round of the device's fits to the next; 0 if the device makes no fits."""
    fits: int = 0
    """Number of fits (of one axis each) that arrived."""
    fits_refused: int = 0
    """Number of the device's fits that this computer did not use. They had impossible numbers, or arrived
    before the first sample.
    """
    longest_slice_us: int = 0
    """Longest time since the device's boot for which a fit has computed without a pause [µs]."""


class OutputStats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Counts of an output's records, since the start of the program."""

    written: int
    """Records that the output has processed. It may write fewer of them: samples only if a setting asks for
    them, and on MQTT only some of the samples and estimates.
    """
    dropped: int
    """Records that the output lost because it was too slow or broken."""
    queued: int
    """Records that wait for the output now."""
