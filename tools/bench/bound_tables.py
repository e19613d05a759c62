"""Critical values where there is no white noise, and how often intervals with them hold the truth.

First table: two normal estimates with the correlation ρ, of which the second, R, cannot be below 0, and has
its best value there while the first is held at its truth. The 95 % point of the ratio of likelihoods then
depends on ρ alone. What `spectrum.profile.AT_BOUND` was chosen by, with the correlations that the information
gives for 35 noises without white noise (second table).

Third table: ordinates are drawn from the spectra of those noises, and the truth is inside if 2 log L there is
within the critical value of the best: no search for ends, no leakage.

Usage: python -m tools.bench.bound_tables [--series 1000]; a minute for each 200 series on one core.
"""

import argparse
from collections.abc import Iterator

import numpy as np
from fltea.noise import spectra as spectrum
from fltea.spectrum.models import FULL, held, share
from fltea.spectrum.periodogram import Binned, Periodogram, binned, used_ordinates
from fltea.spectrum.profile import AT_BOUND, CRITICAL, NO_WHITE
from fltea.spectrum.whittle import fit

H = 0.01
LENGTHS = (3_000, 20_000, 60_000)
ORDERS = (0.25, 0.3, 0.35, 0.45, 0.5, 0.65, 0.9)
FEEDBACKS = (0.02, 0.05, 0.08, 0.2, 0.4)
"""-g / 2^α"""
NAMES = ("alpha", "f", "F")
CRITICAL_VALUES = (CRITICAL, 4.4, 4.6, 4.8, 5.1, 5.5, 6.0)
CORRELATIONS = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 1.0)
DRAWN = 1_000_000


def at_bound(correlation: float) -> float:
    """The 95 % point for two normal estimates, given that R is 0 while the other is held."""
    rng = np.random.default_rng(0)
    rest = np.sqrt(max(1 - correlation**2, 1e-12))
    other = rng.standard_normal(DRAWN)
    below = np.abs(
        rng.standard_normal(DRAWN)
    )  # what R would be below 0, in its deviation while the other is held
    free = np.minimum(correlation * other - rest * below, 0.0)  # the same while nothing is held
    return float(np.quantile(other**2 + below**2 - free**2, 0.95))


def correlations(alpha: float, g: float, n: int) -> dict[str, float]:
    """Of α, f, F and s2 with R, where R is 0, by the information of n samples."""
    lam = 2 * np.pi * used_ordinates(n, 1.0) / n

    def log_spectrum(at: np.ndarray) -> np.ndarray:
        return np.asarray(np.log(at[2] * spectrum.fractional(lam, at[0], at[1]) + at[3]))

    at, step = np.array([alpha, g, 1.0, 1e-4]), 1e-5
    slopes = [(log_spectrum(at + step * e) - log_spectrum(at - step * e)) / (2 * step) for e in np.eye(4)]
    spread = np.linalg.inv(np.array(slopes) @ np.array(slopes).T)
    f = spectrum.f_of(alpha, g, H)
    rows = np.array([[1, 0, 0, 0], [-f * np.log(H), f / g, 0, 0], [1, 1, 0, 0], [0, 0, 1, 0]])
    deviations = np.sqrt(np.einsum("ij,jk,ik->i", rows, spread, rows) * spread[3, 3])
    return dict(zip((*NAMES, "s2"), np.abs(rows @ spread[:, 3]) / deviations, strict=True))


def ratios(alpha: float, g: float, n: int, series: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """2 log L at the truth of `NAMES` below the best, and whether R is 0 there; (series,) each."""
    lam = 2 * np.pi * used_ordinates(n, 1.0) / n
    layout = binned(Periodogram(lam, np.ones(len(lam)), 1.0, n))
    rng = np.random.default_rng([n, round(100 * alpha), round(-1000 * g)])
    drawn = rng.gamma(layout.counts, size=(series, len(layout.lam))) / layout.counts
    data = Binned(layout.lam, layout.counts, spectrum.fractional(layout.lam, alpha, g) * drawn)
    best = fit(data, FULL)
    for name, value in zip(NAMES, (alpha, spectrum.f_of(alpha, g, H), alpha + g), strict=True):
        found = fit(data, held(name, value, H))
        weight = share(found.theta[:, -1])
        yield 2 * (found.nll - best.nll), (1 - weight) < NO_WHITE * weight


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--series", type=int, default=1_000, help="of each noise")
    series = parser.parse_args().series
    print("correlation with R  critical value at R = 0")
    for correlation in CORRELATIONS:
        print(f"{correlation:18.2f}  {at_bound(correlation):.2f}")
    noises = [(alpha, -part * 2**alpha) for alpha in ORDERS for part in FEEDBACKS]
    print("\nsamples  parameter  correlation with R: 10 %, 50 %, 90 % of the noises  taken")
    for n in LENGTHS:
        found = [correlations(*noise, n) for noise in noises]
        for name in (*NAMES, "s2"):
            low, middle, high = np.quantile([one[name] for one in found], [0.1, 0.5, 0.9])
            print(f"{n:7,d}  {name:9}  {low:.3f}  {middle:.3f}  {high:.3f}  {AT_BOUND[name]}")
    print("\nsamples  parameter  critical  mean   least  most   93 to 97 %  below  above")
    for n in LENGTHS:
        by_name = zip(*(tuple(ratios(*noise, n, series)) for noise in noises), strict=True)
        for name, each in zip(NAMES, by_name, strict=True):
            for critical in CRITICAL_VALUES:
                held_by = np.array([np.mean(one <= np.where(at, critical, CRITICAL)) for one, at in each])
                low, high = np.mean(held_by < 0.93), np.mean(held_by > 0.97)
                print(
                    f"{n:7,d}  {name:9}  {critical:8.2f}  {held_by.mean():.1%}  {held_by.min():.1%}"
                    f"  {held_by.max():.1%}  {1 - low - high:10.0%}  {low:5.0%}  {high:5.0%}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
