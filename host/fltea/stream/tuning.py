"""What the live fit hands to the filters of an axis, and when (pure)."""

from fltea.estimator.bank import Variances
from fltea.records.fit import AxisFit, Interval
from fltea.settings.estimator import LARGEST
from fltea.settings.live import TUNED_WITHIN

STEP = 0.1
"""Of its interval: a figure that has moved by less is the same."""


def handed_over(fit: AxisFit, in_use: Variances | None) -> Variances | None:
    """s2 and R of a fit that has an order, to three digits; None where they are not known well enough.

    Behind a low-pass, whose output no Q and R describe, they are never handed over, and an order that no F
    describes is none that the filters know. in_use: what it handed over before, if anything; None too where
    both are still the same.
    """
    s2, R = fit.s2, fit.R
    if not (_is_known(s2) and _is_known(R)) or fit.F.value is None or fit.low_pass is not None:
        return None  # of a filter's input, while the filters see its output
    if in_use is not None and not (_has_moved(s2, in_use.Q) or _has_moved(R, in_use.R)):
        return None
    return Variances(_rounded(s2), _rounded(R))


def _is_known(p: Interval) -> bool:
    if p.value is None or p.low is None or p.high is None:
        return False
    return 1 / LARGEST < p.low <= p.value <= p.high <= min(TUNED_WITHIN * p.low, LARGEST)


def _has_moved(p: Interval, before: float) -> bool:
    if p.value is None or p.low is None or p.high is None:
        return False
    return abs(p.value - before) > STEP * (p.high - p.low)


def _rounded(p: Interval) -> float:
    """The last digits of a fit depend on where it was begun, which differs between a run and its replay."""
    return float(f"{p.value:.3g}")
