"""Critical values where there is no white noise, and how often intervals with them hold the truth.

First table: two normal estimates with the correlation ρ, of which the second, R, cannot be below 0, and has
its best value there while the first is held at its truth. The 95 % point of the ratio of likelihoods then
depends on ρ alone. `spectrum.intervals.AT_BOUND` was chosen by it, with the correlations that the information
gives for 35 noises without white noise (second table).

Third table: ordinates are drawn from the spectra of those noises, and the truth is inside if 2 log L there is
within the critical value of the best: no search for ends, no leakage.
"""

from typing import Any

import numpy as np
from fltea._native import Sentences
from fltea.noise import spectra as spectrum
from fltea.noise.information import log_slopes
from fltea.noise.parts import CODES, Order, White
from fltea.spectrum.frontier import native
from fltea.spectrum.intervals import AT_BOUND, BY_F, BY_PARAMETER, CRITICAL
from fltea.spectrum.periodogram import Binned, Periodogram, binned, used_ordinates
from numpy.typing import NDArray

from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table, grouped

Array = NDArray[np.float64]

SEEDS, QUICK_SEEDS = 1_000, 50
"""Series of each noise and length."""
H = 0.01
LENGTHS = (3_000, 20_000, 60_000)
ORDERS = (0.25, 0.3, 0.35, 0.45, 0.5, 0.65, 0.9)
FEEDBACKS = (0.02, 0.05, 0.08, 0.2, 0.4)
"""-g / 2^α"""
NAMES = ("alpha", "f", "F")
CRITICAL_VALUES = (CRITICAL, 4.4, 4.6, 4.8, 5.1, 5.5, 6.0)
CORRELATIONS = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 1.0)
DRAWN = 1_000_000
ORDER = CODES.index(Order)
HELD = {"alpha": (ORDER, 1), "f": (BY_PARAMETER, 2), "F": (BY_F, 1)}
"""The order's number by other coordinates, and which of all coordinates is held."""
LITTLE_WHITE, NO_WHITE = (-2.0, -6.0), -6.9
"""Logarithms of R over s2: fits begin at the first; below the second there is none."""


def tasks(options: Options) -> list[Task]:
    """Return a task for the first table, and one for each noise and length."""
    lengths = LENGTHS[:1] if options.quick else LENGTHS
    noises = [(alpha, -part * 2**alpha) for alpha in ORDERS for part in FEEDBACKS]
    return [
        Task("critical values", critical_values, ()),
        *(
            Task(f"α = {alpha:g}", count, (alpha, g, n, options.seeds))
            for n in lengths
            for alpha, g in noises
        ),
    ]


def critical_values() -> list[Row]:
    """Return the 95 % points for two normal estimates, given that R is 0 while the other is held."""
    rng = np.random.default_rng(0)
    other, below = rng.standard_normal(DRAWN), np.abs(rng.standard_normal(DRAWN))
    # below: what R would be below 0, in its deviation while the other is held; free: the same, nothing held
    rows: list[Row] = []
    for rho in CORRELATIONS:
        free = np.minimum(rho * other - np.sqrt(max(1 - rho**2, 1e-12)) * below, 0.0)
        rows.append({"rho": rho, "critical": float(np.quantile(other**2 + below**2 - free**2, 0.95))})
    return rows


