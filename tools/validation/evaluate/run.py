"""The evaluation of the live fit and the filters on known noises.

This part measures the mean error and the spread of the estimates, and how often their intervals contain the
true value.

Every noise is y = x + v with D^α x = f x + ω, stationary, at 100 Hz. `live` is the fit of the sums that the
daemon keeps; `Whittle` is the same fit of the whole record. The filters `triple` and `joint` run in three
ways: with the daemon's default settings, with the Q and R of the live fit, and with the true values of R or
of Q and R.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from fltea.records.arrays import Array

from tools.validation.evaluate import cases, composites, coverage, cramer_rao, fits, referee, settings, shifts
from tools.validation.evaluate.cases import Case, H
from tools.validation.evaluate.coverage import Point
from tools.validation.evaluate.online import Reading, read
from tools.validation.evaluate.score import score
from tools.validation.evaluate.settings import LIVE, WHITTLE, Setting
from tools.validation.evaluate.shifts import Shift
from tools.validation.evaluate.tuned import tunings
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table

SEEDS, QUICK_SEEDS = 20, 10
"""Number of series of each noise in a full and in a quick run. A figure is called right only if at least 90 %
of its intervals contain the true value. Of fewer than ten intervals, all would have to.
"""
FITS_TO_FILTERS = 4
"""Number of series that are fitted, divided by the number that are filtered. It is above 1 because a fit
takes less time than a filter. Also, the tables show ratios of the errors of two fits, and a ratio needs more
series than the error of a filter.
"""
MIXED_TO_FILTERS, CLAIMS_TO_FILTERS = 10, 15
"""Two numbers of series, each divided by the number of series that the filters process (`Plan.seeds`).
MIXED_TO_FILTERS: series of each composite noise. CLAIMS_TO_FILTERS: series of mixtures of each length, on
which false claims of an order are counted (both noises: see `composites`).
"""
COVERAGE_TO_FILTERS = 50
"""Number of series on which intervals are counted that contain the true value, divided by the number that the
filters process (`Plan.seeds`). It is large, since a proportion near 95 % needs many series.
"""


# Why more than 12 attributes: each is one choice of what to evaluate, with its default.
class Plan(NamedTuple):
    """What to evaluate: by default 53 noises, and changed settings of the filters on six of them."""

    seeds: int
    """Number of series of each noise that the filters process."""
    fit_seeds: int
    """Number of series of each noise that are fitted."""
    coverage_series: int
    """Number of series for each noise and length in `coverage`."""
    grid: tuple[Case, ...] = cases.grid(cases.ORDERS, cases.PARAMETERS, cases.STEP_RATIOS)
    lengths: tuple[int, ...] = cases.LENGTHS
    changed_on: tuple[Case, ...] = settings.CHANGED_ON
    """Noises on which the changed settings are tried."""
    changed_lengths: tuple[int, ...] = cases.LENGTHS[:2]
    fitted_samples: int = cases.LENGTHS[2]
    """Number of samples of the separate record from which filters with the setting `fitted` get their Q and
    R.
    """
    refereed: tuple[Case, ...] = referee.CASES
    """Noises for the comparison with the exact likelihood."""
    shifts: tuple[Shift, ...] = shifts.SHIFTS
    """Noises that change during the measurement."""
    coverage: tuple[Point, ...] = coverage.POINTS
    """Noises for which the coverage of intervals is counted."""
    mixed: tuple[str, ...] = tuple(composites.COMPOSITES)
    """Noises without an order for which the coverage of intervals is counted."""
    claimed: tuple[int, ...] = composites.LENGTHS
    """Numbers of samples of the mixtures (random relaxations, and white noise that rises with frequency), on
    which the verdict "fractional" is counted. A mixture has no order, so this verdict is false.
    """


def plan_of(seeds: int, *, quick: bool = False) -> Plan:
    """Return the plan of what to evaluate.

    The plan of a quick run has five noises of up to 20,000 samples. On two of them, filters with changed
    settings (`settings.CHANGES`) are evaluated as well.
    """
    plan = Plan(seeds, FITS_TO_FILTERS * seeds, COVERAGE_TO_FILTERS * seeds)
    if not quick:
        return plan
    return plan._replace(
        coverage_series=plan.coverage_series // 5,
        grid=cases.grid((0.4, 0.8), (-1.0,), (0.3, 30.0)),
        lengths=cases.LENGTHS[:2],
        changed_on=(settings.CHANGED_ON[0], settings.CHANGED_ON[3]),
        changed_lengths=cases.LENGTHS[:1],
        fitted_samples=cases.LENGTHS[1],
        refereed=referee.CASES[:1],
        coverage=coverage.POINTS[2:4],
        mixed=("two relaxations", "relaxation, angle"),
        claimed=composites.LENGTHS[:2],
    )


def tasks(options: Options) -> list[Task]:
    """Return all tasks."""
    return plan_tasks(plan_of(options.seeds, quick=options.quick))


def plan_tasks(plan: Plan) -> list[Task]:
    """Return the tasks of a plan."""
    lengths, seeds, fit_seeds = plan.lengths, plan.seeds, plan.fit_seeds
    changes = seeds, plan.changed_lengths, settings.CHANGES, plan.fitted_samples
    return [
        *(Task(one.name, filters_case, (one, seeds, lengths)) for one in plan.grid),
        *(Task(one.name, fits_case, (one, fit_seeds, lengths)) for one in plan.grid),
        *(Task(one.name, referee.judge, (one, seeds)) for one in plan.refereed),
        *(Task(one.name, shifts.score_shift, (one, seeds)) for one in plan.shifts),
        *(
            Task(one.name, coverage.count_coverage, (one, n, coverage.AT_ONCE, number))
            for one in plan.coverage
            for n in coverage.LENGTHS
            for number in range(max(1, plan.coverage_series // coverage.AT_ONCE))
        ),
        *(Task(one, composites.count_composite, (one, MIXED_TO_FILTERS * seeds)) for one in plan.mixed),
        *(
            Task(f"{n:,} samples", composites.count_claims, (n, CLAIMS_TO_FILTERS * seeds))
            for n in plan.claimed
        ),
        *(Task(one.name, changed_case, (one, *changes)) for one in plan.changed_on),
    ]


def tables(rows: list[Row]) -> list[Table | str]:
    """Return the tables and the conclusion."""
    from tools.validation.evaluate import summaries

    return summaries.tables(rows)


def pictures(rows: list[Row]) -> dict[str, bytes]:
    """Return the heat maps."""
    from tools.validation.evaluate import figures

    return figures.draw(rows)


def filters_case(case: Case, seeds: int, lengths: Sequence[int]) -> list[Row]:
    """Score the online filters on one noise. The shorter records are beginnings of the longest record."""
    y = cases.samples(case, seeds, lengths[-1])
    readings = _readings(case, y, settings.MAIN, lengths, 0)
    tuned = tunings(y, H, lengths[-1])
    for name, config in settings.TUNED.items():
        readings[name] = read(y, H, config, lengths, tunings=tuned)
    return _filter_rows("rows", case, readings, lengths)


def changed_case(
    case: Case, seeds: int, lengths: Sequence[int], filters: Sequence[Setting], fitted_samples: int
) -> list[Row]:
    """Score filters with changed settings.

    `fitted_samples`: number of samples of a separate record, from whose fit some of the filters get their Q
    and R.
    """
    y = cases.samples(case, seeds, lengths[-1])
    return _filter_rows("changes", case, _readings(case, y, filters, lengths, fitted_samples), lengths)


def fits_case(case: Case, seeds: int, lengths: Sequence[int]) -> list[Row]:
    """Score the fits of whole records and the live fits on series of one noise.

    A row of the kind `pair` has the errors of α of both fits, on those series for which both fits publish an
    order.
    """
    y, truth = cases.samples(case, seeds, lengths[-1]), fits.truths(case)
    rows: list[Row] = []
    for n, live in zip(lengths, fits.live_readings(y, H, lengths, truth), strict=True):
        whole, limits = fits.whole_reading(y[:n], H, truth), _bound(case, n)
        rows += [
            _row("rows", case, n, name, quantity)
            | score(
                one.estimates[quantity],
                one.published,
                truth=truth.get(quantity),
                covered=one.covered.get(quantity),
                bound=limits.get(quantity),
            )
            for name, one in ((LIVE, live), (WHITTLE, whole))
            for quantity in fits.QUANTITIES
        ]
        if truth:
            both = live.published & whole.published
            errors = [referee.rms(one.estimates["alpha"][both] - truth["alpha"]) for one in (live, whole)]
            pair = {"series": int(both.sum()), "live_rmse": errors[0], "whole_rmse": errors[1]}
            rows.append({"kind": "pairs", **case.columns, "samples": n, **pair})
    return rows


def _row(kind: str, case: Case, n: int, estimator: str, quantity: str) -> Row:
    """Return the columns that say to which noise, estimator and quantity a row belongs.

    `n`: number of samples, including the start-up window.
    """
    return {"kind": kind, **case.columns, "samples": n, "estimator": estimator, "quantity": quantity}


def _bound(case: Case, n: int) -> dict[str, float]:
    if case.alpha is None:
        return {}
    noise = case.noise
    return cramer_rao.bound(case.alpha, noise.g, noise.s2, noise.R, n, H)._asdict()


def _filter_rows(
    kind: str, case: Case, readings: dict[str, list[Reading]], lengths: Sequence[int]
) -> list[Row]:
    rows = []
    for place, n in enumerate(lengths):
        limits = _bound(case, n)
        for name, found in readings.items():
            one = found[place]
            for quantity, estimate, std, truth in (
                ("alpha", one.alpha, one.alpha_std, case.alpha),
                ("f", one.f, one.f_std, case.f),
            ):
                scored = score(estimate, one.valid, truth=truth, reported=std, bound=limits.get(quantity))
                rows.append(_row(kind, case, n, name, quantity) | scored)
    return rows


def _readings(
    case: Case, y: Array, filters: Sequence[Setting], lengths: Sequence[int], fitted_samples: int
) -> dict[str, list[Reading]]:
    """Run the filters on y (n, seeds). Return the estimates of each filter by its name.

    A filter has one `Reading` for each record length.
    """
    noise, seeds = case.noise, y.shape[1]
    default_Q = filters[0].config.state.Q
    # White noise has no state and so no true Q. The filters therefore keep their default Q.
    Q: dict[str, Array | None] = {"config": None, "true": np.full(seeds, noise.s2 or default_Q)}
    R: dict[str, Array | None] = {"config": None, "true": np.full(seeds, noise.R)}
    if any("fitted" in (one.Q, one.R) for one in filters):
        other = cases.samples(case, seeds, fitted_samples, record=1)
        Q["fitted"], R["fitted"] = fits.fitted_variances(other, H, default_Q, cases.POWER)
    return {one.name: read(y, H, one.config, lengths, Q=Q[one.Q], R=R[one.R]) for one in filters}
