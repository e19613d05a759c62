"""Measure how far the likelihood may fall at the ends of a 95 % interval if a noise has no white noise.

Usually 2 log L (L: likelihood) falls by 3.84. This is different if the variance R of the white noise is 0,
since R cannot be negative. The fall then depends on the correlation ρ of R with the interval's parameter.
The first table gives the fall for several ρ, from simulated pairs of normally distributed estimates. The
second table gives ρ for 35 noises without white noise, from the Fisher information.

The limits in `spectrum.intervals.AT_BOUND` were chosen from both tables. The part `evaluate` counts how often
intervals with these limits contain the true value.
"""

from typing import Any

import numpy as np
from fltea.noise import spectra as spectrum
from fltea.spectrum.intervals import AT_BOUND
from fltea.spectrum.periodogram import used_ordinates

from tools.validation.evaluate.cramer_rao import log_slopes
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table, grouped

SEEDS = QUICK_SEEDS = 1
"""One run suffices: only the first table uses random numbers, and these are always the same."""
H = 0.01
LENGTHS = (3_000, 20_000, 60_000)
ORDERS = (0.25, 0.3, 0.35, 0.45, 0.5, 0.65, 0.9)
FEEDBACKS = (0.02, 0.05, 0.08, 0.2, 0.4)
"""The simulated values of -g / 2^α, where g = h^α f and h is the sampling period: they reach from 0 (a state
that never forgets) to 1 (the limit of stationarity).
"""
NEARLY_ZERO = 1e-4
"""Ratio of R to the variance of the steps of the state, in place of 0. With 1e-8 the correlations differ by
at most 0.0001.
"""
NAMES = ("alpha", "f", "F")
CORRELATIONS = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 1.0)
DRAWN = 1_000_000


def tasks(options: Options) -> list[Task]:
    """Return one task for the first table, and one for the noises of each record length."""
    lengths = LENGTHS[:1] if options.quick else LENGTHS
    related = [Task(f"{n:,} samples", correlated, (n,)) for n in lengths]
    return [Task("critical values", critical_values, ()), *related]


def critical_values() -> list[Row]:
    """Return a critical value for each correlation: the 95 % point of a difference of 2 log L.

    Two estimates with this correlation are simulated: R, which cannot be negative, and another parameter.
    The difference is that between two fits. In one, both are free. In the other, the other parameter has its
    true value, and R is 0. Only pairs count for which 0 is then the best R.
    """
    rng = np.random.default_rng(0)
    other, below = rng.standard_normal(DRAWN), np.abs(rng.standard_normal(DRAWN))
    # All numbers are in standard deviations. `other`: error of the other parameter if both are free. `below`:
    # how far R would be below 0 if it could be negative, and the other parameter had its true value. `free`:
    # the R that would be best if it could be negative and both are free; values above 0 are replaced by 0.
    rows: list[Row] = []
    for rho in CORRELATIONS:
        free = np.minimum(rho * other - np.sqrt(max(1 - rho**2, 1e-12)) * below, 0.0)
        rows.append({"rho": rho, "critical": float(np.quantile(other**2 + below**2 - free**2, 0.95))})
    return rows


def correlated(n: int) -> list[Row]:
    """Return the correlations of α, f, F and s2 with R (see `correlations`), for each of the 35 noises."""
    noises = [(alpha, -part * 2**alpha) for alpha in ORDERS for part in FEEDBACKS]
    return [
        {"samples": n, "parameter": name, "correlation": correlation}
        for alpha, g in noises
        for name, correlation in correlations(alpha, g, n).items()
    ]


def correlations(alpha: float, g: float, n: int) -> dict[str, float]:
    """Return the correlations of α, f, F and s2 with R, by the Fisher information of n samples.

    R is the variance of the white noise. The correlations are taken at R = `NEARLY_ZERO`, for s2 = 1: the
    slopes are those by log R, which has no value at R = 0.
    g = h^α f, where h is the sampling period; F = g + α; s2 is the variance of the steps of the state.
    """
    lam = 2 * np.pi * used_ordinates(n, 1.0) / n
    slopes = log_slopes(lam, alpha, g, 1.0, NEARLY_ZERO)
    spread = np.linalg.inv(slopes @ slopes.T)
    f = spectrum.f_of(alpha, g, H)
    rows = np.array([[1, 0, 0, 0], [-f * np.log(H), f / g, 0, 0], [1, 1, 0, 0], [0, 0, 1, 0]])
    deviations = np.sqrt(np.einsum("ij,jk,ik->i", rows, spread, rows) * spread[3, 3])
    found = (np.abs(rows @ spread[:, 3]) / deviations).tolist()
    return dict(zip((*NAMES, "s2"), found, strict=True))


def tables(rows: list[Row]) -> list[Table | str]:
    """Return two tables: the critical value for each correlation with R, and the noises' correlations."""
    points = [(f"{row['rho']:.2f}", f"{row['critical']:.2f}") for row in rows if "rho" in row]
    noises = grouped(
        (row for row in rows if "samples" in row), lambda row: (f"{row['samples']:,}", row["parameter"])
    )
    related: list[Any] = []
    for (n, name), some in noises.items():
        spread = np.quantile([row["correlation"] for row in some], [0.1, 0.5, 0.9])
        related.append((n, name, *(f"{one:.3f}" for one in spread), f"{AT_BOUND[name]}"))
    return [
        Table("95 % points at R = 0", ("correlation with R", "critical value"), points),
        Table(
            "Correlation with R, over the noises",
            ("samples", "parameter", "10 %", "50 %", "90 %", "taken"),
            related,
        ),
    ]