def count(alpha: float, g: float, n: int, series: int) -> list[Row]:
    """Return each parameter's correlation with R, and how often each critical value holds it."""
    by_name = correlations(alpha, g, n)
    lam = 2 * np.pi * used_ordinates(n, 1.0) / n
    layout = binned(Periodogram(lam, np.ones(len(lam)), 1.0, n))
    rng = np.random.default_rng([n, round(100 * alpha), round(-1000 * g)])
    drawn = rng.gamma(layout.counts, size=(series, len(layout.lam))) / layout.counts
    fits = [
        native(Binned(layout.lam, layout.counts, power[np.newaxis]), H, n)
        for power in spectrum.fractional(layout.lam, alpha, g) * drawn
    ]
    f, logit = spectrum.f_of(alpha, g, H), np.log(-g / (2**alpha + g))
    best = [_fit(one, ORDER, [alpha, logit])[1] for one in fits]
    rows: list[Row] = [{"samples": n, "parameter": "s2", "correlation": by_name["s2"], "held": None}]
    for name, start in (
        ("alpha", [alpha, logit]),
        ("f", [alpha, np.log(-f)]),
        ("F", [alpha + g, np.log(-g)]),
    ):
        code, index = HELD[name]
        found = [_fit(one, code, start, index) for one in fits]
        at = np.array([eta[0] < eta[3] + NO_WHITE for eta, _ in found])
        ratio = 2 * (np.array([nll for _, nll in found]) - best)
        shares = [float(np.mean(ratio <= np.where(at, one, CRITICAL))) for one in CRITICAL_VALUES]
        rows.append({"samples": n, "parameter": name, "correlation": by_name[name], "held": shares})
    return rows


def _fit(fits: Sentences, code: int, order: list[float], held: int = -1) -> tuple[list[float], float]:
    """Return the best coordinates and -log L of an order in white noise, of variances near 1 and 0."""
    codes = [CODES.index(White), code]
    found = [fits.fit(codes, [white, *order, 0.0], held=held) for white in LITTLE_WHITE]
    return min(found, key=lambda one: one[1])


def correlations(alpha: float, g: float, n: int) -> dict[str, float]:
    """Return those of α, f, F and s2 with R, where R is 0, by the information of n samples."""
    lam = 2 * np.pi * used_ordinates(n, 1.0) / n
    slopes = log_slopes(lam, alpha, g, 1.0, 1e-4)
    spread = np.linalg.inv(slopes @ slopes.T)
    f = spectrum.f_of(alpha, g, H)
    rows = np.array([[1, 0, 0, 0], [-f * np.log(H), f / g, 0, 0], [1, 1, 0, 0], [0, 0, 1, 0]])
    deviations = np.sqrt(np.einsum("ij,jk,ik->i", rows, spread, rows) * spread[3, 3])
    found = (np.abs(rows @ spread[:, 3]) / deviations).tolist()
    return dict(zip((*NAMES, "s2"), found, strict=True))


def tables(rows: list[Row]) -> list[Table | str]:
    """Return critical values, correlations, and shares that hold the truth."""
    points = [(f"{row['rho']:.2f}", f"{row['critical']:.2f}") for row in rows if "rho" in row]
    noises = grouped(
        (row for row in rows if "samples" in row), lambda row: (f"{row['samples']:,}", row["parameter"])
    )
    related: list[Any] = []
    shares: list[Any] = []
    for (n, name), some in noises.items():
        spread = np.quantile([row["correlation"] for row in some], [0.1, 0.5, 0.9])
        related.append((n, name, *(f"{one:.3f}" for one in spread), f"{AT_BOUND[name]}"))
        by_critical = zip(*(row["held"] for row in some), strict=True) if name in NAMES else ()
        for critical, held_by in zip(CRITICAL_VALUES, map(np.array, by_critical), strict=False):
            low, high = np.mean(held_by < 0.93), np.mean(held_by > 0.97)
            cells = (held_by.mean(), held_by.min(), held_by.max(), 1 - low - high, low, high)
            shares.append((n, name, f"{critical:.2f}", *(f"{one:.1%}" for one in cells)))
    return [
        Table("95 % points at R = 0", ("correlation with R", "critical value"), points),
        Table(
            "Correlation with R, over the noises",
            ("samples", "parameter", "10 %", "50 %", "90 %", "taken"),
            related,
        ),
        Table(
            "Shares that hold the truth, over the noises",
            ("samples", "parameter", "critical", "mean", "least", "most", "93 to 97 %", "below", "above"),
            shares,
        ),
    ]
