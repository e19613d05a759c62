"""Summarise the evaluation in tables and in words."""

from typing import Any

import numpy as np
from pandas import Categorical, DataFrame, concat

from tools.validation.evaluate.fits import QUANTITIES
from tools.validation.evaluate.settings import LIVE, WHITTLE
from tools.validation.runner import Row
from tools.validation.tables import NONE, Table, number, share_within, table

ERROR = 0.1
"""A figure is called right only if the root mean square error of α is at most this value."""
COVERAGE = 0.9
"""A figure is called right only if at least this proportion of its 95 % intervals contain the true value."""
STRONG = 0.9
"""If the state x has more than this proportion of the noise's power, it is said to dominate the noise."""
FEWEST = 10
"""The ratio of the errors of the live fit and the whole record's fit is shown only if both fits reject white
noise in at least this number of series.
"""


def frame(rows: list[Row], kind: str) -> DataFrame:
    """Return the rows of a kind as a data frame.

    In columns of names, the order of the names is that in which they first appear in `rows`.

    Missing values are NaN.

    The column `right` says whether a figure can be relied on: the error of α is at most ERROR, enough
    intervals contain the true α (COVERAGE), and few values are missing.
    """
    found = DataFrame([row for row in rows if row["kind"] == kind])
    gaps = found.columns[found.isna().any()]
    found[gaps] = found[gaps].astype(float)
    for name in {"estimator", "noise", "change"} & {*found.columns}:
        found[name] = Categorical(found[name], found[name].unique())
    if "rmse" in found:
        good = (found.rmse <= ERROR) & (found.coverage >= COVERAGE)
        found["right"] = good & (found.without <= 0.1 * found.seeds)
    return found


def tables(rows: list[Row]) -> list[Table | str]:
    """Return all tables, and the conclusion."""
    scores = frame(rows, "rows")
    return [
        errors(scores),
        ratios(frame(rows, "pairs"), scores),
        coverages(scores),
        held(frame(rows, "coverage")),
        parts(frame(rows, "composites")),
        claims(frame(rows, "claims")),
        referee(frame(rows, "referee")),
        shifts(frame(rows, "shifts")),
        summary(scores),
        white(scores),
        changes(frame(rows, "changes")),
        conclusion(scores),
    ]


def medians(scores: DataFrame) -> DataFrame:
    """Return medians of α's error and of α's Cramér–Rao bound.

    Each median is over the noises with the same s2/R, the ratio of the variance of the state's steps to that
    of the white noise.
    """
    alpha = _of_order(scores)
    bound = alpha[alpha.estimator == WHITTLE].assign(estimator="bound", rmse=lambda some: some.cramer_rao_sd)
    both = concat([alpha, bound])
    both["estimator"] = Categorical(both.estimator, [*alpha.estimator.cat.categories, "bound"])
    return both.pivot_table(
        "rmse", ["estimator", "samples"], "step_ratio", "median", observed=True, dropna=False
    )


def errors(scores: DataFrame) -> Table:
    """Return a table of the errors of α and of α's Cramér–Rao bound.

    The table has the errors of the filters, with and without the live fit's Q and R, and the errors of the
    fits.
    """
    found = medians(scores)
    cells = [(*_names(at), *(number(one, ".3f") for one in row)) for at, *row in found.itertuples()]
    return Table("Error of α", ("error of α at s2/R", "samples", *(f"{one:g}" for one in found)), cells)


def ratios(pairs: DataFrame, scores: DataFrame) -> Table:
    """Return a table of the live fit's errors divided by those of the whole record's fit.

    The table has a row for each length and each s2/R, the ratio of the variance of the state's steps to that
    of the white noise.

    `median` and `worst` are the median and the largest ratio of the noises. `all` is the root mean square of
    the noises' ratios, in which each noise has the weight of its number of series.
    """
    live = _of_order(scores)[lambda some: some.estimator == LIVE]
    over_bound = (live.rmse / live.cramer_rao_sd).groupby([live.step_ratio, live.samples]).median()
    cells = []
    for (ratio, n), some in pairs.groupby(["step_ratio", "samples"]):
        kept = some[(some.series >= FEWEST) & (some.live_rmse > 0) & (some.whole_rmse > 0)]
        each = kept.live_rmse / kept.whole_rmse
        pooled = np.sqrt((each**2 * kept.series).sum() / kept.series.sum()) if len(kept) else None
        figures = pooled, each.median(), each.max(), over_bound[ratio, n]
        shown = (number(one, ".2f") for one in figures)
        cells.append((f"{ratio:g}", f"{n:,}", f"{len(kept)} of {len(some)}", *shown))
    headings = ("s2/R", "samples", "noises", "live / whole: all", "median", "worst", "of bound")
    return Table("Live over the whole record", headings, cells)


