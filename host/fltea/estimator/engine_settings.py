"""What the native engine is told; the filters' defaults are those of settings/filters.toml.

Every number may also be an array with one entry a lane. All raise ValueError with the field's name for values
that no filter can work with.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fltea.settings.estimator import EstimatorConfig

Array = NDArray[np.float64]
Numbers = float | Sequence[float] | Array

LARGEST = 1e100
"""No initial value and no variance is larger; no measurement variance is smaller than 1 over it."""

LONGEST = 1 << 32
"""Longest window in samples; a longer one is as good as unlimited."""

BOX_ORDER = (0.0, 2.0)
"""Bounds of α with a guard."""

_PAPER = EstimatorConfig()

FIELDS = (
    "h",
    "state.x0",
    "state.P0",
    "state.Q",
    "state.R",
    "order.alpha0",
    "order.P0",
    "order.Q0",
    "order.R",
    "order.delta",
    "parameter.f0",
    "parameter.P0",
    "parameter.Q0",
    "parameter.R",
    "parameter.delta",
    "gate",
)
"""Columns of `EngineSettings.table`. With variant "joint" those of order and parameter hold `joint`."""


@dataclass(frozen=True, eq=False)
class StateTuning:
    """KFx. x0 in deg/s, the variances in (deg/s)²; Q is that of a whole step, it includes h^2α. R > 0."""

    P0: Numbers = _PAPER.state.P0
    Q: Numbers = _PAPER.state.Q
    x0: Numbers = _PAPER.state.x0
    R: Numbers = 0.0235


@dataclass(frozen=True, eq=False)
class OrderTuning:
    """KFo. P0 = Q0 = 0 holds the order at alpha0; delta is Q's forgetting factor; R None: the state's."""

    P0: Numbers = _PAPER.order.P0
    Q0: Numbers = _PAPER.order.Q0
    alpha0: Numbers = _PAPER.order.alpha0
    R: Numbers | None = None
    delta: Numbers = _PAPER.order.delta


@dataclass(frozen=True, eq=False)
class ParameterTuning:
    """KFw. f0 in s^-α, P0 and Q0 in its square; P0 = Q0 = 0 holds f at f0; R None: the state's."""

    P0: Numbers = _PAPER.parameter.P0
    Q0: Numbers = _PAPER.parameter.Q0
    f0: Numbers = _PAPER.parameter.f0
    R: Numbers | None = None
    delta: Numbers = _PAPER.parameter.delta


@dataclass(frozen=True, eq=False)
class JointTuning:
    """The joint filter on (α, β = h^α f), both without unit: variances of both, and their start.

    R None: Q + R of the state. delta > 0 adapts the filter's Q by Robbins-Monro; small values are worse than
    none.
    """

    P0: Numbers = _PAPER.joint.P0
    """initial variance of α and of β"""
    Q0: Numbers = _PAPER.joint.Q0
    alpha0: Numbers = _PAPER.joint.alpha0
    beta0: Numbers = _PAPER.joint.beta0
    R: Numbers | None = None
    delta: Numbers = _PAPER.joint.delta


