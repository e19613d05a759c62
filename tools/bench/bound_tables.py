"""How often intervals hold the truth of noises without white noise, by the critical value at R = 0.

Ordinates are drawn from the spectrum, and the truth is inside if 2 log L there is within the critical value
of the best: no search for ends, no leakage. What `spectrum.profile.CRITICAL_AT_BOUND` was chosen by.

Usage: python -m tools.bench.bound_tables [--series 1000]; two minutes on one core.
"""

import argparse
from collections.abc import Iterator

import numpy as np
from fltea.noise import spectra as spectrum
from fltea.spectrum.models import FULL, held, share
from fltea.spectrum.periodogram import Binned, Periodogram, binned, used_ordinates
from fltea.spectrum.profile import CRITICAL
from fltea.spectrum.whittle import fit

H = 0.01
LENGTHS = (3_000, 20_000, 60_000)
ORDERS = (0.25, 0.3, 0.35, 0.45, 0.5, 0.65, 0.9)
FEEDBACKS = (0.02, 0.05, 0.08, 0.2, 0.4)
"""-g / 2^α"""
CRITICAL_VALUES = (CRITICAL, 4.24, 4.6, 5.0, 5.5, 6.0)
NO_WHITE = 1e-3


def ratios(alpha: float, g: float, n: int, series: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """2 log L at the truth of α, f and F below the best, and whether R is 0 there; (series,) each."""
    lam = 2 * np.pi * used_ordinates(n, 1.0) / n
    layout = binned(Periodogram(lam, np.ones(len(lam)), 1.0, n))
    rng = np.random.default_rng([n, round(100 * alpha), round(-1000 * g)])
    drawn = rng.gamma(layout.counts, size=(series, len(layout.lam))) / layout.counts
    data = Binned(layout.lam, layout.counts, spectrum.fractional(layout.lam, alpha, g) * drawn)
    best = fit(data, FULL)
    for name, value in (("alpha", alpha), ("f", spectrum.f_of(alpha, g, H)), ("F", alpha + g)):
        found = fit(data, held(name, value, H))
        weight = share(found.theta[:, -1])
        yield 2 * (found.nll - best.nll), (1 - weight) < NO_WHITE * weight


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--series", type=int, default=1_000, help="of each noise")
    series = parser.parse_args().series
    print("samples  critical  mean   least  most   93 to 97 %  below  above")
    for n in LENGTHS:
        found = [
            one
            for alpha in ORDERS
            for part in FEEDBACKS
            for one in ratios(alpha, -part * 2**alpha, n, series)
        ]
        for critical in CRITICAL_VALUES:
            held_by = np.array([np.mean(ratio <= np.where(at, critical, CRITICAL)) for ratio, at in found])
            low, high = np.mean(held_by < 0.93), np.mean(held_by > 0.97)
            print(
                f"{n:7,d}  {critical:8.2f}  {held_by.mean():.1%}  {held_by.min():.1%}  {held_by.max():.1%}"
                f"  {1 - low - high:10.0%}  {low:5.0%}  {high:5.0%}",
                flush=True,
            )


if __name__ == "__main__":
    main()
