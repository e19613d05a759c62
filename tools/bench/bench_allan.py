"""Cost of the Allan deviation: running sums a sample, and a curve with its intervals and the model's."""

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from fltea._native import AllanSums
from fltea.noise.allan_deviation import model_adev
from fltea.noise.spectra import fractional
from fltea.spectrum.allan_curve import live_allan

SAMPLES = 1_000_000
REPETITIONS = 9
H = 0.01
MEMORY_SAMPLES = 60_000.0
TARGET_NS = 10.0


def measure() -> dict[str, Any]:
    """Nanoseconds a sample of one axis, and milliseconds a curve: processor time, medians of the rounds."""
    y = np.random.default_rng(1).standard_normal(SAMPLES)
    sums = AllanSums()
    sums.add(y)
    points, span = sums.points(), sums.span
    contenders: dict[str, Callable[[], object]] = {
        "plain": lambda: AllanSums().add(y),
        "forgetting": lambda: AllanSums(MEMORY_SAMPLES).add(y),
        "curve": lambda: live_allan(*points, span, H),
        "model": lambda: model_adev(lambda lam: 3 * fractional(lam, 0.8, -0.025) + 1, points[0]),
    }
    rounds = [{name: _seconds(run) for name, run in contenders.items()} for _ in range(REPETITIONS)]
    median = {name: statistics.median(one[name] for one in rounds) for name in contenders}
    return {
        "samples": SAMPLES,
        "repetitions": REPETITIONS,
        "ns_per_sample": median["plain"] / SAMPLES * 1e9,
        "ns_per_sample_forgetting": median["forgetting"] / SAMPLES * 1e9,
        "curve_ms": median["curve"] * 1e3,
        "model_ms": median["model"] * 1e3,
        "bytes_saved": len(sums.save()),
    }


def text(figures: dict[str, Any]) -> str:
    """Return the figures as lines for people."""
    return "\n".join(
        [
            f"Allan deviation of one axis, processor time, medians of {figures['repetitions']} rounds",
            f"sums {figures['ns_per_sample']:.1f} ns a sample (at most {TARGET_NS:g}), "
            f"forgetting {figures['ns_per_sample_forgetting']:.1f}; {figures['bytes_saved']:,} bytes saved",
            f"a curve with intervals, N, B and K {figures['curve_ms']:.2f} ms, "
            f"that of the model {figures['model_ms']:.2f} ms, after {figures['samples']:,} samples",
        ]
    )


def _seconds(run: Callable[[], object]) -> float:
    start = time.process_time()
    run()
    return time.process_time() - start
