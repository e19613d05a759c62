"""Measure table 1 of Macias & Sierociuk 2023: times for 4,000 samples of example 1, for each length L."""

import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Literal, NamedTuple

import numpy as np

from fltea.estimator.lane_settings import LaneSettings
from fltea.lab.reference import filters as reference
from fltea.lab.reproduce.runs import Options, estimate
from fltea.lab.reproduce.scenarios import Data, SawTooth, example
from fltea.records.arrays import Array

REPETITIONS = 5
MEMORIES: tuple[Literal["direct", "compressed"], ...] = ("direct", "compressed")


class Times(NamedTuple):
    """Times for one run [s]: medians of REPETITIONS runs, or of a single run for the reference."""

    direct_s: float
    compressed_s: float
    reference_s: float


def measure(
    sawtooth: SawTooth, options: Options, advance: Callable[[int], None]
) -> Iterator[tuple[int, Times]]:
    """Yield each length L with the times of the engine (fltea's filters) and of the numpy reference.

    `options`: settings of the engine. The reference is the algorithm as the paper has it.
    """
    scenario = example(1, sawtooth)
    data = scenario.make([0])
    for length in scenario.lengths:
        direct, compressed = (
            statistics.median(
                seconds(partial(estimate, scenario, data, length, replace(options, memory=memory)))
                for _ in range(REPETITIONS)
            )
            for memory in MEMORIES
        )
        plain = seconds(partial(run_reference, scenario.filters, length, data))
        advance(1)
        yield length, Times(direct, compressed, plain)


def seconds(work: Callable[[], object]) -> float:
    """Return the wall-clock seconds that `work` takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def run_reference(settings: LaneSettings, length: int, data: Data) -> Array:
    """Return the numpy reference's estimates (n, 3) of state, parameter and order, for the first run."""
    inputs = None if data.u is None else data.u[:, 0]
    steps = reference_filters(settings, length).run(data.y[:, 0], inputs)
    return np.array([(step.x[0], step.w[0], step.order) for step in steps])


def reference_filters(settings: LaneSettings, length: int) -> reference.Fltea:
    """Return the numpy reference with one state.

    The settings have to be plain numbers, with one R for all three filters.
    """
    state, order, parameter = settings.config.state, settings.config.order, settings.config.parameter
    R = np.asarray(settings.R)
    return reference.Fltea(
        reference.System(
            A=lambda w: w.reshape(1, 1), B=np.eye(1), C=np.eye(1), h=float(np.asarray(settings.h))
        ),
        reference.OrderSettings(P0=order.P0, Q0=order.Q0, alpha0=order.alpha0, R=R, delta=order.delta),
        reference.ParameterSettings(
            P0=parameter.P0, Q0=parameter.Q0, w0=parameter.f0, R=R, delta=parameter.delta
        ),
        reference.StateSettings(P0=state.P0, Q=state.Q, x0=state.x0, R=R),
        window=length,
    )
