"""What estimates are worth against the truth (pure)."""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from tools.validation.tables import Z

Array = NDArray[np.float64]


class Score(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Of one quantity over the seeds that have a value; None where there is none, or no truth."""

    seeds: int
    without: int
    """seeds without a value: the lane was lost, or white noise is not rejected, so that it is undefined"""
    mean: float | None
    sd: float | None
    """spread over the seeds"""
    q05: float | None
    q95: float | None
    bias: float | None
    rmse: float | None
    median_error: float | None
    """half of the seeds are nearer to the truth"""
    reported_sd: float | None
    """median of the estimator's own"""
    coverage: float | None
    """share of the 95 % intervals that hold the truth"""
    beyond_zero: float | None
    """share of the estimates that are more than Z of their own σ from 0"""
    cramer_rao_sd: float | None
    sd_over_bound: float | None
    """spread over the Cramér–Rao bound; below 1 only with a bias"""


def score(
    estimate: Array,
    valid: NDArray[np.bool_],
    *,
    truth: float | None = None,
    reported: Array | None = None,
    covered: NDArray[np.bool_] | None = None,
    bound: float | None = None,
) -> Score:
    """Score estimates (seeds,), those that are `valid`.

    covered: whether the interval of each holds the truth; if not given, that is ±Z `reported`.
    """
    good = valid & np.isfinite(estimate)
    values = estimate[good]
    number = len(values)
    if covered is None and reported is not None and truth is not None:
        covered = np.abs(estimate - truth) <= Z * reported
    claims = np.abs(estimate) > Z * reported if reported is not None and number else None
    sd = float(values.std(ddof=1)) if number > 1 else None
    error = values - truth if truth is not None and number else None
    return Score(
        seeds=len(estimate),
        without=len(estimate) - number,
        mean=_round(values.mean()) if number else None,
        sd=_round(sd),
        q05=_round(np.quantile(values, 0.05)) if number else None,
        q95=_round(np.quantile(values, 0.95)) if number else None,
        bias=None if error is None else _round(error.mean()),
        rmse=None if error is None else _round(math.sqrt((error**2).mean())),
        median_error=None if error is None else _round(np.median(np.abs(error))),
        reported_sd=_round(np.median(reported[good])) if reported is not None and number else None,
        coverage=_round(covered[good].mean()) if covered is not None and number else None,
        beyond_zero=None if claims is None else _round(claims[good].mean()),
        cramer_rao_sd=_round(bound),
        sd_over_bound=_round(sd / bound) if sd is not None and bound else None,
    )


def _round(value: float | np.floating | None) -> float | None:
    """Six digits: the seventh is the rounding of whatever library did the sums."""
    return None if value is None else float(f"{value:.6g}")
