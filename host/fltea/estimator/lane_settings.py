"""Combine an estimator's settings with the values for each lane.

A lane is an independent system in the native engine, such as an axis.
"""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from msgspec.inspect import FloatType
from numpy.typing import NDArray

from fltea.records.arrays import Array
from fltea.settings.estimator import EstimatorConfig
from fltea.settings.setting import Declared, Setting, all_declared

Numbers = float | Sequence[float] | Array

BOX_ORDER = (0.0, 2.0)
"""The range in which a guard keeps the order α."""

NativeArguments = tuple[str, bool, int, bool, int, int, Array]

_DECLARED = all_declared(EstimatorConfig())
_DECLARED |= {path: _DECLARED["R"]._replace(path=path) for path in ("order.R", "parameter.R", "joint.R")}
_DECLARED["h"] = Declared(
    "h", FloatType(), None, Setting("Sampling period.", unit="s", least=1e-12, most=1e12)
)


@dataclass(frozen=True, eq=False)
class LaneSettings:
    """All settings of an engine. Each number may also be an array with one entry for each lane (axis).

    `config`: the filters' settings, with the window in samples. `h`: sampling period [s]. `R`: measurement
    variance. `numbers`: values that replace the values in `config`, by the setting's path in the table
    `estimator`, such as "state.Q". The paths "order.R" and "parameter.R" are variances that one filter uses
    in place of R; "joint.R" replaces Q + R in the joint filter. `accuracy`: number of digits of the
    compressed memory, 3 to 11; 0 means the native default, 6.
    """

    config: EstimatorConfig
    h: Numbers
    R: Numbers
    numbers: Mapping[str, Numbers] = field(default_factory=dict)
    accuracy: int = 0

    def __post_init__(self) -> None:
        if not (self.accuracy == 0 or 3 <= self.accuracy <= 11):
            raise ValueError(f"accuracy must be a number of digits from 3 to 11, or 0, got {self.accuracy}")

    @property
    def kind(self) -> dict[str, object]:
        """The settings that cannot change while an engine runs.

        The engine's memory and filters are made for these settings.
        """
        c = self.config
        return {
            "window": c.window_samples,
            "memory": c.memory,
            "accuracy": self.accuracy,
            "variant": c.variant,
            "guard": c.guard,
        }

    def digest(self, lanes: int) -> str:
        """Return a digest of the settings: two engines with equal digests have equal settings."""
        kind = json.dumps(self.kind, sort_keys=True).encode()
        return hashlib.sha256(kind + self.table(lanes).astype("<f8").tobytes()).hexdigest()

    def table(self, lanes: int) -> Array:
        """Return the numbers of each lane in the order of the native engine, (lanes, 16).

        The columns are:

        - the sampling period h
        - of the state's filter: x0, P0 (initial value and its variance), Q, R
        - of the order's filter: alpha0, P0, Q0, R, delta
        - of the parameter's filter: f0, P0, Q0, R, delta
        - gate: the largest innovation that is not limited, in standard deviations

        delta says how fast a filter's variance Q, at first Q0, follows the changes of the estimate. With
        variant "joint" the joint filter's numbers replace those of order and parameter.

        Raises:
            ValueError: an array has another length, or no filter works with a number. The text names the
            setting's path.
        """
        if lanes < 1:
            raise ValueError(f"an engine needs at least one lane, got {lanes}")
        x0, P0, Q = (self._lanes(f"state.{name}", lanes) for name in ("x0", "P0", "Q"))
        R = self._lanes("R", lanes)
        joint = self.config.variant == "joint"
        starts = ("joint.alpha0", "joint.beta0") if joint else ("order.alpha0", "parameter.f0")
        filters = []
        for start in starts:
            name = start.partition(".")[0]
            own = self._lanes(f"{name}.R", lanes) if f"{name}.R" in self.numbers else Q + R if joint else R
            filters += [self._lanes(start, lanes), *(self._lanes(f"{name}.{n}", lanes) for n in ("P0", "Q0"))]
            filters += [own, self._lanes(f"{name}.delta", lanes)]
        if self.config.guard != "off":
            low, high = BOX_ORDER
            _guarded(starts[0], filters[0], (filters[0] >= low) & (filters[0] <= high))
            if joint:
                _guarded(starts[1], filters[5], (filters[5] >= -2 * 2.0 ** filters[0]) & (filters[5] <= 1))
        columns = [self._lanes("h", lanes), x0, P0, Q, R, *filters, self._lanes("gate", lanes)]
        return np.ascontiguousarray(np.column_stack(columns))

    def native(self, instruction_set: str, table: Array) -> NativeArguments:
        """Return the arguments of each native class that runs the engine.

        `table`: what `self.table` returned.
        """
        c = self.config
        return (
            instruction_set,
            c.variant == "joint",
            ("off", "faithful", "consistent").index(c.guard),
            c.memory == "compressed",
            self.accuracy,
            c.window_samples,
            native_table(table),
        )

    def _lanes(self, path: str, lanes: int) -> Array:
        """Return the value of the setting at `path` for each lane."""
        value = self.numbers.get(path)
        if value is None:
            found: object = self if path in ("h", "R") else self.config
            for name in path.split("."):
                found = getattr(found, name)
            value = found  # type: ignore[assignment]
        array = np.asarray(value, dtype=np.float64)
        if array.shape not in ((), (lanes,)):
            raise ValueError(
                f"{path} must be a number or have one entry for each of {lanes} lanes, "
                f"got shape {array.shape}"
            )
        good = np.atleast_1d(_DECLARED[path].setting.contains(array))
        if not good.all():
            raise ValueError(_DECLARED[path].wrong(float(np.atleast_1d(array)[~good][0])))
        return np.array(np.broadcast_to(array, (lanes,)))


def native_table(table: Array) -> Array:
    """Return `table` for the native engine, which takes ln h in place of the sampling period h."""
    result = table.copy()
    # The logarithm is math.log, since the last digit of numpy's logarithm depends on the processor.
    result[:, 0] = [math.log(h) for h in table[:, 0]]
    return result


def _guarded(path: str, array: Array, good: NDArray[np.bool_]) -> None:
    if not good.all():
        raise ValueError(f"{path} must be within the bounds of the guard, got {array[~good][0]}")