def coverages(scores: DataFrame) -> Table:
    """Return a table that says how often the 95 % intervals contain the true value, over all noises."""
    fits = scores[scores.estimator.isin([LIVE, WHITTLE]) & scores.coverage.notna()]
    known = fits.seeds - fits.without
    cells = []
    for at, some in fits.assign(known=known, held=fits.coverage * known).groupby(
        ["estimator", "samples"], observed=True
    ):
        sums = some.groupby("quantity")[["held", "known"]].sum().reindex(QUANTITIES)
        shares = (number(one, ".1%") for one in sums.held / sums.known)
        cells.append((*_names(at), f"{sums.known.iloc[-1]:,.0f}", *shares))
    return Table("Intervals, all noises", ("fit", "samples", "series", *QUANTITIES), cells)


def held(counts: DataFrame) -> Table:
    """Return a table that says how often the intervals contain the true value, for each of a few noises.

    An undefined interval counts as containing every value. If there are undefined intervals, the cell also
    gives their number, and the number of other intervals that contain the true value.
    """
    cells = []
    for at, some in counts.groupby(["noise", "samples"], observed=True):
        sums = some.groupby("quantity")[["series", "held", "undefined"]].sum().loc[[*QUANTITIES]]
        shares = (_held(*one) for one in sums.itertuples(index=False))
        cells.append((*_names(at), f"{sums.series.iloc[0]:,}", *shares))
    headings = ("held by intervals", "samples", "series", *QUANTITIES)
    return Table("Intervals, noise by noise", headings, cells)


def _held(series: int, held: int, undefined: int) -> str:
    share = share_within(held, series)
    if not undefined:
        return share
    others = f", else {(held - undefined) / (series - undefined):.1%}" if undefined < series else ""
    return f"{share}, {undefined / series:.0%} undefined{others}"


def parts(counts: DataFrame) -> Table:
    """Return how often the intervals for the parts of composite noises contain the true value.

    Only those fits are counted whose model consists of the true parts.
    """
    columns = {
        "composite noise": lambda one: one.noise,
        "quantity": lambda one: one.quantity,
        "same parts": lambda one: f"{one.same} of {one.series}",
        "held": lambda one: share_within(one.held, one.same),
        "with two ends": lambda one: f"{one.told}",
    }
    return table("Intervals of parts", counts.itertuples(), columns)


def claims(counts: DataFrame) -> Table:
    """Return the verdicts on mixtures of relaxations and a part that rises with frequency."""
    columns = {
        "samples": lambda one: f"{one.samples:,}",
        "mixtures": lambda one: f"{one.series}",
        "called fractional": lambda one: f"{one.verdicts.get('fractional', 0)}",
        "verdicts": lambda one: _counts(one.verdicts),
    }
    return table("Mixtures with a rise", counts.itertuples(), columns)


def referee(judged: DataFrame) -> Table:
    """Return a table that compares exact fits with Whittle's fits: their errors of α, and their intervals."""
    columns = {
        "noise": lambda one: one.noise,
        "series": lambda one: str(one.series),
        "exact": lambda one: number(one.exact_rmse, ".3f"),
        "whole / exact": lambda one: number(one.whole_rmse / one.exact_rmse, ".2f"),
        "live / exact": lambda one: number(one.live_rmse / one.exact_rmse, ".2f"),
        "hold α: exact": lambda one: number(one.exact_coverage, ".0%"),
        "whole": lambda one: number(one.whole_coverage, ".0%"),
        "live": lambda one: number(one.live_coverage, ".0%"),
    }
    return table("The exact likelihood", judged.itertuples(), columns)


def shifts(scored: DataFrame) -> Table:
    """Return the results on noises that change."""
    columns = {
        "change": lambda one: one.change,
        "memory": lambda one: "all" if np.isnan(one.memory_s) else f"{one.memory_s:g} s",
        "holds α": lambda one: f"{one.holds} of {one.series}",
        "error α": lambda one: number(one.median_error, ".3f"),
        "verdicts": lambda one: _counts(one.verdicts),
        "left out": lambda one: _counts(one.left_out),
    }
    return table("Noises that change", scored.itertuples(), columns)


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{n} {what}" for what, n in counts.items()) or NONE


