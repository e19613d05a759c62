"""Simulates the distribution of `spectrum.likelihood_ratio` for white noise.

It writes host/fltea/spectrum/null_constants.py.

Periodogram ordinates of white noise are independent and exponential, so they are drawn directly, without time
series. The program computes the quantiles of the simulated likelihood ratios for each length of a record. It
then smooths each quantile as a function of the logarithm of the number of ordinates: by a straight line if
the quantile's probability is below 2 %, otherwise by a parabola. The host tests white noise against two
alternatives: an order in white noise, and white noise after a high-pass. The board tests only against the
first, so its test has quantiles of its own. The program takes some minutes on one core. Its figures may
differ between machines in the last digit, because a fit stops as soon as the likelihood is flat.

Usage: python -m tools.gen_null_constants [--series 6000] [--print]
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from fltea.spectrum.candidate_models import native
from fltea.spectrum.periodogram import Binned, Periodogram, binned, used_ordinates

from tools.generated import rendered, update

HERE = Path(__file__).resolve().parents[1] / "host/fltea/spectrum"

LENGTHS = (256, 1_000, 3_000, 12_000, 60_000, 400_000)
PROBABILITIES = (0.95, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.05, 0.025, 0.01, 0.005, 0.002, 0.001)
RARE = 0.02


def white_ratios(n: int, series: int, rng: np.random.Generator) -> np.ndarray:
    """Return the likelihood ratios of `series` white series of `n` samples each.

    The shape is (2, series). The first row is for the board's test, the second for the host's test.
    """
    lam = 2 * np.pi * used_ordinates(n, 1.0) / n
    layout = binned(Periodogram(lam, np.ones(len(lam)), 1.0, n))
    power = rng.gamma(layout.counts, size=(series, len(layout.lam))) / layout.counts
    each = (Binned(layout.lam, layout.counts, one[np.newaxis]) for one in power)
    found = np.array([native(data, 1.0, n).null_test([])[:2] for data in each])
    return np.array([found[:, 0], found.max(axis=1)])


def smoothed(quantiles: np.ndarray) -> list[list[float]]:
    """Return, for each probability, the coefficients of the curve that smooths its quantiles.

    `quantiles` has the shape (probabilities, lengths).
    """
    powers = np.log10([len(used_ordinates(n, 1.0)) for n in LENGTHS])
    return [
        [*np.polynomial.polynomial.polyfit(powers, row, 1 if p < RARE else 2), 0.0][:3]
        for p, row in zip(PROBABILITIES, quantiles, strict=True)
    ]


def main() -> int:
    """Simulate and write the constants; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--series", type=int, default=6_000, help="white series of each length")
    parser.add_argument("--print", action="store_true", help="write nothing; print the quantiles")
    arguments = parser.parse_args()
    rng = np.random.default_rng(20230217)
    quantiles = []
    for n in LENGTHS:
        ratios = white_ratios(n, arguments.series, rng)
        quantiles.append(np.quantile(ratios, 1 - np.array(PROBABILITIES), axis=1).T)
        print(f"n = {n}:", np.round(quantiles[-1], 2), flush=True)
    if arguments.print:
        return 0
    of_order, of_both = (smoothed(one) for one in np.array(quantiles).transpose(1, 2, 0))
    text = rendered(
        "null_constants.py",
        series=arguments.series,
        lengths=len(LENGTHS),
        probabilities=PROBABILITIES,
        coefficients=of_both,
        of_order=of_order,
    )
    return update(HERE, {"null_constants.py": text}, check=False, source="tools/gen_null_constants.py")


if __name__ == "__main__":
    sys.exit(main())
