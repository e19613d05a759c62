"""Run the engine for every seed and length L of a scenario: squared errors, and runs that diverged.

A run is "not finite" if any of its estimates is infinite or NaN. Such a run has no squared error, so no
statistic includes it. A run is "far off" if it is finite, but |α̂| > 10 at any sample, or the estimated state
is ever further than 10 sqrt(R) from the true state (from the measurement, if the true state is not known).
Runs that are far off are counted, and every statistic includes them, since the paper's own run may be such a
run. Where two lengths L are compared with each other, both runs of a seed have to be finite, and the seed is
far off if either run is.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.estimator.engine import Engine, Estimates
from fltea.estimator.lane_settings import LaneSettings
from fltea.lab.reproduce.scenarios import Data, Scenario
from fltea.lab.reproduce.simulate import WIDTH
from fltea.records.arrays import Array

ORDER_LIMIT = 10.0
STATE_LIMIT = 10.0
"""A run is far off if the error of its state is ever larger than this many standard deviations sqrt(R)."""


@dataclass(frozen=True)
class Options:
    """Options of the engine. The defaults are the paper's algorithm with its exact memory."""

    variant: Literal["triple", "joint"] = "triple"
    guard: Literal["off", "faithful", "consistent"] = "off"
    memory: Literal["direct", "compressed"] = "direct"


class Outcome(NamedTuple):
    """The results of all seeds for one length L. Each array is (seeds,), with one number for each seed."""

    state: Array
    """Sum of squared errors of the state over the run, in unit²."""
    parameter: Array
    """Sum of squared errors of the parameter over the run [s^-2α]."""
    order: Array
    not_finite: NDArray[np.bool_]
    """Whether an estimate of the run is infinite or NaN. Such a run has no squared errors."""
    far_off: NDArray[np.bool_]
    """Whether the run is finite, but its order or state is ever beyond ORDER_LIMIT or STATE_LIMIT."""
    settled_order: Array
    """Mean of the estimated order α̂ over the last third of the run."""
    settled_parameter: Array
    """Mean of the estimated parameter f̂ over the last third of the run [s^-α]."""


class Curves(Protocol):
    """Estimates of several runs, by the engine or another implementation. Each array is (n, runs)."""

    @property
    def x(self) -> Array:
        """The posterior state."""

    @property
    def f(self) -> Array:
        """The estimate f̂ of the parameter f in D^α x = f x + ω [s^-α]."""

    @property
    def alpha(self) -> Array:
        """The order."""


def estimate(scenario: Scenario, data: Data, length: int, options: Options) -> Estimates:
    """Return all estimates of every run, arrays (n, runs)."""
    return Engine(data.y.shape[1], lane_settings(scenario.filters, length, options)).run(data.y, data.u)


def lane_settings(filters: LaneSettings, length: int, options: Options) -> LaneSettings:
    """Return the filters of an experiment, changed to the length L and the options of the engine."""
    config = msgspec.structs.replace(
        filters.config,
        window=length,
        variant=options.variant,
        guard=options.guard,
        memory=options.memory,
    )
    return replace(filters, config=config)


Run = Callable[[Scenario, Data, int, Options], Curves]
"""A function with the arguments of `estimate`. It returns the estimates of all runs for one length L."""


def outcomes(
    scenario: Scenario,
    seeds: Sequence[int],
    options: Options,
    advance: Callable[[int], None],
    run: Run = estimate,
    width: int = WIDTH,
) -> dict[int, Outcome]:
    """Run a scenario for all `seeds`, and return the results by length L.

    `advance` is called with the number of runs that were just finished. If the true state and order are not
    known, a run with one of the other lengths is compared with the run with the first length; the first
    length then has no result. `run` makes the estimates of `width` seeds at once.
    """
    seeds = seeds[:1] if scenario.single else seeds
    groups = [seeds[i : i + width] for i in range(0, len(seeds), width)]
    parts: dict[int, dict[int, Outcome]] = {}
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        # The engine releases the GIL, so threads run in parallel. Results do not depend on the number of
        # threads.
        tasks = {pool.submit(_group, scenario, group, options, run): i for i, group in enumerate(groups)}
        try:
            pending = set(tasks)
            while pending:
                done, pending = wait(pending, return_when=FIRST_COMPLETED)
                for task in done:
                    parts[tasks[task]] = task.result()
                    advance(len(groups[tasks[task]]) * len(scenario.lengths))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    ordered = [parts[i] for i in range(len(groups))]
    return {L: Outcome(*map(np.concatenate, zip(*(p[L] for p in ordered), strict=True))) for L in ordered[0]}


