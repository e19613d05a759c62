"""The evaluation: bias, spread and coverage of the live fit and of the filters, on noises that are known.

Every noise is y = x + v with D^α x = f x + ω, stationary, at 100 Hz. `live` is the fit of what the daemon
keeps, Whittle the same of the whole record. `triple` and `joint` run as the daemon runs them, then tuned by
the live fit, and with what is true.
"""

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from tools.validation.evaluate import alarms, cases, coverage, cramer_rao, fits, referee, settings, shifts
from tools.validation.evaluate.alarms import Alarms
from tools.validation.evaluate.cases import Case, H
from tools.validation.evaluate.coverage import Coverage, Point
from tools.validation.evaluate.online import Reading, read
from tools.validation.evaluate.referee import Referee
from tools.validation.evaluate.score import Score, score
from tools.validation.evaluate.settings import Setting
from tools.validation.evaluate.shifts import Shift, ShiftScore
from tools.validation.evaluate.tuned import read_tuned, tunings
from tools.validation.runner import Options, Task, as_row
from tools.validation.runner import Row as Kept
from tools.validation.tables import Table

Array = NDArray[np.float64]

WHITTLE = "Whittle"
"""The fit of the whole record."""
LIVE = "live"
"""The same of what the daemon keeps of it."""


class Row(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One estimator on one noise after so many samples."""

    case: Case
    samples: int
    """the start-up window included"""
    estimator: str
    quantity: fits.Quantity
    """the filters have the first two"""
    score: Score


class Pair(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Errors of α of the live fit and of the whole record's, on series in which both reject white noise."""

    case: Case
    samples: int
    series: int
    live_rmse: float | None
    whole_rmse: float | None

    @property
    def ratio(self) -> float | None:
        """Live over whole."""
        return None if not self.live_rmse or not self.whole_rmse else self.live_rmse / self.whole_rmse


class Plan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What to evaluate."""

    seeds: int
    """series of each noise that the filters get"""
    fit_seeds: int
    """that are fitted"""
    grid: tuple[Case, ...]
    lengths: tuple[int, ...]
    changed_on: tuple[Case, ...]
    """noises for the changed settings"""
    changed_lengths: tuple[int, ...]
    fitted_samples: int
    """of the other record, from which "fitted" Q and R are"""
    refereed: tuple[Case, ...]
    """noises for the exact likelihood"""
    alarm_series: int
    """of each kind of white noise"""
    shifts: tuple[Shift, ...]
    """noises that change"""
    coverage: tuple[Point, ...]
    """noises whose intervals are counted"""
    coverage_series: int
    """of each, and of each of `coverage.LENGTHS`"""


class Result(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All of it. Figures hold at 100 Hz and for y of this variance."""

    rate_hz: float
    power_dps2: float
    plan: Plan
    rows: tuple[Row, ...]
    """`settings.MAIN` and the fits on the grid"""
    pairs: tuple[Pair, ...]
    referee: tuple[Referee, ...]
    alarms: tuple[Alarms, ...]
    coverage: tuple[Coverage, ...]
    shifts: tuple[ShiftScore, ...]
    changes: tuple[Row, ...]
    """`settings.CHANGES` on a few noises"""


def full_plan(seeds: int) -> Plan:
    """The default: 53 noises, and the changed settings on six."""
    return Plan(
        seeds,
        FITS_TO_FILTERS * seeds,
        cases.grid(cases.ORDERS, cases.PARAMETERS, cases.STEP_RATIOS),
        cases.LENGTHS,
        tuple(settings.CHANGED_ON),
        cases.LENGTHS[:2],
        cases.LENGTHS[2],
        referee.CASES,
        ALARMS_TO_FILTERS * seeds,
        tuple(shifts.SHIFTS),
        coverage.POINTS,
        COVERAGE_TO_FILTERS * seeds,
    )


def quick_plan(seeds: int) -> Plan:
    """Five noises of up to 20,000 samples, and the changed settings on two."""
    changed = settings.CHANGED_ON[0], settings.CHANGED_ON[3]
    return Plan(
        seeds,
        FITS_TO_FILTERS * seeds,
        cases.grid((0.4, 0.8), (-1.0,), (0.3, 30.0)),
        cases.LENGTHS[:2],
        changed,
        cases.LENGTHS[:1],
        cases.LENGTHS[1],
        referee.CASES[:1],
        ALARMS_TO_FILTERS * seeds // 5,
        tuple(shifts.SHIFTS),
        coverage.POINTS[2:4],
        COVERAGE_TO_FILTERS * seeds // 5,
    )


FITS_TO_FILTERS = 4
"""A fit costs less than a filter, and a ratio of errors needs more series than an error."""
ALARMS_TO_FILTERS = 100
"""A share of 5 % needs most."""
COVERAGE_TO_FILTERS = 50
"""A share of 95 % needs nearly as many."""


SEEDS, QUICK_SEEDS = 20, 10
"""Series of each noise. Of fewer, all intervals have to hold the truth for a figure to be called right."""
KINDS = {
    "rows": Row,
    "pairs": Pair,
    "referee": Referee,
    "alarms": Alarms,
    "coverage": Coverage,
    "shifts": ShiftScore,
    "changes": Row,
}
"""Of rows, as `Result` has them."""


def tasks(options: Options) -> list[Task]:
    """Return all tasks."""
    return plan_tasks((quick_plan if options.quick else full_plan)(options.seeds))


def plan_tasks(plan: Plan) -> list[Task]:
    """Return the tasks of a plan; the first only says what the plan is."""
    lengths, seeds, fit_seeds = plan.lengths, plan.seeds, plan.fit_seeds
    return [
        Task("the plan", _plan_row, (plan,)),
        *(Task(one.name, filters_case, (one, seeds, lengths)) for one in plan.grid),
        *(Task(one.name, fits_case, (one, fit_seeds, lengths)) for one in plan.grid),
        *(Task(one.name, referee.judge, (one, seeds)) for one in plan.refereed),
        *(Task(one.name, shifts.score_shift, (one, seeds)) for one in plan.shifts),
        *(
            Task(f"white noise, {name}", alarms.count_alarms, (name, alarms.AT_ONCE, lengths, number))
            for name in alarms.MAKERS
            for number in range(max(1, plan.alarm_series // alarms.AT_ONCE))
        ),
        *(
            Task(one.name, coverage.count_coverage, (one, n, coverage.AT_ONCE, number))
            for one in plan.coverage
            for n in coverage.LENGTHS
            for number in range(max(1, plan.coverage_series // coverage.AT_ONCE))
        ),
        *(
            Task(
                one.name,
                changed_case,
                (one, seeds, plan.changed_lengths, settings.CHANGES, plan.fitted_samples),
            )
            for one in plan.changed_on
        ),
    ]


def _plan_row(plan: Plan) -> list[Kept]:
    return [as_row("plan", plan)]


def result_of(rows: Sequence[Kept]) -> Result:
    """Return the rows of all tasks, kind by kind, what was counted in parts added up."""
    plan = next(msgspec.convert(row["found"], Plan) for row in rows if row["kind"] == "plan")
    found = {
        name: tuple(msgspec.convert(row["found"], kind) for row in rows if row["kind"] == name)
        for name, kind in KINDS.items()
    }
    found["alarms"] = add_up(found["alarms"], ("series", "rejected", "rejected_1"))
    found["coverage"] = add_up(found["coverage"], ("series", "held", "undefined"))
    return Result(1 / H, cases.POWER, plan, **found)


def add_up(found: Sequence[Any], counts: Sequence[str]) -> tuple[Any, ...]:
    """Add the fields `counts` of what is alike in all others; each stands where its first one stood."""
    sums: dict[tuple[object, ...], Any] = {}
    for one in found:
        key = tuple(getattr(one, name) for name in one.__struct_fields__ if name not in counts)
        if key in sums:
            added = {name: getattr(sums[key], name) + getattr(one, name) for name in counts}
            one = msgspec.structs.replace(one, **added)
        sums[key] = one
    return tuple(sums.values())


def tables(rows: Sequence[Kept]) -> list[Table | str]:
    """Return the tables and the conclusion."""
    from tools.validation.evaluate import fit_summaries, summaries

    result = result_of(rows)
    return [
        Table(title, headings, body)
        for title, headings, body in (
            ("Error of α", *fit_summaries.errors(result)),
            ("Live over the whole record", fit_summaries.RATIO_HEADINGS, fit_summaries.ratios(result)),
            ("Intervals, all noises", fit_summaries.COVERAGE_HEADINGS, fit_summaries.coverages(result)),
            ("Intervals, noise by noise", fit_summaries.HELD_HEADINGS, fit_summaries.held(result)),
            ("The exact likelihood", fit_summaries.REFEREE_HEADINGS, fit_summaries.referee(result)),
            ("False alarms", fit_summaries.ALARM_HEADINGS, fit_summaries.alarms(result)),
            ("Noises that change", fit_summaries.SHIFT_HEADINGS, fit_summaries.shifts(result)),
            ("Right figures", summaries.SUMMARY_HEADINGS, summaries.summary(result)),
            ("White noise", summaries.WHITE_HEADINGS, summaries.white(result)),
            ("Changed settings", summaries.CHANGE_HEADINGS, summaries.changes(result)),
        )
    ] + [summaries.conclusion(result)]


def pictures(rows: Sequence[Kept]) -> dict[str, bytes]:
    """Return the heat maps."""
    from tools.validation.evaluate import figures

    return figures.draw(result_of(rows))


def filters_case(case: Case, seeds: int, lengths: Sequence[int]) -> list[Kept]:
    """Score the online filters on one noise; the shorter records are the beginnings of the longest."""
    y = cases.samples(case, seeds, lengths[-1])
    readings = _readings(case, y, settings.MAIN, lengths, 0)
    tuned = tunings(y, H, lengths[-1])
    for name, config in settings.TUNED.items():
        readings[name] = read_tuned(y, H, config, lengths, tuned)
    return [as_row("rows", one) for one in _filter_rows(case, readings, lengths)]


def changed_case(
    case: Case, seeds: int, lengths: Sequence[int], filters: Sequence[Setting], fitted_samples: int
) -> list[Kept]:
    """Score filters with changed settings; fitted_samples: as in `Plan`, for those that want it."""
    y = cases.samples(case, seeds, lengths[-1])
    found = _filter_rows(case, _readings(case, y, filters, lengths, fitted_samples), lengths)
    return [as_row("changes", one) for one in found]


def fits_case(case: Case, seeds: int, lengths: Sequence[int]) -> list[Kept]:
    """Score the fits of one noise, of the whole records and live."""
    y, truth = cases.samples(case, seeds, lengths[-1]), fits.truths(case)
    rows: list[Kept] = []
    for n, live in zip(lengths, fits.live_readings(y, H, lengths, truth), strict=True):
        whole, limits = fits.whole_reading(y[:n], H, truth), _bound(case, n)
        for name, one in ((LIVE, live), (WHITTLE, whole)):
            for quantity in fits.QUANTITIES:
                scored = score(
                    one.estimates[quantity],
                    one.rejected,
                    truth=truth.get(quantity),
                    covered=one.covered.get(quantity),
                    bound=limits.get(quantity),
                )
                rows.append(as_row("rows", Row(case, n, name, quantity, scored)))
        if truth:
            both = live.rejected & whole.rejected
            errors = (one.estimates["alpha"][both] - truth["alpha"] for one in (live, whole))
            pair = Pair(case, n, int(both.sum()), *map(referee.rms, errors))
            rows.append(as_row("pairs", pair))
    return rows


def _bound(case: Case, n: int) -> dict[str, float]:
    if case.alpha is None:
        return {}
    noise = case.noise
    return cramer_rao.bound(case.alpha, noise.g, noise.s2, noise.R, n, H)._asdict()


def _filter_rows(case: Case, readings: dict[str, list[Reading]], lengths: Sequence[int]) -> list[Row]:
    rows = []
    for place, n in enumerate(lengths):
        limits = _bound(case, n)
        for name, found in readings.items():
            one = found[place]
            alpha = score(
                one.alpha, one.valid, truth=case.alpha, reported=one.alpha_std, bound=limits.get("alpha")
            )
            f = score(one.f, one.valid, truth=case.f, reported=one.f_std, bound=limits.get("f"))
            rows += [Row(case, n, name, "alpha", alpha), Row(case, n, name, "f", f)]
    return rows


def _readings(
    case: Case, y: Array, filters: Sequence[Setting], lengths: Sequence[int], fitted_samples: int
) -> dict[str, list[Reading]]:
    """By the name of the filter."""
    noise, seeds = case.noise, y.shape[1]
    default_Q = filters[0].config.state.Q
    # White noise has no steps: there Q stays as it is.
    Q: dict[str, Array | None] = {"config": None, "true": np.full(seeds, noise.s2 or default_Q)}
    R: dict[str, Array | None] = {"config": None, "true": np.full(seeds, noise.R)}
    if any("fitted" in (one.Q, one.R) for one in filters):
        other = cases.samples(case, seeds, fitted_samples, record=1)
        Q["fitted"], R["fitted"] = fits.fitted_variances(other, H, default_Q, cases.POWER)
    return {one.name: read(y, H, one.config, lengths, Q=Q[one.Q], R=R[one.R]) for one in filters}
