"""The engine over every seed and every length L of a scenario: squared errors, and which runs diverged.

A run has diverged if an estimate is not finite, if |α̂| > 10 at any sample, or if the state is ever further
than 10 sqrt(R) from the truth (from the measurement, where there is no truth). Where lengths are compared
with each other, a seed counts if either run has diverged.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

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
"""in standard deviations sqrt(R)"""


@dataclass(frozen=True)
class Options:
    """What of the engine is asked for; the defaults are the printed algorithm with its exact memory."""

    variant: Literal["triple", "joint"] = "triple"
    guard: Literal["off", "faithful", "consistent"] = "off"
    memory: Literal["direct", "compressed"] = "direct"


class Outcome(NamedTuple):
    """One number a seed, arrays (seeds,), for one length L."""

    state: Array
    """sum of squared errors over the run, unit²"""
    parameter: Array
    """likewise, s^-2α"""
    order: Array
    diverged: NDArray[np.bool_]
    settled_order: Array
    """mean of α̂ over the last third"""
    settled_parameter: Array
    """mean of f̂ over the last third, s^-α"""


def estimate(scenario: Scenario, data: Data, length: int, options: Options) -> Estimates:
    """Every estimate of every run, arrays (n, runs)."""
    return Engine(data.y.shape[1], lane_settings(scenario.filters, length, options)).run(data.y, data.u)


def lane_settings(filters: LaneSettings, length: int, options: Options) -> LaneSettings:
    """The filters of an experiment with the length L and what of the engine is asked for."""
    config = msgspec.structs.replace(
        filters.config,
        window=length,
        variant=options.variant,
        guard=options.guard,
        memory=options.memory,
    )
    return replace(filters, config=config)


def outcomes(
    scenario: Scenario, seeds: Sequence[int], options: Options, advance: Callable[[int], None]
) -> dict[int, Outcome]:
    """Length L to the outcome over `seeds`; `advance` is told the number of runs just done.

    Without a truth the first length is what the others are compared with, and has no entry of its own.
    """
    seeds = seeds[:1] if scenario.single else seeds
    groups = [seeds[i : i + WIDTH] for i in range(0, len(seeds), WIDTH)]
    parts: dict[int, dict[int, Outcome]] = {}
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        # The engine lets go of the interpreter, so threads run side by side; results do not depend on them.
        tasks = {pool.submit(_group, scenario, group, options): i for i, group in enumerate(groups)}
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


def _group(scenario: Scenario, seeds: Sequence[int], options: Options) -> dict[int, Outcome]:
    data = scenario.make(seeds)
    return dict(_compare(scenario, data, options))


def _compare(scenario: Scenario, data: Data, options: Options) -> Iterator[tuple[int, Outcome]]:
    sigma = scenario.R**0.5
    first: Estimates | None = None
    first_diverged = np.zeros(data.y.shape[1], dtype=bool)
    for length in scenario.lengths:
        got = estimate(scenario, data, length, options)
        diverged = has_diverged(got, data.y if data.x is None else data.x, sigma)
        if scenario.alpha is not None and scenario.f is not None and data.x is not None:
            x, f, alpha = data.x, np.asarray(scenario.f), scenario.alpha[:, np.newaxis]
        elif first is None:
            first, first_diverged = got, diverged
            continue
        else:
            x, f, alpha = first.x, first.f, first.alpha
            diverged |= first_diverged
        third = slice(-(len(got.x) // 3), None)
        with np.errstate(all="ignore"):  # runs that have diverged overflow
            outcome = Outcome(
                state=_sse(got.x - x),
                parameter=_sse(got.f - f),
                order=_sse(got.alpha - alpha),
                diverged=diverged,
                settled_order=got.alpha[third].mean(axis=0),
                settled_parameter=got.f[third].mean(axis=0),
            )
        yield length, outcome


def _sse(errors: Array) -> Array:
    return np.asarray(np.sum(errors * errors, axis=0))


def has_diverged(got: Estimates, state: Array, sigma: float) -> NDArray[np.bool_]:
    """Tell of each run (runs,) whether it has diverged, by the rule at the head of this file.

    state: (n, runs), what x̂ is measured against. sigma: sqrt(R).
    """
    with np.errstate(all="ignore"):
        sane = np.isfinite(got.alpha) & np.isfinite(got.f) & np.isfinite(got.x)
        sane &= (np.abs(got.alpha) <= ORDER_LIMIT) & (np.abs(got.x - state) <= STATE_LIMIT * sigma)
    return np.asarray(~sane.all(axis=0))
