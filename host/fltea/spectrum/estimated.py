"""The estimated parameters of each part of a noise model, with their intervals."""

import math
from collections.abc import Sequence

import msgspec

from fltea.noise.part import ROWS
from fltea.noise.parts import Walk, free_of, kind_of, part_of
from fltea.records.fit import Interval
from fltea.records.plus_minus import NORMAL_95
from fltea.spectrum.candidate_models import LEAK_OF_CUBIC, CandidateModels, FittedModel, leaking
from fltea.spectrum.information import slopes
from fltea.spectrum.intervals import LEAST, around, interval_end
from fltea.spectrum.order_fit import of_order

SLOWEST = 300.0
"""The longest correlation time that is tried, divided by the longest one that the data can show."""


class Estimated(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part of a noise model: its parameters with their intervals, in the units of `fltea.noise.parts`."""

    part: str
    values: dict[str, Interval]

    def value(self, name: str) -> float:
        found = self.values[name].value
        assert found is not None
        return found


def estimated(f: CandidateModels, model: FittedModel) -> tuple[Estimated, ...]:
    """Return the parts of a model, each with its parameters and their intervals."""
    found = []
    for code, at in model.terms():
        free = free_of(code)
        part = part_of(code, model.eta[at : at + free], f.h)
        values = of_order(f, model, code, at)
        for k, name in enumerate(part.__struct_fields__):
            value = float(getattr(part, name))
            if name in values:
                continue
            if k >= free:  # a parameter of this kind, such as the number of samples of a mean, is not fitted
                values[name] = Interval(value, value, value)
                continue
            low, high = (
                interval_end(f, model, at + k, side, *_limits(f, code, k, model.eta[at + k], side))
                for side in (-1, 1)
            )
            ends = [
                None if end is None else _at(code, model.eta[at : at + free], k, end, f.h, name)
                for end in (low, high)
            ]
            if kind_of(code) is Walk:
                ends = [_wider(f, model, at, value, end) for end in ends]
            if _falls(ends, value):
                ends.reverse()
            values[name] = Interval(value, *ends)
        in_order = {name: values[name] for name in part.__struct_fields__}
        found.append(Estimated(str(part.__struct_config__.tag), in_order))
    return tuple(found)


def _limits(f: CandidateModels, code: int, k: int, here: float, side: int) -> tuple[float, float]:
    """Return the value at which the search for an end of an interval stops, and the search's first step."""
    one = ROWS[code].free_parameters[k]
    match one.kind:
        case "rate":
            lowest = float(f.data.lam[0])
            return (math.log(lowest / SLOWEST) if side < 0 else math.log(math.pi)), 0.2
        case "number" | "alpha":
            return (one.high if side > 0 else one.low), 0.03
        case "level":
            return around(f, here)[side > 0], 0.1
        case _:
            return here + side * LEAST, 0.1


def _at(code: int, eta: Sequence[float], k: int, end: float, h: float, name: str) -> float:
    there = list(eta)
    there[k] = end
    return float(getattr(part_of(code, there, h), name))


def _falls(ends: Sequence[float | None], value: float) -> bool:
    """Return whether `ends` have the upper end first.

    This is so if the parameter falls as the free parameter rises, to which it was transformed for the fit.
    """
    low, high = ends
    return (low is not None and low > value) or (high is not None and high < value)


def _wider(f: CandidateModels, model: FittedModel, at: int, value: float, end: float | None) -> float | None:
    """Return an end of the interval of K, moved outwards since the power that leaks is uncertain.

    The power that a random walk leaks into all frequencies depends on one random number, the difference
    between the record's last and first sample. So this uncertainty is as large for many frequencies as for
    one.
    """
    if end is None:
        return None
    own = slopes(f, model.codes, model.eta)[1][at] ** 2 * f.data.counts
    leaks = leaking(f.data.lam, f.samples)
    share = float(own[leaks].sum() / own.sum())
    # The leaked power follows χ² with one degree of freedom, so its relative standard deviation is √2. K is
    # the root of a variance, so its relative error is half of the variance's: the 2 at the end.
    more = NORMAL_95 * share * math.sqrt(2) * LEAK_OF_CUBIC / (1 + LEAK_OF_CUBIC) / 2
    distance = math.log(end / value)
    return value * math.exp(math.copysign(math.hypot(distance, more), distance))
