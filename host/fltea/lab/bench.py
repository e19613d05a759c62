"""Measure the speed of the estimator: engine, numpy reference and filterpy's unscented filter side by side.

The three contenders run on one core in one run of the program. Every repetition measures all three one after
the other, so that a change of the processor's clock rate affects all of them. Results are medians over
repetitions. Times are processor times (user and system), not wall-clock times, so that other programs matter
less. The filters' memories are full before the first measurement.

This is a command of the program (`fltea bench estimator`), so that users without a clone can find out how
many axes a machine can estimate. `make bench` runs it, too, with all other benchmarks.
"""

import statistics
import time
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fltea.estimator.engine import Engine, instruction_sets
from fltea.lab.reproduce.paper import SAMPLES_PER_SECOND
from fltea.lab.reproduce.runs import Options, lane_settings
from fltea.lab.reproduce.scenarios import GYROSCOPE_FILTERS
from fltea.lab.reproduce.timing import reference_filters
from fltea.records.errors import FlteaError
from fltea.settings.extras import how_to_install

WINDOW = 3000
WINDOWS = {str(n): n for n in (1_000, 10_000, 100_000, 1_000_000)} | {"unlimited": 0}
LANES = tuple(2**i for i in range(11))

# Number of axis-steps in one measurement of each contender. An axis-step is the processing of one sample of
# one axis. Fast contenders take about 0.1 s for this number. Slow contenders are measured for longer, so that
# the result is repeatable.
STEPS = {"engine_compressed": 200_000, "engine_direct": 20_000, "reference": 500, "filterpy_ukf": 2_000}
LANE_STEPS = 400_000

TARGETS = {
    "compressed_over_direct": ("speed, compressed : direct", 8.0),
    "compressed_over_filterpy": ("speed, compressed : filterpy", 100.0),
    "window_1e6_over_1e3": ("cost, L = 1,000,000 : L = 1,000", 1.15),
    "engine_compressed": ("axis-steps/s, one lane", 3e6),
    "engine_compressed_lanes": ("axis-steps/s, many lanes", 12e6),
}
"""Description and target of each result. A cost, such as that of L = 1,000,000 relative to L = 1,000, has to
be at most its target. All other results have to be at least their targets.
"""

Work = Callable[[], int]
"""A function that does some axis-steps (one sample of one axis each) and returns their number."""


