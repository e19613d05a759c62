"""What fits of a spectrum cost an axis: all models from the last answer, from the grid, and all intervals."""

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from fltea.noise import spectra as spectrum
from fltea.spectrum.models import AR1, AR2, FULL, TWO_AR1, UP_TO_ONE, WHITE
from fltea.spectrum.periodogram import Binned
from fltea.spectrum.profile import fractional_fit
from fltea.spectrum.whittle import fit

H = 0.01
BINS = 130
REPETITIONS = 9
MODELS = (WHITE, AR1, UP_TO_ONE, FULL, AR2, TWO_AR1)
CASES = ((0.3, -1.5, 3.0), (0.6, -3.0, 3.0), (0.8, -1.0, 0.3), (0.8, -10.0, 3.0))
"""α, f and s2/R."""


def measure() -> dict[str, Any]:
    """Milliseconds an axis, each the median of the rounds, of the mean over `CASES`; processor time."""
    axes = [_axis(*case, seed) for seed, case in enumerate(CASES)]
    found = [[fit(axis, model) for model in MODELS] for axis in axes]

    def cold() -> None:
        for axis in axes:
            for model in MODELS:
                fit(axis, model)

    def warm() -> None:
        for axis, fits in zip(axes, found, strict=True):
            for one in fits:
                fit(axis, one.model, warm=one.theta + 0.02)

    def intervals() -> None:
        for axis, fits in zip(axes, found, strict=True):
            fractional_fit(axis, next(one for one in fits if one.model is FULL), H)

    figures: dict[str, Any] = {"bins": BINS, "models": len(MODELS), "repetitions": REPETITIONS}
    for name, run in (("cold", cold), ("warm", warm), ("intervals", intervals)):
        times = [_ms(run) / len(axes) for _ in range(REPETITIONS)]
        figures |= {f"{name}_ms": statistics.median(times), f"{name}_ms_max": max(times)}
    return figures


def text(figures: dict[str, Any]) -> str:
    """Return the figures as lines for people."""
    head = f"Whittle fits, ms an axis of {figures['bins']} bins, processor time: median (largest)"
    labels = {
        "warm": f"{figures['models']} models from the last answer",
        "cold": f"{figures['models']} models from the grid",
        "intervals": "intervals of 6 parameters",
    }
    lines = [
        f"{label:<34}{figures[f'{n}_ms']:>7.2f} ({figures[f'{n}_ms_max']:.2f})" for n, label in labels.items()
    ]
    return "\n".join([head, *lines])


def _axis(alpha: float, f: float, ratio: float, seed: int) -> Binned:
    """Bins that grow with the frequency, as those of the live spectrum after ten minutes."""
    edges = np.geomspace(4e-4, np.pi, BINS + 1)
    lam = (edges[1:] + edges[:-1]) / 2
    counts = np.maximum(1.0, np.diff(edges) * 60_000 / (2 * np.pi))
    shape = ratio * spectrum.fractional(lam, alpha, H**alpha * f) + 1
    power = shape * np.random.default_rng(seed).gamma(counts) / counts
    return Binned(lam, counts, power[np.newaxis])


def _ms(run: Callable[[], None]) -> float:
    begin = time.process_time()
    run()
    return 1e3 * (time.process_time() - begin)
