"""How near the board's own fits are to the host's live fit of the same counts, which keeps more of them.

Usage: make bench ARGS="--device [--json]", or python -m tools.bench.board_agreement [--json] [--samples N]

Twenty fractional noises in white noise, by the device's code compiled for this machine
(tests/native/spectrum_probe.cpp) and by the host's octaves in double. Of a million samples: ten seconds.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from fltea.spectrum.likelihood_ratio import null_fits, p_value
from fltea.spectrum.models import FULL
from fltea.spectrum.octaves import Octaves
from fltea.spectrum.periodogram import binned
from fltea.spectrum.profile import fractional_fit
from fltea.spectrum.whittle import fit
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests/rig"))
from spectrum_probe import BoardSpectrum

H = 0.01
SIGMA = 3.0
"""Counts of the white part."""
LEVEL = 0.05
NOISES = (
    *((0.3, -0.01, 0.05), (0.5, -0.02, 0.02), (0.6, -0.05, 0.3), (0.8, -0.005, 0.05), (0.4, -0.1, 0.5)),
    *((0.9, -0.01, 0.01), (0.7, -0.03, 0.1), (0.2, -0.02, 0.3), (1.0, -0.01, 0.05), (0.5, -0.005, 0.2)),
)
"""α, g = h^α f, share of the state's innovations; each twice."""
SAMPLES = (60_000, 1_000_000)


def drawn(n: int, alpha: float, g: float, weight: float, rng: np.random.Generator) -> NDArray[np.int16]:
    """Counts of a fractional state in white noise, by its spectrum."""
    lam = np.maximum(np.arange(n + 1), 1) * np.pi / n
    turn = np.exp(-1j * lam)
    density = weight / np.abs((1 - turn) ** alpha - g * turn) ** 2 + 1 - weight
    parts = rng.standard_normal((2, n + 1))
    y = np.fft.irfft(np.sqrt(density * n) * (parts[0] + 1j * parts[1]))[:n]
    return np.ascontiguousarray(np.rint(SIGMA * y).astype(np.int16))


def compare(counts: NDArray[np.int16]) -> dict[str, Any]:
    """One noise: both orders, their difference in half-widths of the host's interval, both verdicts."""
    board = BoardSpectrum()
    board.add(counts)
    found = board.fit()
    octaves = Octaves(1)
    octaves.add(counts[:, np.newaxis].astype(np.float64))
    spectra = octaves.periodogram(0, H)
    data = binned(spectra)
    null = null_fits(data)
    white = p_value(float(null.likelihood_ratio[0]), spectra.ordinates) >= LEVEL
    order = fractional_fit(data, fit(data, FULL, null.alternative.theta[np.newaxis]), H, white=white).alpha
    half = (order.high - order.low) / 2 if order.low is not None and order.high is not None else None
    return {
        "board": found.alpha,
        "host": order.value,
        "half_widths": None if half is None else abs(found.alpha - order.value) / half,
        "same_verdict": white == (found.verdict == 1),
    }


def measure(samples: tuple[int, ...] = SAMPLES) -> dict[str, list[dict[str, Any]]]:
    """All noises of each length."""
    found: dict[str, list[dict[str, Any]]] = {}
    for n in samples:
        rng = np.random.default_rng(20261101)
        found[str(n)] = [compare(drawn(n, *noise, rng)) for noise in NOISES * 2]
    return found


def text(found: dict[str, list[dict[str, Any]]]) -> str:
    """A line for each length."""
    lines = ["the board's α and the host's, in half-widths of the host's 95 % interval"]
    for n, cases in found.items():
        apart = sorted(one["half_widths"] for one in cases if one["half_widths"] is not None)
        lines.append(
            f"{int(n):>9,} samples: median {float(np.median(apart)):.3f}, largest {apart[-1]:.3f}, "
            f"{sum(one <= 0.1 for one in apart)} of {len(cases)} within a tenth, "
            f"{sum(one['same_verdict'] for one in cases)} judged the same (white or not)"
        )
    return "\n".join(lines)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--samples", type=int, nargs="+", default=SAMPLES)
    arguments = parser.parse_args()
    found = measure(tuple(arguments.samples))
    print(json.dumps(found) if arguments.json else text(found))


if __name__ == "__main__":
    main()
