"""The whole evaluation: each noise is a task, done by this process or by others."""

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.identify.workers import Workers
from fltea.lab.evaluate import cases, cramer_rao, settings
from fltea.lab.evaluate.cases import Case, H
from fltea.lab.evaluate.offline import fitted_variances, whittle_reading
from fltea.lab.evaluate.online import Reading, read
from fltea.lab.evaluate.score import Score, score
from fltea.lab.evaluate.settings import Setting
from fltea.records.errors import FlteaError

Array = NDArray[np.float64]

WHITTLE = "Whittle"

Progress = Callable[[str], None]
"""Is told the noise that has just been done."""


class Row(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One estimator on one noise after so many samples."""

    case: Case
    samples: int
    """the start-up window included"""
    estimator: str
    quantity: Literal["alpha", "f"]
    score: Score


class Plan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What to evaluate."""

    seeds: int
    grid: tuple[Case, ...]
    lengths: tuple[int, ...]
    changed_on: tuple[Case, ...]
    """noises for the changed settings"""
    changed_lengths: tuple[int, ...]
    fitted_samples: int
    """of the other record, from which "fitted" Q and R are"""


class Result(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All of it. Figures hold at 100 Hz and for y of this variance."""

    rate_hz: float
    power_dps2: float
    plan: Plan
    rows: tuple[Row, ...]
    """`settings.MAIN` and the Whittle fit on the grid"""
    changes: tuple[Row, ...]
    """`settings.CHANGES` on a few noises"""


def full_plan(seeds: int) -> Plan:
    """The default: 53 noises, and the changed settings on six."""
    return Plan(
        seeds,
        cases.grid(cases.ORDERS, cases.PARAMETERS, cases.STEP_RATIOS),
        cases.LENGTHS,
        tuple(settings.CHANGED_ON),
        cases.LENGTHS[:2],
        cases.LENGTHS[2],
    )


def quick_plan(seeds: int) -> Plan:
    """Five noises of up to 20,000 samples, and the changed settings on two."""
    changed = settings.CHANGED_ON[0], settings.CHANGED_ON[3]
    return Plan(
        seeds,
        cases.grid((0.4, 0.8), (-1.0,), (0.3, 30.0)),
        cases.LENGTHS[:2],
        changed,
        cases.LENGTHS[:1],
        cases.LENGTHS[1],
    )


def steps(plan: Plan) -> int:
    """Calls of `progress` that `evaluate` makes."""
    return len(plan.grid) + len(plan.changed_on)


def evaluate(plan: Plan, workers: Workers, progress: Progress = lambda text: None) -> Result:
    """Do all of `plan`; the result does not depend on the workers.

    Raises:
        FlteaError: a worker died.
    """
    grid = [(case, plan.seeds, plan.lengths, settings.MAIN, True, 0) for case in plan.grid]
    changed = [
        (case, plan.seeds, plan.changed_lengths, settings.CHANGES, False, plan.fitted_samples)
        for case in plan.changed_on
    ]
    rows: list[list[Row]] = _all(grid + changed, workers, progress)
    return Result(
        1 / H,
        cases.POWER,
        plan,
        tuple(row for part in rows[: len(grid)] for row in part),
        tuple(row for part in rows[len(grid) :] for row in part),
    )


Task = tuple[Case, int, Sequence[int], Sequence[Setting], bool, int]
"""The arguments of `evaluate_case`."""


def _all(tasks: Sequence[Task], workers: Workers, progress: Progress) -> list[list[Row]]:
    """Results in the order of the tasks."""
    results: dict[int, list[Row]] = {}
    pending: dict[Future[list[Row]], int] = {}
    waiting = list(range(len(tasks)))[::-1]
    while waiting or pending:
        try:
            while waiting and len(pending) < workers.slots:
                number = waiting.pop()
                pending[workers.submit(evaluate_case, *tasks[number])] = number
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                number = pending.pop(future)
                results[number] = future.result()
                progress(tasks[number][0].name)
        except BrokenExecutor as error:
            raise FlteaError(
                "a process that worked on it was killed; did memory run out? Try --jobs 1."
            ) from error
    return [results[number] for number in range(len(tasks))]


def evaluate_case(
    case: Case,
    seeds: int,
    lengths: Sequence[int],
    filters: Sequence[Setting],
    whittle: bool,
    fitted_samples: int,
) -> list[Row]:
    """Score all estimators on one noise; the shorter records are the beginnings of the longest.

    whittle: fit the records too. fitted_samples: as in `Plan`, for the filters that want it.
    """
    noise = case.noise
    y = cases.samples(case, seeds, lengths[-1])
    readings = _readings(case, y, filters, lengths, fitted_samples)
    rows = []
    for place, n in enumerate(lengths):
        limit = None
        if case.alpha is not None:
            limit = cramer_rao.bound(case.alpha, noise.g, noise.s2, noise.R, n, H)
        bound_alpha, bound_f = limit or (None, None)
        for name, found in readings.items():
            one = found[place]
            alpha = score(one.alpha, one.valid, truth=case.alpha, reported=one.alpha_std, bound=bound_alpha)
            f = score(one.f, one.valid, truth=case.f, reported=one.f_std, bound=bound_f)
            rows += [Row(case, n, name, "alpha", alpha), Row(case, n, name, "f", f)]
        if whittle:
            w = whittle_reading(y[:n], H, case.alpha, case.f)
            alpha = score(w.alpha, w.rejected, truth=case.alpha, covered=w.alpha_covered, bound=bound_alpha)
            f = score(w.f, w.rejected, truth=case.f, covered=w.f_covered, bound=bound_f)
            rows += [Row(case, n, WHITTLE, "alpha", alpha), Row(case, n, WHITTLE, "f", f)]
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
        Q["fitted"], R["fitted"] = fitted_variances(other, H, default_Q, cases.POWER)
    return {one.name: read(y, H, one.config, lengths, Q=Q[one.Q], R=R[one.R]) for one in filters}