def measure(repetitions: int = 5, scale: float = 1.0) -> dict[str, Any]:
    """Measure speed and memory of all contenders, and return the figures.

    Speeds are in axis-steps per second; that of filterpy is None if filterpy is not installed. `repetitions`:
    number of repetitions of each measurement. `scale`: factor by which measurements are lengthened; below 1
    in tests, which shortens them.

    Raises:
        FlteaError: estimates of the engine were not finite, so that the measured figures are void.
    """
    single = round(STEPS["engine_compressed"] * scale)
    contenders: dict[str, Work] = {
        "engine_compressed": _engine(1, WINDOW, "compressed", single, scale),
        "engine_direct": _engine(1, WINDOW, "direct", round(STEPS["engine_direct"] * scale), scale),
        "reference": _reference(round(STEPS["reference"] * scale), scale),
    }
    if (peer := _filterpy(round(STEPS["filterpy_ukf"] * scale))) is not None:
        contenders["filterpy_ukf"] = peer
    speed: dict[str, Any] = {"filterpy_ukf": None} | _in_turns(contenders, repetitions)
    lanes = {
        str(n): _engine(n, WINDOW, "compressed", max(1, round(LANE_STEPS * scale) // n), scale) for n in LANES
    }
    speed["engine_compressed_lanes"] = _in_turns(lanes, repetitions)
    windows = {name: _engine(1, w, "compressed", single, scale) for name, w in WINDOWS.items()}
    per_step = {name: 1e9 / rate for name, rate in _in_turns(windows, repetitions).items()}
    return {
        "axis_steps_per_s": speed,
        "ns_per_step_by_window": per_step,
        "bytes_per_lane": {name: _bytes_per_lane(w) for name, w in WINDOWS.items()},
        "ratios": _ratios(speed, per_step),
        "paper_samples_per_s": SAMPLES_PER_SECOND,
        "window": WINDOW,
        "repetitions": repetitions,
        "instruction_set": instruction_sets()[0],
    }


def text(result: dict[str, Any]) -> str:
    """Format the figures of `measure` as tables, with the targets."""
    speed, per_step, ratios = (result[key] for key in ("axis_steps_per_s", "ns_per_step_by_window", "ratios"))
    lines = [
        f"Axis-steps per second, one core, L = {WINDOW:,}, medians of {result['repetitions']}, "
        f"instruction set {result['instruction_set']}",
        "",
        "| | axis-steps/s | times the paper |",
        "|---|---|---|",
    ]
    names = {
        "engine_compressed": "engine, compressed memory, one lane",
        "engine_direct": "engine, direct memory, one lane",
        "reference": "numpy reference",
        "filterpy_ukf": "filterpy UnscentedKalmanFilter, no memory",
    }
    for key, name in names.items():
        rate = speed[key]
        shown = f"not installed ({how_to_install('bench')}) | –"
        if rate is not None:
            shown = f"{rate:,.0f} | {rate / result['paper_samples_per_s']:,.0f}"
        lines.append(f"| {name} | {shown} |")
    lines += [f"| paper (MATLAB, table 1, L = 4,000) | {result['paper_samples_per_s']:.1f} | 1 |", ""]
    lines += ["| lanes | axis-steps/s | ns a lane-step |", "|---|---|---|"]
    lines += [
        f"| {int(n):,} | {rate:,.0f} | {1e9 / rate:.1f} |"
        for n, rate in speed["engine_compressed_lanes"].items()
    ]
    lines += ["", "| L | ns a step | bytes a lane |", "|---|---|---|"]
    for key, ns in per_step.items():
        shown = key if key == "unlimited" else f"{int(key):,}"
        lines.append(f"| {shown} | {ns:.0f} | {result['bytes_per_lane'][key]:,.0f} |")
    lines += ["", "| | measured | to reach |", "|---|---|---|"]
    for key, (name, target) in TARGETS.items():
        bound = "at most" if key == "window_1e6_over_1e3" else "at least"
        measured = "–" if ratios[key] is None else f"{ratios[key]:,.4g}"
        lines.append(f"| {name} | {measured} | {bound} {target:,g} |")
    return "\n".join(lines)


def _ratios(speed: dict[str, Any], per_step: dict[str, float]) -> dict[str, float | None]:
    """Return the measured values that are compared with `TARGETS`, under the same names.

    A value is None if filterpy is not installed.
    """
    compressed, peer = speed["engine_compressed"], speed["filterpy_ukf"]
    return {
        "compressed_over_direct": compressed / speed["engine_direct"],
        "compressed_over_filterpy": None if peer is None else compressed / peer,
        "window_1e6_over_1e3": per_step["1000000"] / per_step["1000"],
        "engine_compressed": compressed,
        "engine_compressed_lanes": max(speed["engine_compressed_lanes"].values()),
    }


def _in_turns(contenders: dict[str, Work], repetitions: int) -> dict[str, float]:
    """Return the median axis-steps per second of each contender.

    The contenders are measured one after the other, after a first round that does not count.
    """
    rates: dict[str, list[float]] = {name: [] for name in contenders}
    for turn in range(repetitions + 1):
        for name, work in contenders.items():
            start = time.process_time()
            steps = work()
            seconds = time.process_time() - start
            if turn:
                rates[name].append(steps / max(seconds, 1e-9))
    return {name: statistics.median(values) for name, values in rates.items()}


def _noise(shape: tuple[int, ...]) -> NDArray[np.float64]:
    R = np.asarray(GYROSCOPE_FILTERS.R)
    return np.random.default_rng(1).normal(0, float(np.sqrt(R)), shape)


def _engine(
    lanes: int, window: int, memory: Literal["direct", "compressed"], steps: int, scale: float
) -> Work:
    """Return a function that runs an engine with the paper's settings for the gyroscope, to be measured.

    The engine's memory of past samples is filled before. If `scale` is below 1, only this proportion of it is
    filled.
    """
    engine = Engine(lanes, lane_settings(GYROSCOPE_FILTERS, window, Options(memory=memory)))
    y = _noise((max(1, steps), lanes))
    fill = round((window or WINDOW) * min(scale, 1.0))
    for begin in range(0, fill, len(y)):
        engine.run(y[: fill - begin])

    def work() -> int:
        if not np.isfinite(engine.run(y).x[-1]).all():
            raise FlteaError("the estimates of the benchmark are not finite: its figures are void.")
        return y.size

    return work


def _reference(steps: int, scale: float) -> Work:
    filters = reference_filters(GYROSCOPE_FILTERS, WINDOW)
    y = _noise((max(1, steps),)).tolist()
    for sample in _noise((round(WINDOW * min(scale, 1.0)),)).tolist():
        filters.step(sample)

    def work() -> int:
        for sample in y:
            filters.step(sample)
        return len(y)

    return work


def _filterpy(steps: int) -> Work | None:
    """Return a function that runs filterpy's unscented filter; None if filterpy is not installed.

    The filter has one state and one measurement.
    """
    try:
        from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
    except ImportError:
        return None
    # these settings give the paper's sigma points
    points = MerweScaledSigmaPoints(1, alpha=1.0, beta=2.0, kappa=2.0)
    peer = UnscentedKalmanFilter(
        dim_x=1, dim_z=1, dt=0.01, hx=lambda x: x, fx=lambda x, dt: 0.9 * x, points=points
    )
    peer.x = np.zeros(1)
    state, R = GYROSCOPE_FILTERS.config.state, GYROSCOPE_FILTERS.R
    peer.P, peer.Q, peer.R = (np.array([[value]], dtype=np.float64) for value in (state.P0, state.Q, R))
    y = _noise((max(1, steps), 1))

    def work() -> int:
        for sample in y:
            peer.predict()
            peer.update(sample)
        return len(y)

    return work


def _bytes_per_lane(window: int) -> float:
    """Return the bytes that an engine of 8 lanes (independent filters) needs for each lane.

    Eight lanes fill one vector of the widest instruction set, so no part of a vector is wasted.
    """
    return Engine(8, lane_settings(GYROSCOPE_FILTERS, window, Options(memory="compressed"))).storage_bytes / 8