@dataclass(frozen=True, eq=False)
class EngineSettings:
    """All of an engine. `h` in s; `window` is L in samples, None (compressed memory only) is unlimited.

    `memory` "direct" is exact and costs O(L) a step; "compressed" costs the same for every L, to within the
    number of digits that `accuracy` asks for (3 to 11; 0 is the native side's default, 6). `gate` is the
    number of standard deviations from which on a guard softens an innovation in KFo, KFw or the joint filter.
    """

    h: Numbers = 0.01
    window: int | None = _PAPER.window_samples
    memory: Literal["direct", "compressed"] = "compressed"
    accuracy: int = 0
    variant: Literal["triple", "joint"] = "triple"
    guard: Literal["off", "faithful", "consistent"] = "off"
    gate: Numbers = _PAPER.gate
    state: StateTuning = field(default_factory=StateTuning)
    order: OrderTuning = field(default_factory=OrderTuning)
    parameter: ParameterTuning = field(default_factory=ParameterTuning)
    joint: JointTuning = field(default_factory=JointTuning)

    def __post_init__(self) -> None:
        for name, value, known in (
            ("memory", self.memory, ("direct", "compressed")),
            ("variant", self.variant, ("triple", "joint")),
            ("guard", self.guard, ("off", "faithful", "consistent")),
        ):
            if value not in known:
                raise ValueError(f"{name} must be one of {', '.join(known)}, got {value!r}")
        if not (self.accuracy == 0 or 3 <= self.accuracy <= 11):
            raise ValueError(f"accuracy must be a number of digits from 3 to 11, or 0, got {self.accuracy}")
        if self.window is None:
            if self.memory == "direct":
                raise ValueError("an unlimited window (None) needs memory='compressed'")
        elif not 1 <= self.window <= LONGEST:
            raise ValueError(
                f"window must be at least 1 sample and at most {LONGEST}, got {self.window}; "
                "the paper uses 3000"
            )

    def table(self, lanes: int) -> Array:
        """Return the settings of `lanes` lanes, shape (lanes, len(FIELDS)).

        Raises ValueError, with the field's name, for arrays of another length and for impossible values.
        """
        if lanes < 1:
            raise ValueError(f"an engine needs at least one lane, got {lanes}")
        column = _Columns(lanes)
        state = self.state
        h = column.positive("h", self.h)
        x0, P0 = column.number("state.x0", state.x0), column.variance("state.P0", state.P0)
        Q, R = column.variance("state.Q", state.Q), column.noise("state.R", state.R)
        if self.variant == "joint":
            joint = self.joint
            names = "joint.alpha0", "joint.beta0"
            walk_R = Q + R if joint.R is None else column.noise("joint.R", joint.R)
            walk_P0, walk_Q0 = column.variance("joint.P0", joint.P0), column.variance("joint.Q0", joint.Q0)
            delta = column.delta("joint.delta", joint.delta)
            order = [column.number(names[0], joint.alpha0), walk_P0, walk_Q0, walk_R, delta]
            parameter = [column.number(names[1], joint.beta0), walk_P0, walk_Q0, walk_R, delta]
            if self.guard != "off":
                lowest = -2 * 2.0 ** order[0]
                column.within(names[1], parameter[0], lowest, np.ones(lanes))
        else:
            names = "order.alpha0", "parameter.f0"
            order, parameter = (
                [
                    column.number(name, start),
                    column.variance(f"{block}.P0", tuning.P0),
                    column.variance(f"{block}.Q0", tuning.Q0),
                    R if tuning.R is None else column.noise(f"{block}.R", tuning.R),
                    column.delta(f"{block}.delta", tuning.delta),
                ]
                for block, name, start, tuning in (
                    ("order", names[0], self.order.alpha0, self.order),
                    ("parameter", names[1], self.parameter.f0, self.parameter),
                )
            )
        if self.guard != "off":
            column.within(names[0], order[0], *(np.full(lanes, bound) for bound in BOX_ORDER))
        gate = column.number("gate", self.gate)
        column.within("gate", gate, np.ones(lanes), np.full(lanes, 1e3))
        return np.ascontiguousarray(np.column_stack([h, x0, P0, Q, R, *order, *parameter, gate]))


def native_table(table: Array) -> Array:
    """Return `table` as the native engine takes it: with ln h in place of h."""
    result = table.copy()
    # math.log and not numpy's, whose last digit depends on the processor.
    result[:, 0] = [math.log(h) for h in table[:, 0]]
    return result


NativeArguments = tuple[str, bool, int, bool, int, int, Array]


def native_arguments(settings: EngineSettings, instruction_set: str, table: Array) -> NativeArguments:
    """What every native class that runs the engine is made with; `table` is settings.table(lanes)."""
    return (
        instruction_set,
        settings.variant == "joint",
        ("off", "faithful", "consistent").index(settings.guard),
        settings.memory == "compressed",
        settings.accuracy,
        settings.window or 0,
        native_table(table),
    )


class _Columns:
    """Turns a field into one number a lane."""

    def __init__(self, lanes: int) -> None:
        self.lanes = lanes

    def number(self, name: str, value: Numbers) -> Array:
        array = np.asarray(value, dtype=np.float64)
        if array.shape not in ((), (self.lanes,)):
            raise ValueError(
                f"{name} must be a number or have one entry for each of {self.lanes} lanes, "
                f"got shape {array.shape}"
            )
        self._all(name, array, np.abs(array) <= LARGEST, f"finite and within {LARGEST:g}")
        return np.array(np.broadcast_to(array, (self.lanes,)))

    def positive(self, name: str, value: Numbers) -> Array:
        array = self.number(name, value)
        self._all(name, array, (array >= 1e-12) & (array <= 1e12), "a time in s between 1e-12 and 1e12")
        return array

    def variance(self, name: str, value: Numbers) -> Array:
        array = self.number(name, value)
        self._all(name, array, array >= 0, "a variance, >= 0")
        return array

    def noise(self, name: str, value: Numbers) -> Array:
        array = self.number(name, value)
        self._all(name, array, array >= 1 / LARGEST, f"a variance, at least {1 / LARGEST:g}")
        return array

    def delta(self, name: str, value: Numbers) -> Array:
        array = self.number(name, value)
        self._all(name, array, (array >= 0) & (array <= 1), "in [0, 1] (0 keeps the process noise constant)")
        return array

    def within(self, name: str, array: Array, low: Array, high: Array) -> None:
        self._all(name, array, (array >= low) & (array <= high), "within the bounds of the guard")

    @staticmethod
    def _all(name: str, array: Array, good: NDArray[np.bool_], what: str) -> None:
        if not np.all(good):
            raise ValueError(f"{name} must be {what}, got {np.atleast_1d(array)[~np.atleast_1d(good)][0]}")
