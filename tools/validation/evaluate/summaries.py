"""What the evaluation says, as rows for people and for programs (pure)."""

from collections.abc import Sequence

import numpy as np

from tools.validation.evaluate.run import LIVE, WHITTLE, Result, Row
from tools.validation.evaluate.score import Score

ERROR = 0.1
"""Largest root mean square error of α of a figure that is called right."""
COVERAGE = 0.9
"""Least share of its 95 % intervals that hold the truth."""

SUMMARY_HEADINGS = ("estimator", "samples", "right", "error α", "worst bias", "σ honest", "no value")
WHITE_HEADINGS = ("on white noise", "samples", "α, 5 to 95 %", "σ", "claims α", "f, 5 to 95 %")
CHANGE_HEADINGS = ("setting", "right", "error α", "worst", "σ", "honest", "error f")


def right(score: Score) -> bool:
    """A figure to rely on: α within ERROR, an interval that holds it, and hardly ever none."""
    if score.rmse is None or score.coverage is None:
        return False
    return score.rmse <= ERROR and score.coverage >= COVERAGE and score.without <= 0.1 * score.seeds


def summary(result: Result) -> list[tuple[str, ...]]:
    """A row for each estimator and length, over the noises that have an order."""
    rows: list[tuple[str, ...]] = []
    for estimator in _names(result.rows):
        for n in result.plan.lengths:
            scores = [row.score for row in _of(result.rows, estimator, "alpha", n) if row.case.alpha]
            rows.append(
                (
                    estimator,
                    f"{n:,}",
                    f"{sum(map(right, scores))} of {len(scores)}",
                    _median([s.rmse for s in scores], ".2f"),
                    _worst([s.bias for s in scores]),
                    f"{sum((s.coverage or 0) >= COVERAGE for s in scores)} of {len(scores)}",
                    _percent(sum(s.without for s in scores) / sum(s.seeds for s in scores)),
                )
            )
    return rows


def white(result: Result) -> list[tuple[str, ...]]:
    """What each estimator gives for white noise, where there is no order."""
    rows: list[tuple[str, ...]] = []
    for estimator in _names(result.rows):
        for n in result.plan.lengths:
            alphas, fs = (
                [row.score for row in _of(result.rows, estimator, quantity, n) if row.case.alpha is None]
                for quantity in ("alpha", "f")
            )
            for alpha, f in zip(alphas, fs, strict=True):
                claims = (
                    _percent(1 - alpha.without / alpha.seeds)
                    if estimator in (LIVE, WHITTLE)
                    else _percent(alpha.beyond_zero)
                )
                rows.append(
                    (estimator, f"{n:,}", _range(alpha), _number(alpha.reported_sd), claims, _range(f))
                )
    return rows


def changes(result: Result) -> list[tuple[str, ...]]:
    """A row for each setting, over the noises with an order, after the longest length."""
    n = result.plan.changed_lengths[-1]
    rows: list[tuple[str, ...]] = []
    for estimator in _names(result.changes):
        alphas, fs = (
            [row for row in _of(result.changes, estimator, quantity, n) if row.case.alpha]
            for quantity in ("alpha", "f")
        )
        scores = [row.score for row in alphas]
        relative = [
            None if row.score.median_error is None else row.score.median_error / abs(row.case.f or 1)
            for row in fs
        ]
        rows.append(
            (
                estimator,
                f"{sum(map(right, scores))} of {len(scores)}",
                _median([s.rmse for s in scores], ".2f"),
                _worst([s.bias for s in scores]),
                _median([s.reported_sd for s in scores], ".3f"),
                f"{sum((s.coverage or 0) >= COVERAGE for s in scores)} of {len(scores)}",
                _median(relative, ".0%"),
            )
        )
    return rows


def conclusion(result: Result) -> str:
    """In plain words."""
    n = result.plan.lengths[-1]
    sentences = []
    for estimator in ("triple", "joint", LIVE, WHITTLE):
        good = [r for r in _of(result.rows, estimator, "alpha", n) if r.case.alpha]
        count = sum(right(row.score) for row in good)
        sentences.append(f"{estimator} in {count} of {len(good)}")
    text = f"After {n:,} samples α is right to {ERROR:g}, with an interval that holds it, by "
    text += ", ".join(sentences) + " noises. "
    joint = [r for r in _of(result.rows, "joint", "alpha", n) if r.case.alpha]
    strong = [r for r in joint if r.case.noise.x_share >= STRONG]
    weak = [r for r in joint if r.case.noise.x_share < STRONG]
    for rows, what in ((strong, "at least"), (weak, "less than")):
        if rows:
            count = sum(right(r.score) for r in rows)
            text += f"Where x has {what} {STRONG:.0%} of the power joint is right in {count} of {len(rows)}. "
    return text + "No filter knows white noise from noise with an order: the live fit's null test does."


STRONG = 0.9
"""Share of the power from which on x is nearly all there is."""


def _names(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(row.estimator for row in rows))


def _of(rows: Sequence[Row], estimator: str, quantity: str, n: int) -> list[Row]:
    return [r for r in rows if (r.estimator, r.quantity, r.samples) == (estimator, quantity, n)]


def _median(values: Sequence[float | None], form: str) -> str:
    known = [value for value in values if value is not None]
    return format(float(np.median(known)), form) if known else "–"


def _worst(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    return f"{max(known, key=abs):+.2f}" if known else "–"


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{share:.0%}"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def _range(score: Score) -> str:
    if score.q05 is None or score.q95 is None:
        return "–"
    return f"{score.q05:.2f} … {score.q95:.2f}"
