"""Decide which results of the live fit the FLTEA filter of an axis uses, and when."""

from typing import NamedTuple

from fltea.estimator.bank import Variances
from fltea.estimator.filter_model import FilterModel
from fltea.records.fit import AxisFit, Interval
from fltea.records.plus_minus import NORMAL_95
from fltea.settings.estimator import LARGEST
from fltea.settings.live import TUNED_WITHIN

STEP = 0.1
"""A fitted variance counts as unchanged if it has changed by at most this fraction of the width of its
confidence interval.
"""
LEAST_R = 1e-3
"""R is the variance of the white noise, and s2 that of a step of the state. A filter gets an R of at least
this many times s2, since it needs R > 0. A smaller R cannot be told from 0 by the samples.
"""


class HandedOver(NamedTuple):
    """The variances and the order from one fit.

    A filter has to use all of them together, since each is right only in combination with the others.
    """

    variances: Variances
    filter_model: FilterModel


def handed_over(fit: AxisFit, in_use: Variances | None) -> HandedOver | None:
    """Return what a filter takes from a fit, rounded to three digits; None if it takes nothing.

    It takes s2 (variance of a step of the state), R (variance of the white noise), α and f. All four have to
    come from the same fit: s2 and R may be wrong by a factor of ten although α is right, since a smaller
    state in more white noise has nearly the same spectrum. The result is None in any of these cases:

        The order is not known, or its interval is too wide.
        The noise has passed a low-pass or high-pass filter, which s2 and R do not describe.
        The filter does not accept the order or the variances.
        Both variances are unchanged.

    `in_use`: the variances that the filter uses now; None if they do not come from a fit.
    """
    s2, R = fit.s2.value, fit.R.value
    filter_model = _filter_model(fit)
    if filter_model is None or s2 is None or R is None:
        return None
    if not (1 / LARGEST < LEAST_R * s2 < LEAST_R * LARGEST and 0 <= R < LARGEST):
        return None
    if in_use is not None and not (_has_moved(fit.s2, in_use.Q) or _has_moved(fit.R, in_use.R)):
        return None
    return HandedOver(Variances(_rounded(s2), _rounded(max(R, LEAST_R * s2))), filter_model)


def _filter_model(fit: AxisFit) -> FilterModel | None:
    alpha, F, f = _with_std(fit.alpha), _with_std(fit.F), _with_std(fit.f)
    if fit.low_pass is not None or fit.high_pass is not None or alpha is None or F is None or f is None:
        # The order is not known, or the samples have passed a low-pass or high-pass. In the latter case, the
        # fit describes the noise before that low-pass or high-pass, but the filter sees the noise behind it.
        return None
    filter_model = FilterModel(*alpha, *F, *f)
    return (
        filter_model if filter_model.is_sound and NORMAL_95 * filter_model.alpha_std <= TUNED_WITHIN else None
    )


def _with_std(p: Interval) -> tuple[float, float] | None:
    """Return a figure and its standard deviation, which is computed from the wider side of the 95 % interval.

    Return None if the figure or an end of the interval is not known.
    """
    if p.value is None or p.low is None or p.high is None:
        return None
    return _rounded(p.value), _rounded(max(p.high - p.value, p.value - p.low) / NORMAL_95)


def _has_moved(p: Interval, before: float) -> bool:
    if p.value is None:
        return False
    width = 0.0 if p.low is None or p.high is None else p.high - p.low
    return abs(_rounded(p.value) - before) > STEP * width


def _rounded(value: float) -> float:
    """Round to three digits, since the last digits depend on the processor, which may differ in a replay."""
    return float(f"{value:.3g}")