def summary(scores: DataFrame) -> Table:
    """Return one row for each estimator and length. Each row summarises all noises that have an order."""
    columns = {
        "estimator": lambda some: str(some.estimator.iloc[0]),
        "samples": lambda some: f"{some.samples.iloc[0]:,}",
        "right": lambda some: _of_all(some.right),
        "error α": lambda some: number(some.rmse.median(), ".2f"),
        "worst bias": lambda some: _worst(some.bias),
        "σ honest": lambda some: _of_all(some.coverage >= COVERAGE),
        "no value": lambda some: number(some.without.sum() / some.seeds.sum(), ".0%"),
    }
    groups = _of_order(scores).groupby(["estimator", "samples"], observed=True)
    return table("Right figures", (some for _, some in groups), columns)


def white(scores: DataFrame) -> Table:
    """Return a table of what each estimator gives for white noise, which has no order."""
    cells = []
    for at, some in scores[scores.alpha.isna()].groupby(["estimator", "samples"], observed=True):
        by_quantity = {one.quantity: one for one in some.itertuples()}
        alpha, f = by_quantity["alpha"], by_quantity["f"]
        claims = 1 - alpha.without / alpha.seeds if at[0] in (LIVE, WHITTLE) else alpha.beyond_zero
        shown = _range(alpha), number(alpha.reported_sd, ".3f"), number(claims, ".0%"), _range(f)
        cells.append((*_names(at), *shown))
    headings = ("on white noise", "samples", "α, 5 to 95 %", "σ", "claims α", "f, 5 to 95 %")
    return Table("White noise", headings, cells)


def changes(scores: DataFrame) -> Table:
    """Return one row for each changed setting.

    Each row summarises the noises with an order, at the greatest length.
    """
    last = scores[(scores.samples == scores.samples.max()) & scores.alpha.notna()]
    relative = last[last.quantity == "f"].assign(error=lambda some: some.median_error / some.f.abs())
    errors_of_f = relative.groupby("estimator", observed=True).error.median()
    columns = {
        "setting": lambda some: some.estimator.iloc[0],
        "right": lambda some: _of_all(some.right),
        "error α": lambda some: number(some.rmse.median(), ".2f"),
        "worst": lambda some: _worst(some.bias),
        "σ": lambda some: number(some.reported_sd.median(), ".3f"),
        "honest": lambda some: _of_all(some.coverage >= COVERAGE),
        "error f": lambda some: number(errors_of_f[some.estimator.iloc[0]], ".0%"),
    }
    groups = _of_order(last).groupby("estimator", observed=True)
    return table("Changed settings", (some for _, some in groups), columns)


def conclusion(scores: DataFrame) -> str:
    """Return the conclusion in plain words."""
    n = scores.samples.max()
    alpha = _of_order(scores)[lambda some: some.samples == n]
    of = dict(iter(alpha.groupby("estimator", observed=True)))
    counts = (f"{name} in {_of_all(of[name].right)}" for name in ("triple", "joint", LIVE, WHITTLE))
    text = (
        f"After {n:,} samples the error of α is at most {ERROR:g}, and its intervals contain the true α, by "
    )
    text += ", ".join(counts) + " noises. "
    strong = of["joint"].x_share >= STRONG
    for some, what in ((of["joint"][strong], "at least"), (of["joint"][~strong], "less than")):
        if len(some):
            text += f"Where x has {what} {STRONG:.0%} of the power joint is right in {_of_all(some.right)}. "
    return text + "No filter can tell white noise from noise with an order. The live fit's verdict can."


def _of_order(scores: DataFrame) -> DataFrame:
    """Return the scores of α for the noises that have an order."""
    return scores[(scores.quantity == "alpha") & scores.alpha.notna()]


def _names(at: tuple[Any, int]) -> tuple[str, str]:
    return str(at[0]), f"{at[1]:,}"


def _of_all(flags: Any) -> str:
    return f"{flags.sum()} of {len(flags)}"


def _worst(values: Any) -> str:
    return NONE if values.isna().all() else f"{values[values.abs().idxmax()]:+.2f}"


def _range(score: Any) -> str:
    return NONE if np.isnan(score.q05) else f"{score.q05:.2f} … {score.q95:.2f}"
