"""Parts of the record `stats`: what arrived, what the filters and outputs did, the device's own counters."""

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
"""Why the guard stepped in, as counts of interventions have it, and for a person."""


class DeviceStatus(msgspec.Struct, frozen=True):
    """The device's own counters since its boot (protocol/README.md, STATUS)."""

    i2c_errors: int
    """I²C transfers that failed."""
    bus_recoveries: int
    """Times that a held bus was freed (of an I²C source: opened again)."""
    sensor_reinits: int
    """Times that the sensor was set up again."""
    overruns: int
    """Sampling instants without a sample."""
    dropped_frames: int
    """Frames that the device could not send."""
    reset_cause: str
    """`power_up`, `backup`, `watchdog`, `software`, `user`, `unknown`."""
    cpu_share_percent: float | None = None
    """Share of the time that the board's main loop worked [%]."""
    longest_step_us: int | None = None
    """Longest turn of the device's main loop in that time [µs]."""


class LinkStats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What arrived and what was lost on the way, since the start of the program."""

    bytes: int = 0
    """Bytes received."""
    frames: int = 0
    """Good frames (of an I²C source: samples)."""
    bad_frames: dict[str, int] = {}
    """Damaged frames by reason (protocol/README.md); `partial` is normal after attaching. Of an I²C source:
    restarts of the FIFO by cause (`overflow`, `misaligned`, `out_of_step`, `broken_transfer`)."""
    unknown_type: int = 0
    """Intact frames of a type that this version does not know."""
    refused: int = 0
    """Frames of a device of another protocol version."""
    overflow_bytes: int = 0
    """Bytes thrown away because the program was too slow."""
    reconnects: int = 0
    """Times that the port was opened again."""


class SampleStats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What became of the samples, since the start of the program."""

    delivered: int
    """Samples that went on to the estimator."""
    lost: int
    """Samples missing in gaps."""
    gaps: int
    """Gaps."""
    duplicates: int
    """Samples that came twice and were dropped."""
    before_hello: int
    """Samples that could not be used because their HELLO had not been heard."""
    rate_differs: int = 0
    """Samples that were not used because the device's clock contradicts the rate that its HELLO states."""


class BiasCheck(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Bias(T) against the mean of the next T seconds, over the pieces of T seconds at rest so far."""

    pieces: int
    """Pieces that were compared."""
    rms: float
    """Root mean square of the difference over its σ: 1 where Bias(T) and its σ hold."""


class TrackerStats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the tracker of an axis's bias gets on."""

    model: str
    """The noise that it goes by: the parts of the fit, or `walks` before there is one."""
    nis: float | None
    """Mean normalised innovation squared, 1 where the model holds; null before 200 innovations."""
    lag1: float | None
    """Correlation of neighbouring innovations, 0 where the model holds; null before 200."""
    holds: bool | None
    """Whether the last 1,000 innovations are white; null before 200."""
    moved: int
    """Samples in motion, over which it predicted."""
    restarts: int
    """How often it began again, because the offset was another for ten seconds."""
    K: Interval = Interval()
    """Random walk of the offset that the samples show in time; null where the offset may be constant
    [`unit`/s/√s]."""
    heading_std: dict[int, float] = {}
    """Standard deviation of the heading so many seconds after the last sample at rest: 1, 10, 60, 600, 3,600
    [deg]."""
    bias: float | None = None
    """The bias after the newest sample [`unit`]."""
    bias_std: float | None = None
    """Standard deviation of that bias [`unit`]."""
    steps: int = 0
    """Steps of its bias."""
    moving: bool = False
    """Whether the sensor moves as of the newest sample."""
    checked: dict[int, BiasCheck] = {}
    """Bias(T) against the mean of the next T seconds, by T: 1, 10, 60 s."""
    bias_for_s: float = 1.0
    """The bias is the mean that is expected over so many seconds [s]."""


class AxisStats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the start-up window gave an axis, and how its filters get on."""

    bias: float | None
    """Bias in use (for an accelerometer gravity is in it); null until the start-up window is full
    [`unit`]."""
    R_in_use: float | None
    """Measurement variance in use [`unit` squared]."""
    restarts: int
    """Times that the axis began again in this epoch."""
    interventions: dict[str, int]
    """Samples since the axis's last start in which the guard stepped in, by cause."""
    innovation_lag1: float | None = None
    """Correlation of neighbouring innovations over the last 1,000: 0 ± 0.03 where they are white."""
    innovation_nis: float | None = None
    """Mean normalised innovation squared: 1 where the filter's model is right."""
    unit: str = "deg/s"
    """`deg/s`, or `m/s^2` for axes of the accelerometer."""
    Q_in_use: float | None = None
    """Variance of a step of the noise's source in use, h^2α included; null where a device estimates [`unit`
    squared]."""
    tuned: bool = False
    """Q and R are those of the live fit, and α and f have gone on from its own (`estimator.tuning`)."""
    describes_noise: bool | None = None
    """False: the filters' α and f do not describe the noise: their innovations are not white (Ljung–Box p
    below 0.001), the fit has no order, or α is not within its interval; null at first."""
    tracker: TrackerStats | None = None
    """How the tracker of the axis's bias gets on; null without one."""


class DeviceEstimatorStats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the device's own estimator gets on."""

    begun: int
    """Times since its boot that it began, with a start-up window."""
    startup_remaining: int
    """Samples until its start-up window is full."""
    every: int
    """Samples from one of its estimates to the next."""
    queue: int
    """Samples that wait for it."""
    skipped: int
    """Samples since its boot that it could not take, because it had fallen behind."""
    longest_axis_us: int
    """Longest step of one axis since its boot [µs]."""
    estimates: int
    """Estimates of an axis that came."""
    lost: int
    """Those that the device sent and that did not come."""
    unplaced: int
    """Those that came and fit no sample, since it was lost, is of before the epoch, or 256 samples ago."""
    restarts: dict[str, int]
    """Times since its start-up window that the axis began again."""
    interventions: dict[str, dict[str, int]]
    """Samples since the axis's last start in which its guard stepped in, by cause."""
    fit_every: int = 0
    """Samples from one round of its fits to the next; 0: it makes none."""
    fits: int = 0
    """Fits of an axis that came."""
    fits_refused: int = 0
    """Fits with impossible numbers, or before the first sample."""
    longest_slice_us: int = 0
    """Longest slice of a fit since its boot [µs]."""


class OutputStats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What an output did with its records, since the start of the program."""

    written: int
    """Records that the output has passed on."""
    dropped: int
    """Records that it lost since it was too slow or broken."""
    queued: int
    """Records that wait for it as of now."""
