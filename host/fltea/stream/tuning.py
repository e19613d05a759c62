"""What the live fit hands to the filters of an axis, and when (pure)."""

from typing import NamedTuple

from fltea.estimator.bank import Variances
from fltea.estimator.filter_model import FilterModel
from fltea.records.fit import AxisFit, Interval
from fltea.records.plus_minus import NORMAL_95
from fltea.settings.estimator import LARGEST
from fltea.settings.live import TUNED_WITHIN

STEP = 0.1
"""Of its interval: a figure that has moved by less is the same."""
LEAST_R = 1e-3
"""Of s2: the data cannot tell less from none, and a filter needs some."""


class HandedOver(NamedTuple):
    """The answer of one fit: its parts go together, and no filter is told one of them without the others."""

    variances: Variances
    belief: FilterModel


def handed_over(fit: AxisFit, in_use: Variances | None) -> HandedOver | None:
    """s2 and R of a fit that has an order, and that order, to three digits; None where it is not known.

    s2 and R may each be open by a factor of ten where α is known: more white noise and less of the state
    look nearly the same, and only the α and f of the same fit go with them. Behind a low-pass or a high-pass,
    whose output no Q and R describe, nothing is handed over, nor is an order beyond what filters take.
    in_use: the variances that it handed over before, if any; None too where both are still the same.
    """
    s2, R = fit.s2.value, fit.R.value
    belief = _belief(fit)
    if belief is None or s2 is None or R is None:
        return None
    if not (1 / LARGEST < LEAST_R * s2 < LEAST_R * LARGEST and 0 <= R < LARGEST):
        return None
    if in_use is not None and not (_has_moved(fit.s2, in_use.Q) or _has_moved(fit.R, in_use.R)):
        return None
    return HandedOver(Variances(_rounded(s2), _rounded(max(R, LEAST_R * s2))), belief)


def _belief(fit: AxisFit) -> FilterModel | None:
    alpha, F, f = _with_std(fit.alpha), _with_std(fit.F), _with_std(fit.f)
    if fit.low_pass is not None or fit.high_pass is not None or alpha is None or F is None or f is None:
        return None  # behind a filter: these are of a filter's input, while the filters see its output
    belief = FilterModel(*alpha, *F, *f)
    return belief if belief.is_sound and NORMAL_95 * belief.alpha_std <= TUNED_WITHIN else None


def _with_std(p: Interval) -> tuple[float, float] | None:
    """A figure and its deviation, by the wider side of its interval; None where one of the ends is open."""
    if p.value is None or p.low is None or p.high is None:
        return None
    return _rounded(p.value), _rounded(max(p.high - p.value, p.value - p.low) / NORMAL_95)


def _has_moved(p: Interval, before: float) -> bool:
    if p.value is None:
        return False
    width = 0.0 if p.low is None or p.high is None else p.high - p.low
    return abs(_rounded(p.value) - before) > STEP * width


def _rounded(value: float) -> float:
    """The last digits depend on the kind of processor, which may be another in a replay."""
    return float(f"{value:.3g}")
