"""Score estimates against the true values."""

import numpy as np
from fltea.records.arrays import Array
from numpy.typing import NDArray

from tools.validation.runner import Row
from tools.validation.tables import Z


def score(
    estimate: Array,
    valid: NDArray[np.bool_],
    *,
    truth: float | None = None,
    reported: Array | None = None,
    covered: NDArray[np.bool_] | None = None,
    bound: float | None = None,
) -> Row:
    """Score the estimates (seeds,) of one quantity. Only those that are `valid` count.

    `covered`: whether the interval of each estimate contains the true value. By default the interval is ±Z
    times `reported`, the σ that the estimator reports.

    The row has the following columns. If there is no estimate or no true value, columns that need one are
    None. `seeds`; `without`, number of seeds without an estimate, since the filter was restarted or white
    noise was not rejected; `mean`; `sd`, the standard deviation over the seeds; `q05` and `q95`, the 5 % and
    95 % quantiles; `bias`; `rmse`; `median_error`, the median of the absolute error; `reported_sd`, the
    median of the σ that the estimator reports; `coverage`, the proportion of the 95 % intervals that contain
    the true value; `beyond_zero`, the proportion of the estimates that differ from 0 by more than Z of their
    own σ; `cramer_rao_sd`, the Cramér–Rao bound of `sd`; `sd_over_bound`, `sd` divided by this bound, which
    is below 1 only for biased estimates.
    """
    good = valid & np.isfinite(estimate)
    values, number = estimate[good], int(good.sum())
    found: Row = {"seeds": len(estimate), "without": len(estimate) - number}
    figures: dict[str, float | None] = dict.fromkeys(
        (
            *("mean", "sd", "q05", "q95", "bias", "rmse", "median_error", "reported_sd", "coverage"),
            *("beyond_zero", "cramer_rao_sd", "sd_over_bound"),
        )
    )
    figures["cramer_rao_sd"] = bound
    if number > 1:
        figures["sd"] = sd = float(values.std(ddof=1))
        figures["sd_over_bound"] = sd / bound if bound else None
    if number:
        figures |= {"mean": values.mean(), "q05": np.quantile(values, 0.05), "q95": np.quantile(values, 0.95)}
        if truth is not None:
            error = values - truth
            figures |= {"bias": error.mean(), "rmse": np.sqrt((error**2).mean())}
            figures["median_error"] = np.median(np.abs(error))
        if reported is not None:
            figures["reported_sd"] = np.median(reported[good])
            figures["beyond_zero"] = (np.abs(estimate) > Z * reported)[good].mean()
            if covered is None and truth is not None:
                covered = np.abs(estimate - truth) <= Z * reported
        if covered is not None:
            figures["coverage"] = covered[good].mean()
    # Keep six digits, since the seventh depends on the rounding of the library that computed the sums.
    rounded = {name: None if one is None else float(f"{one:.6g}") for name, one in figures.items()}
    return found | rounded
