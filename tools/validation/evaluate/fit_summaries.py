"""What the evaluation says of the maximum-likelihood fits, as rows for people (pure)."""

from collections.abc import Iterable, Sequence

import numpy as np

from tools.validation.evaluate.coverage import Coverage
from tools.validation.evaluate.fits import QUANTITIES
from tools.validation.evaluate.run import LIVE, WHITTLE, Pair, Result, Row
from tools.validation.tables import number, share_within

RATIO_HEADINGS = ("s2/R", "samples", "noises", "live / whole: all", "median", "worst", "of bound")
COVERAGE_HEADINGS = ("fit", "samples", "series", *QUANTITIES)
HELD_HEADINGS = ("held by intervals", "samples", "series", *QUANTITIES)
ERROR_HEADINGS = ("error of α at s2/R", "samples")
REFEREE_HEADINGS = (
    "noise",
    "series",
    "exact",
    "whole / exact",
    "live / exact",
    "hold α: exact",
    "whole",
    "live",
)
ALARM_HEADINGS = ("white noise", "samples", "fit", "series", "at 5 %", "at 1 %")
SHIFT_HEADINGS = ("change", "memory", "holds α", "error α", "verdicts", "left out")
FEWEST = 10
"""Series in which white noise is rejected by both fits, for a ratio to be shown."""

Table = list[tuple[str, ...]]


def ratios(result: Result) -> Table:
    """Errors of the live fit over the whole record's, by s2/R and length."""
    rows: Table = []
    for ratio in step_ratios(result):
        for n in result.plan.lengths:
            pairs = [p for p in result.pairs if (p.case.step_ratio, p.samples) == (ratio, n)]
            kept = [p for p in pairs if p.series >= FEWEST and p.ratio is not None]
            each = [p.ratio for p in kept if p.ratio is not None]
            shown = ("–", "–", "–")
            if each:
                shown = (f"{pooled(kept):.2f}", f"{np.median(each):.2f}", f"{max(each):.2f}")
            rows.append(
                (
                    f"{ratio:g}",
                    f"{n:,}",
                    f"{len(kept)} of {len(pairs)}",
                    *shown,
                    _over_bound(result, ratio, n),
                )
            )
    return rows


def pooled(pairs: Sequence[Pair]) -> float:
    """Of all series of all noises, those of each noise in units of the whole record's error."""
    squares = [(p.ratio or 0.0) ** 2 * p.series for p in pairs]
    return float(np.sqrt(sum(squares) / sum(p.series for p in pairs)))


def coverages(result: Result) -> Table:
    """Shares of all 95 % intervals of all noises that hold the truth."""
    rows: Table = []
    for estimator in (LIVE, WHITTLE):
        for n in result.plan.lengths:
            shares, number = [], 0
            for quantity in QUANTITIES:
                share, number = coverage(_of(result.rows, estimator, quantity, n))
                shares.append("–" if share is None else f"{share:.1%}")
            rows.append((estimator, f"{n:,}", f"{number:,}", *shares))
    return rows


def held(result: Result) -> Table:
    """The same of a few noises each by itself, with the interval of the share.

    Where there are undefined ones, which hold everything, their share comes after, and how many of the others
    hold the truth.
    """
    cells: dict[tuple[str, int], list[Coverage]] = {}
    for one in result.coverage:
        cells.setdefault((one.point.name, one.samples), []).append(one)
    return [(name, f"{n:,}", f"{each[0].series:,}", *map(_held, each)) for (name, n), each in cells.items()]


def _held(one: Coverage) -> str:
    share = share_within(one.held, one.series)
    if not one.undefined:
        return share
    others = "" if one.share_of_defined is None else f", else {one.share_of_defined:.1%}"
    return f"{share}, {one.undefined / one.series:.0%} undefined{others}"


def coverage(rows: Iterable[Row]) -> tuple[float | None, int]:
    """Share of the intervals that hold the truth, and their number."""
    held, number = 0.0, 0
    for score in (row.score for row in rows):
        if score.coverage is not None:
            held += score.coverage * (score.seeds - score.without)
            number += score.seeds - score.without
    return (held / number if number else None), number


def errors(result: Result) -> tuple[tuple[str, ...], Table]:
    """Headings, and the median over the noises of α's error, by s2/R: before and after, and the bound."""
    names = list(dict.fromkeys(row.estimator for row in result.rows))
    by_ratio = step_ratios(result)
    rows: Table = []
    for name in [*names, "bound"]:
        for n in result.plan.lengths:
            cells = []
            for ratio in by_ratio:
                scores = [
                    row.score
                    for row in _of(result.rows, WHITTLE if name == "bound" else name, "alpha", n)
                    if row.case.step_ratio == ratio
                ]
                values = [s.cramer_rao_sd if name == "bound" else s.rmse for s in scores]
                known = [value for value in values if value is not None]
                cells.append(f"{np.median(known):.3f}" if known else "–")
            rows.append((name, f"{n:,}", *cells))
    return (*ERROR_HEADINGS, *(f"{ratio:g}" for ratio in by_ratio)), rows


def referee(result: Result) -> Table:
    """The exact likelihood beside Whittle's."""
    return [
        (
            one.case.name,
            str(one.series),
            number(one.exact_rmse, ".3f"),
            number(_over(one.whole_rmse, one.exact_rmse), ".2f"),
            number(_over(one.live_rmse, one.exact_rmse), ".2f"),
            *(number(share, ".0%") for share in (one.exact_coverage, one.whole_coverage, one.live_coverage)),
        )
        for one in result.referee
    ]


def alarms(result: Result) -> Table:
    """False alarms of the null test."""
    return [
        (
            one.noise,
            f"{one.samples:,}",
            one.estimator,
            f"{one.series:,}",
            f"{one.rejected / one.series:.1%}",
            f"{one.rejected_1 / one.series:.1%}",
        )
        for one in result.alarms
    ]


def shifts(result: Result) -> Table:
    """Noises that change."""
    return [
        (
            one.shift,
            "all" if one.memory_s is None else f"{one.memory_s:g} s",
            f"{one.holds} of {one.series}",
            f"{one.median_error:.3f}",
            ", ".join(f"{count} {kind}" for kind, count in one.verdicts.items()),
            ", ".join(f"{count} {cause}" for cause, count in one.left_out.items()) or "–",
        )
        for one in result.shifts
    ]


def step_ratios(result: Result) -> list[float]:
    """Of the grid."""
    return list(dict.fromkeys(c.step_ratio for c in result.plan.grid if c.step_ratio is not None))


def _over_bound(result: Result, ratio: float, n: int) -> str:
    """Median of the live fit's error over the bound."""
    scores = [row.score for row in _of(result.rows, LIVE, "alpha", n) if row.case.step_ratio == ratio]
    each = [s.rmse / s.cramer_rao_sd for s in scores if s.rmse and s.cramer_rao_sd]
    return f"{np.median(each):.2f}" if each else "–"


def _of(rows: Sequence[Row], estimator: str, quantity: str, n: int) -> list[Row]:
    return [r for r in rows if (r.estimator, r.quantity, r.samples) == (estimator, quantity, n)]


def _over(a: float | None, b: float | None) -> float | None:
    return a / b if a and b else None
