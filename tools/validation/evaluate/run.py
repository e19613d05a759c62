"""The whole evaluation: many tasks, done by this process or by others."""

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from typing import Any

import msgspec
import numpy as np
from fltea.identification.workers import Workers
from fltea.records.errors import FlteaError
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

Array = NDArray[np.float64]

WHITTLE = "Whittle"
"""The fit of the whole record."""
LIVE = "live"
"""The same of what the daemon keeps of it."""

Progress = Callable[[str], None]
"""Is told what has just been done."""


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


class Task(msgspec.Struct, frozen=True):
    """A part of the work: a function that other processes know, too."""

    name: str
    work: Callable[..., Any]
    arguments: tuple[Any, ...]


def tasks(plan: Plan) -> dict[str, list[Task]]:
    """All of the work, by the field of `Result` that it is for; the longest first."""
    seeds, lengths = plan.seeds, plan.lengths
    return {
        "referee": [Task(one.name, referee.judge, (one, seeds)) for one in plan.refereed],
        "rows": [Task(one.name, filters_case, (one, seeds, lengths)) for one in plan.grid],
        "fits": [Task(one.name, fits_case, (one, plan.fit_seeds, lengths)) for one in plan.grid],
        "shifts": [Task(one.name, shifts.score_shift, (one, seeds)) for one in plan.shifts],
        "alarms": [
            Task(f"white noise, {name}", alarms.count_alarms, (name, alarms.AT_ONCE, lengths, number))
            for name in alarms.MAKERS
            for number in range(max(1, plan.alarm_series // alarms.AT_ONCE))
        ],
        "coverage": [
            Task(one.name, coverage.count_coverage, (one, n, coverage.AT_ONCE, number))
            for one in plan.coverage
            for n in coverage.LENGTHS
            for number in range(max(1, plan.coverage_series // coverage.AT_ONCE))
        ],
        "changes": [
            Task(
                one.name,
                changed_case,
                (one, seeds, plan.changed_lengths, settings.CHANGES, plan.fitted_samples),
            )
            for one in plan.changed_on
        ],
    }


def steps(plan: Plan) -> int:
    """Calls of `progress` that `evaluate` makes."""
    return sum(map(len, tasks(plan).values()))


def evaluate(plan: Plan, workers: Workers, progress: Progress = lambda text: None) -> Result:
    """Do all of `plan`; the result does not depend on the workers.

    Raises:
        FlteaError: a worker died.
    """
    parts = tasks(plan)
    done = iter(_all([task for part in parts.values() for task in part], workers, progress))
    found = {name: [next(done) for _ in part] for name, part in parts.items()}
    fitted = [rows for rows, _ in found["fits"]]
    return Result(
        1 / H,
        cases.POWER,
        plan,
        tuple(row for part in zip(found["rows"], fitted, strict=True) for rows in part for row in rows),
        tuple(pair for _, pairs in found["fits"] for pair in pairs),
        tuple(one for part in found["referee"] for one in part),
        alarms.together(found["alarms"]),
        coverage.together(found["coverage"]),
        tuple(one for part in found["shifts"] for one in part),
        tuple(row for part in found["changes"] for row in part),
    )


def _all(work: Sequence[Task], workers: Workers, progress: Progress) -> list[Any]:
    """Results in the order of the tasks."""
    results: dict[int, Any] = {}
    pending: dict[Future[Any], int] = {}
    waiting = list(range(len(work)))[::-1]
    while waiting or pending:
        try:
            while waiting and len(pending) < workers.slots:
                number = waiting.pop()
                pending[workers.submit(work[number].work, *work[number].arguments)] = number
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                number = pending.pop(future)
                results[number] = future.result()
                progress(work[number].name)
        except BrokenExecutor as error:
            raise FlteaError(
                "a process that worked on it was killed; did memory run out? Try --jobs 1."
            ) from error
    return [results[number] for number in range(len(work))]


def filters_case(case: Case, seeds: int, lengths: Sequence[int]) -> list[Row]:
    """Score the online filters on one noise; the shorter records are the beginnings of the longest."""
    y = cases.samples(case, seeds, lengths[-1])
    readings = _readings(case, y, settings.MAIN, lengths, 0)
    tuned = tunings(y, H, lengths[-1])
    for name, config in settings.TUNED.items():
        readings[name] = read_tuned(y, H, config, lengths, tuned)
    return _filter_rows(case, readings, lengths)


def changed_case(
    case: Case, seeds: int, lengths: Sequence[int], filters: Sequence[Setting], fitted_samples: int
) -> list[Row]:
    """Score filters with changed settings; fitted_samples: as in `Plan`, for those that want it."""
    y = cases.samples(case, seeds, lengths[-1])
    return _filter_rows(case, _readings(case, y, filters, lengths, fitted_samples), lengths)


def fits_case(case: Case, seeds: int, lengths: Sequence[int]) -> tuple[list[Row], list[Pair]]:
    """Score the fits of one noise, of the whole records and live."""
    y, truth = cases.samples(case, seeds, lengths[-1]), fits.truths(case)
    rows, pairs = [], []
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
                rows.append(Row(case, n, name, quantity, scored))
        if truth:
            both = live.rejected & whole.rejected
            errors = (one.estimates["alpha"][both] - truth["alpha"] for one in (live, whole))
            pairs.append(Pair(case, n, int(both.sum()), *map(referee.rms, errors)))
    return rows, pairs


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
