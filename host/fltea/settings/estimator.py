"""Settings of the gyroscope estimator; their defaults have one home, filters.toml.

Each filter has its own block, as in the paper. All raise ValueError with the field's name for values that no
filter can work with. R is not here: it belongs to the data of each axis (see `bias`).
"""

import math
from typing import Literal, Self

import msgspec

from fltea.settings import filters
from fltea.settings.duration import Duration, check, in_samples, known

LONGEST_WINDOW = 10_000_000
"""Samples; more than a day at 100 Hz, and as much memory as a small computer has to spare."""


def _check_number(name: str, value: float) -> None:
    if not math.isfinite(value):
        raise ValueError(f"{name} must be a finite number, got {value}")


def _check_variance(name: str, value: float) -> None:
    _check_number(name, value)
    if value < 0:
        raise ValueError(f"{name} is a variance and must be >= 0, got {value}")


def _check_delta(value: float) -> None:
    if not 0 <= value <= 1:
        raise ValueError(f"delta must lie in [0, 1] (0 keeps the process noise Q0 constant), got {value}")


class StateSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """KFx, the filter of the state.

    P0: variance of the state at the start, (deg/s)². Q: variance of a whole step, (deg/s)²; it includes h^2α.
    x0: the state at the start, deg/s.
    """

    P0: float = filters.STATE_P0
    Q: float = filters.STATE_Q
    x0: float = filters.STATE_X0

    def __post_init__(self) -> None:
        _check_variance("P0", self.P0)
        _check_variance("Q", self.Q)
        _check_number("x0", self.x0)


class OrderSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """KFo, the filter of the order; all without unit. P0 = Q0 = 0 holds the order at alpha0.

    P0: variance of the order at the start. Q0: variance of its walk, a sample. alpha0: the order at the
    start. delta: how fast the walk's variance follows the innovations; 0: not at all.
    """

    P0: float = filters.ORDER_P0
    Q0: float = filters.ORDER_Q0
    alpha0: float = filters.ORDER_ALPHA0
    delta: float = filters.ORDER_DELTA

    def __post_init__(self) -> None:
        _check_variance("P0", self.P0)
        _check_variance("Q0", self.Q0)
        _check_number("alpha0", self.alpha0)
        _check_delta(self.delta)


class ParameterSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """KFw, the filter of the parameter. P0 = Q0 = 0 holds f at f0.

    P0: variance of f at the start, (s^-α)². Q0: variance of its walk, a sample, (s^-α)². f0: f at the start,
    s^-α. delta: how fast the walk's variance follows the innovations; 0: not at all.
    """

    P0: float = filters.PARAMETER_P0
    Q0: float = filters.PARAMETER_Q0
    f0: float = filters.PARAMETER_F0
    delta: float = filters.PARAMETER_DELTA

    def __post_init__(self) -> None:
        _check_variance("P0", self.P0)
        _check_variance("Q0", self.Q0)
        _check_number("f0", self.f0)
        _check_delta(self.delta)


class JointSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The joint filter on (α, β = h^α f), both without unit.

    P0: variance of either at the start. Q0: variance of the walk of either, a sample. alpha0: α at the start.
    beta0: β at the start. delta: how fast the walk's variance follows the innovations; 0: not at all.
    """

    P0: float = filters.JOINT_P0
    Q0: float = filters.JOINT_Q0
    alpha0: float = filters.JOINT_ALPHA0
    beta0: float = filters.JOINT_BETA0
    delta: float = filters.JOINT_DELTA

    def __post_init__(self) -> None:
        _check_variance("P0", self.P0)
        _check_variance("Q0", self.Q0)
        _check_number("alpha0", self.alpha0)
        _check_number("beta0", self.beta0)
        _check_delta(self.delta)


def _given(value: str | float | list[float]) -> list[float]:
    """The numbers in a setting that may also be a word."""
    if isinstance(value, str):
        return []
    return value if isinstance(value, list) else [value]


EstimateOn = Literal["host", "device", "both"]
"""Who estimates the gyroscope's axes."""

Tuning = Literal["live", "startup"]
"""Who sets the filters' Q and R while they run."""

DEFAULT_TUNING: Tuning = "live"
"""It is right for every noise that was tried (host/docs/evaluation/live.md, Tuned live)."""

BY_DEVICE = ("device", "both")
"""Those of `EstimateOn` for which the device estimates by itself."""


class EstimatorConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The estimator, its start-up window, bias (deg/s) and R ((deg/s)²).

    window: length L of the memory; 0: unlimited. startup: length of the start-up window. Both are in samples,
    or a time ("30 s"), of which `at` makes samples.
    bias: "startup" (its mean), "none", or deg/s, one for all axes or a list. R: "auto" (the variance of the
    start-up window), or (deg/s)², one for all axes or a list.
    estimate_on: "host" (this computer), "device" (an Arduino Due's own estimates, none here) or "both" (the
    Due's, and here with the Due's settings). memory: "compressed" (at a cost that does not depend on the
    window) or "direct" (exact). variant: "triple" (the paper's) or "joint" (one filter on α and h^α f).
    guard: "off" (printed), "faithful" (bounded) or "consistent" (bounded, with the variance that the printed
    algorithm leaves out). gate: standard deviations from which on a guard softens an innovation.
    tuning: "startup": Q of `state` and R of the start-up window or as given, as in the paper; "live": those
    of the live fit as soon as it knows them; None: "live", but "startup" where Q or R is given, and for the
    printed algorithm (guard "off").
    """

    window: Duration = filters.WINDOW
    state: StateSettings = StateSettings()
    order: OrderSettings = OrderSettings()
    parameter: ParameterSettings = ParameterSettings()
    startup: Duration = filters.STARTUP
    bias: Literal["startup", "none"] | float | list[float] = "startup"
    R: Literal["auto"] | float | list[float] = "auto"
    estimate_on: EstimateOn = "host"
    memory: Literal["compressed", "direct"] = "compressed"
    variant: Literal["triple", "joint"] = filters.VARIANT
    guard: Literal["off", "faithful", "consistent"] = filters.GUARD
    joint: JointSettings = JointSettings()
    gate: float = filters.GATE
    tuning: Tuning | None = None

    def __post_init__(self) -> None:
        if isinstance(self.window, str):
            check("window", self.window, 0)
        elif not 0 <= self.window <= LONGEST_WINDOW:
            raise ValueError(
                f"window must be 1 to {LONGEST_WINDOW} samples, or 0 for an unlimited one, "
                f"got {self.window}; the paper uses 3000"
            )
        if not self.window and self.memory == "direct":
            raise ValueError(
                "window 0 is an unlimited one, which only memory compressed has: memory direct keeps every "
                "sample of its window; give its length"
            )
        if not 1 <= self.gate <= 1000:
            raise ValueError(f"gate must be 1 to 1000 standard deviations, got {self.gate:g}")
        check("startup", self.startup, 2)
        if any(not math.isfinite(r) or r <= 0 for r in _given(self.R)):
            raise ValueError("R is a variance and must be a positive number")
        if not all(math.isfinite(b) for b in _given(self.bias)):
            raise ValueError("bias must be finite numbers")

    @property
    def tuned_by(self) -> Tuning:
        """What `tuning` comes to."""
        if self.tuning is not None:
            return self.tuning
        given = self.R != "auto" or self.state.Q != type(self)().state.Q
        return "startup" if given or self.guard == "off" else DEFAULT_TUNING

    def at(self, rate_hz: float) -> Self:
        """The same with times as samples at a rate.

        Raises:
            ValueError: a window that no filter can keep.
        """
        window = in_samples(self.window, rate_hz, 1)
        startup = in_samples(self.startup, rate_hz, 2)
        if (window, startup) == (self.window, self.startup):
            return self
        return msgspec.structs.replace(self, window=window, startup=startup)

    @property
    def window_samples(self) -> int:
        """`window`, once `at` has made samples of it."""
        return known("window", self.window)

    @property
    def startup_samples(self) -> int:
        """`startup`, once `at` has made samples of it."""
        return known("startup", self.startup)

    @property
    def startup_needed(self) -> int:
        """Samples that the start-up window takes: none if neither bias nor R is drawn from it."""
        return self.startup_samples if self.bias == "startup" or self.R == "auto" else 0


class AccelConfig(EstimatorConfig, frozen=True, forbid_unknown_fields=True):
    """The same for axes of the accelerometer, in m/s² in place of deg/s."""

    state: StateSettings = StateSettings(P0=filters.ACCEL_STATE_P0, Q=filters.ACCEL_STATE_Q)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.estimate_on in BY_DEVICE:
            raise ValueError(
                f"estimate_on {self.estimate_on} is not for the accelerometer: a device estimates its "
                "gyroscope only; leave accel.estimate_on at host"
            )
