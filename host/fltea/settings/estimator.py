"""The settings of an estimator: the tables `estimator` and `accel` of the TOML file."""

from typing import Annotated, Literal, Self

import msgspec

from fltea.settings.duration import Duration, in_samples, known
from fltea.settings.setting import Setting, Table

LARGEST = 1e100
"""Largest number, and largest variance, that a filter's settings may have. The smallest allowed variance of a
measurement is 1 / LARGEST.
"""

LONGEST_WINDOW = 10_000_000
"""Longest allowed window, which is the length of the algorithm's memory [samples]. It is more than a day at
100 Hz, and still fits into the memory of a small computer.
"""

LONGEST_GAP = 1_000_000
"""Longest gap that the filters may bridge [samples]. It is three hours at 100 Hz. The filters make a step for
each missing sample, so a gap of this length takes them seconds.
"""

SQUARED = "(deg/s)²"
DELTA = Setting(
    "Forgetting factor of Robbins and Monro: how fast the variance Q of the random walk follows the "
    "innovations. 0: Q stays Q0.",
    least=0,
    most=1,
    board=True,
)


def _number(meaning: str, unit: str = "") -> Setting:
    return Setting(meaning, unit=unit, least=-LARGEST, most=LARGEST, board=True)


def _variance(meaning: str, unit: str = "") -> Setting:
    return Setting(meaning, unit=unit, least=0, most=LARGEST, board=True)


class StateSettings(Table, frozen=True):
    """Settings of KFx, the paper's Kalman filter of the state x of the noise."""

    P0: Annotated[float, _variance("Initial variance P of the state.", SQUARED)] = 0.01
    Q: Annotated[float, _variance("Variance of one step of the noise, h^2α included.", SQUARED)] = 0.15
    x0: Annotated[float, _number("Initial state x.", "deg/s")] = 0.0


class OrderSettings(Table, frozen=True):
    """Settings of KFo, the paper's Kalman filter of the order α. P0 = Q0 = 0 keeps the order at alpha0."""

    P0: Annotated[float, _variance("Initial variance P of the order.")] = 0.01
    Q0: Annotated[float, _variance("Initial variance Q of one step of the order, which walks at random.")] = (
        0.1
    )
    alpha0: Annotated[float, _number("Initial order α.")] = 1.0
    delta: Annotated[float, DELTA] = 0.5


class ParameterSettings(Table, frozen=True):
    """Settings of KFw, the paper's Kalman filter of the parameter f. P0 = Q0 = 0 keeps f at f0."""

    P0: Annotated[float, _variance("Initial variance P of the parameter f.", "(s^-α)²")] = 0.01
    Q0: Annotated[
        float, _variance("Initial variance Q of one step of f, which walks at random.", "(s^-α)²")
    ] = 0.1
    f0: Annotated[float, _number("Initial parameter f.", "s^-α")] = 0.0
    delta: Annotated[float, DELTA] = 0.5


class JointSettings(Table, frozen=True):
    """Settings of the joint filter of α and β = h^α f (h: the sampling period). Neither has a unit."""

    P0: Annotated[float, _variance("Initial variance P of α and of β = h^α f.")] = 0.06
    Q0: Annotated[float, _variance("Initial variance Q of one step of α and of β, which walk at random.")] = (
        0.0
    )
    alpha0: Annotated[float, _number("Initial order α.")] = 0.5
    beta0: Annotated[float, _number("Initial β = h^α f.")] = -0.1
    delta: Annotated[float, DELTA] = 0.0


EstimateOn = Literal["host", "device", "both"]
"""Which computer estimates the gyroscope's axes."""

Tuning = Literal["live", "startup"]
"""Where the filters get their variances Q (of a step of the state) and R (of the measurement). "startup":
from the settings or the start-up window. "live": in the same way at first, and from the live fit once it
knows them.
"""

DEFAULT_TUNING: Tuning = "live"
"""Default value of the setting `tuning`. With "live", the estimates have smaller errors for most noises, and
their σ agrees with these errors (host/docs/evaluation/live.md, Tuned live).
"""

BY_DEVICE = ("device", "both")
"""Values of `EstimateOn` for which the device runs its own estimator."""


