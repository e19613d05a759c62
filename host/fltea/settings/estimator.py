"""Settings of the gyroscope estimator; their defaults have one home, filters.toml.

Each filter has its own block, as in the paper. All raise ValueError with the field's name for values that no
filter can work with. R is not here: it belongs to the data of each axis (see `bias`).
"""

import math

import msgspec

from fltea.settings import filters
from fltea.settings.duration import Duration, check

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


class GyroscopeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All of one gyroscope estimator; `window` is the implementation length L, 0: unlimited."""

    window: Duration = filters.WINDOW
    state: StateSettings = StateSettings()
    order: OrderSettings = OrderSettings()
    parameter: ParameterSettings = ParameterSettings()

    def __post_init__(self) -> None:
        if isinstance(self.window, str):
            check("window", self.window, 0)
        elif not 0 <= self.window <= LONGEST_WINDOW:
            raise ValueError(
                f"window must be 1 to {LONGEST_WINDOW} samples, or 0 for an unlimited one, "
                f"got {self.window}; the paper uses 3000"
            )