def _group(scenario: Scenario, seeds: Sequence[int], options: Options, run: Run) -> dict[int, Outcome]:
    data = scenario.make(seeds)
    return dict(_compare(scenario, data, options, run))


def _compare(scenario: Scenario, data: Data, options: Options, run: Run) -> Iterator[tuple[int, Outcome]]:
    first: Curves | None = None
    for length in scenario.lengths:
        got = run(scenario, data, length, options)
        if scenario.alpha is not None:
            yield length, against_truth(scenario, data, got)
        elif first is None:
            first = got
        else:
            yield length, _against(scenario, data, got, first)


def against_truth(scenario: Scenario, data: Data, got: Curves) -> Outcome:
    """Return the errors of runs relative to the state, parameter and orders that the data were made with.

    Raises:
        ValueError: the true state, parameter or order of the scenario is not known.
    """
    if data.x is None or scenario.f is None or scenario.alpha is None:
        raise ValueError(f"{scenario.title}: the true state, parameter and order are not known")
    lost = not_finite(got)
    return _outcome(
        got,
        (data.x, np.asarray(scenario.f), scenario.alpha[:, np.newaxis]),
        lost,
        far_off(got, data.x, scenario.R**0.5) & ~lost,
    )


def _against(scenario: Scenario, data: Data, got: Curves, first: Curves) -> Outcome:
    """Return the errors of the runs `got` relative to the runs `first`, which have another length L."""
    lost = not_finite(got) | not_finite(first)
    far = [far_off(one, data.y, scenario.R**0.5) for one in (got, first)]
    return _outcome(got, (first.x, first.f, first.alpha), lost, (far[0] | far[1]) & ~lost)


def _outcome(
    got: Curves, truth: tuple[Array, Array, Array], lost: NDArray[np.bool_], far: NDArray[np.bool_]
) -> Outcome:
    third = slice(-(len(got.x) // 3), None)
    x, f, alpha = truth
    with np.errstate(all="ignore"):  # runs that are not finite overflow here, without a warning
        return Outcome(
            state=_sse(got.x - x),
            parameter=_sse(got.f - f),
            order=_sse(got.alpha - alpha),
            not_finite=lost,
            far_off=far,
            settled_order=got.alpha[third].mean(axis=0),
            settled_parameter=got.f[third].mean(axis=0),
        )


def _sse(errors: Array) -> Array:
    return np.asarray(np.sum(errors * errors, axis=0))


def not_finite(got: Curves) -> NDArray[np.bool_]:
    """Return for each run (runs,) whether any estimate of state, parameter or order is infinite or NaN."""
    finite = np.isfinite(got.alpha) & np.isfinite(got.f) & np.isfinite(got.x)
    return np.asarray(~finite.all(axis=0))


def far_off(got: Curves, state: Array, sigma: float) -> NDArray[np.bool_]:
    """Return for each run (runs,) whether order or state is ever beyond ORDER_LIMIT or STATE_LIMIT.

    `state`: the values that the estimated state is compared with, (n, runs). `sigma`: sqrt(R). Runs that are
    not finite count as far off, too.
    """
    with np.errstate(all="ignore"):
        near = (np.abs(got.alpha) <= ORDER_LIMIT) & (np.abs(got.x - state) <= STATE_LIMIT * sigma)
    return np.asarray(~near.all(axis=0))
