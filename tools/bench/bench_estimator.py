"""Speed of the reference estimator with a full memory of 3,000 samples, one gyroscope axis."""

import statistics
import time

import numpy as np
from fltea.estimator.gyroscope import GyroscopeEstimator
from fltea.estimator.settings import GyroscopeSettings

WINDOW = 3000
STEPS = 2000
REPETITIONS = 7
R = 0.0235
# Macias & Sierociuk 2023, table 1: 4,000 samples of example 1 at L = 4000, MATLAB 2021b on an i7-5500U. The
# memory grows from empty there, so on average it is half as long.
PAPER_SAMPLES, PAPER_SECONDS = 4000, 230.75


def measure() -> dict[str, float]:
    """Time STEPS steps REPETITIONS times; return steps per second (median, least, most) and the paper's."""
    noise = np.random.default_rng(1).standard_normal(WINDOW + REPETITIONS * STEPS) * R**0.5
    samples = iter(noise.tolist())
    estimator = GyroscopeEstimator(["x"], [R], [0.0], 0.01, GyroscopeSettings(window=WINDOW))
    for _ in range(WINDOW):
        estimator.step([next(samples)])
    rates = []
    for _ in range(REPETITIONS):
        start = time.perf_counter()
        for _ in range(STEPS):
            estimator.step([next(samples)])
        rates.append(STEPS / (time.perf_counter() - start))
    if estimator.restarts["x"]:
        raise RuntimeError("the estimator restarted, so its memory was not full: the figure is void")
    return {
        "window": WINDOW,
        "repetitions": REPETITIONS,
        "steps_per_s": statistics.median(rates),
        "steps_per_s_min": min(rates),
        "steps_per_s_max": max(rates),
        "paper_steps_per_s": PAPER_SAMPLES / PAPER_SECONDS,
    }