# Why more than 12 attributes: each is one setting of the TOML file.
class EstimatorConfig(Table, frozen=True):
    """Settings of an estimator: its filters, start-up window, bias and R, the variance of the measurement.

    Defaults of the filters: the paper, section 7.1.
    """

    window: Annotated[
        Duration,
        Setting(
            "Length L of the filters' memory, a number of samples or a time; 0: unlimited (with memory "
            "`compressed`).",
            unit="samples",
            least=0,
            most=LONGEST_WINDOW,
            time=True,
            flags=("--window", "-L"),
            metavar="N|TIME",
        ),
    ] = 3000
    startup: Annotated[
        Duration,
        Setting(
            "Length of the start-up window, a number of samples or a time. Bias and R are computed from it, "
            "so keep the sensor at rest.",
            unit="samples",
            least=2,
            most=LONGEST_WINDOW,
            time=True,
            flags=("--startup",),
            metavar="N|TIME",
            board=True,
        ),
    ] = 500
    bias: Annotated[
        Literal["startup", "none"] | float | list[float],
        Setting(
            "The bias that is subtracted from every sample: `startup` (mean of the start-up window), "
            "`none`, a number, or a number for each axis: 0.1,0,-0.2.",
            unit="deg/s",
            least=-LARGEST / 2,
            most=LARGEST / 2,
            flags=("--bias",),
        ),
    ] = "startup"
    R: Annotated[
        Literal["auto"] | float | list[float],
        Setting(
            "Measurement variance: `auto` (variance of the start-up window), a number, or a number for "
            "each axis.",
            unit=SQUARED,
            least=1 / LARGEST,
            most=LARGEST,
            flags=("--r",),
        ),
    ] = "auto"
    estimate_on: Annotated[
        EstimateOn,
        Setting(
            "Which computer estimates the gyroscope: `host` (this one), `device` (the Arduino Due), or "
            "`both`, with the difference.",
            flags=("--estimate-on",),
        ),
    ] = "host"
    memory: Annotated[
        Literal["compressed", "direct"],
        Setting(
            "Memory of past states: `compressed` (fast) or `direct` (exact).",
            flags=("--memory",),
        ),
    ] = "compressed"
    variant: Annotated[
        Literal["triple", "joint"],
        Setting(
            "`triple`: the three filters of the paper. `joint`: one filter for α and h^α f.",
            flags=("--variant",),
            board=True,
        ),
    ] = "joint"
    guard: Annotated[
        Literal["off", "faithful", "consistent"],
        Setting(
            "`off`: the algorithm as printed. `faithful`: with bounds. `consistent`: with bounds, and with "
            "the variance that the printed algorithm leaves out.",
            flags=("--guard",),
            board=True,
        ),
    ] = "consistent"
    gate: Annotated[
        float,
        Setting(
            "The guard softens larger innovations.",
            unit="standard deviations",
            least=1,
            most=1000,
            board=True,
        ),
    ] = 10.0
    tuning: Annotated[
        Tuning | None,
        Setting(
            "Source of the filters' Q and R: `live` (the live fit, once it knows them) or `startup` (the "
            "start-up window, as in the paper). Unset: `live`; if Q or R is given or guard is `off`, "
            "`startup`.",
            flags=("--tuning",),
            example="startup",
        ),
    ] = None
    state: StateSettings = StateSettings()
    order: OrderSettings = OrderSettings()
    parameter: ParameterSettings = ParameterSettings()
    joint: JointSettings = JointSettings()

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.window and self.memory == "direct":
            raise ValueError(
                "window 0 means an unlimited window, which is possible only with memory compressed; memory "
                "direct keeps every sample of its window, so give a length"
            )

    @property
    def tuned_by(self) -> Tuning:
        """The value of the setting `tuning`. If the setting is unset, this is the default."""
        if self.tuning is not None:
            return self.tuning
        given = self.R != "auto" or self.state.Q != type(self)().state.Q
        return "startup" if given or self.guard == "off" else DEFAULT_TUNING

    def at(self, rate_hz: float) -> Self:
        """Return these settings with times converted to numbers of samples at `rate_hz`.

        Raises:
            ValueError: a window is too long for the filters.
        """
        window = in_samples(self.window, rate_hz, 1)
        startup = in_samples(self.startup, rate_hz, 2)
        if (window, startup) == (self.window, self.startup):
            return self
        return msgspec.structs.replace(self, window=window, startup=startup)

    @property
    def window_samples(self) -> int:
        """The setting `window` in samples. A setting in seconds has to be converted by `at` first."""
        return known("window", self.window)

    @property
    def startup_samples(self) -> int:
        """The setting `startup` in samples. A setting in seconds has to be converted by `at` first."""
        return known("startup", self.startup)

    @property
    def startup_needed(self) -> int:
        """Length of the start-up window in samples; 0 if neither the bias nor R comes from this window."""
        return self.startup_samples if self.bias == "startup" or self.R == "auto" else 0


class AccelConfig(EstimatorConfig, frozen=True):
    """The settings of `EstimatorConfig` for the axes of the accelerometer, with m/s² in place of deg/s.

    The default variances are those for the gyroscope, scaled by the ratio of the two sensors' noise. The
    variance of a resting MPU-6050's accelerometer is 9e-4 (m/s²)², and that of the paper's gyroscope is 0.02
    (deg/s)².
    """

    state: StateSettings = StateSettings(P0=0.00045, Q=0.00675)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.estimate_on in BY_DEVICE:
            raise ValueError(
                f"estimate_on {self.estimate_on} is not for the accelerometer: a device estimates its "
                "gyroscope only; leave accel.estimate_on at host"
            )
