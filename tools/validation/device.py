"""Compare the board's estimates and fits with the host's.

For this, the board's code is compiled for the machine that runs this program.

For the comparison of estimates, the board computes in float and integers, the host's engine in double. The
host has the same settings as the board. Its memory is accurate to nine digits and not limited in time. The
samples are simulated noise and, if there are any, recordings of real sensors. For the fits, board and host
fit the same counts of twenty records of fractional noise in white noise.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from fltea.noise.simulation import quantise
from fltea.spectrum.candidate_models import CandidateModels, order_in_white
from fltea.spectrum.likelihood_ratio import p_value
from fltea.spectrum.octaves import Octaves
from fltea.spectrum.order_fit import order_fit
from fltea.spectrum.periodogram import binned
from numpy.typing import NDArray

from tests.rig.device_probe import LSB_PER_DPS, STARTUP, VARIANTS, Device, host_baseline, host_engine
from tests.rig.spectrum_probe import BoardSpectrum
from tools.validation.recursions import FractionalState
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table, grouped

Counts = NDArray[np.int16]

SEEDS, QUICK_SEEDS = 2, 1
"""Number of records that are drawn of each noise in NOISES, for the comparison of the fits."""
H = 0.01
RECORDINGS = Path(__file__).resolve().parents[3] / "shared/recordings"
AGES = (3_000, 100_000, 1_000_000)
CHUNK = 50_000
SIMULATED = {"white": None, "α 0.3, f -1": (0.3, -1.0), "α 0.6, f -3": (0.6, -3.0)}
"""For each simulated noise: α and f [s^-α], or None for white noise."""
SIGMA_DPS, FULL_SCALE_DPS = 0.15, 2_000.0
"""SIGMA_DPS: standard deviation of the noises in SIMULATED [deg/s]; their offset is 1 deg/s. FULL_SCALE_DPS:
the board's sensor measures from minus to plus this rate [deg/s].
"""

LEVEL = 0.05
SIGMA = 3.0
"""Standard deviation of the white noise in the fitted records [counts of the sensor]."""
NOISES = (
    *((0.3, -0.01, 0.05), (0.5, -0.02, 0.02), (0.6, -0.05, 0.3), (0.8, -0.005, 0.05), (0.4, -0.1, 0.5)),
    *((0.9, -0.01, 0.01), (0.7, -0.03, 0.1), (0.2, -0.02, 0.3), (1.0, -0.01, 0.05), (0.5, -0.005, 0.2)),
)
"""For each noise: α, g = h^α f (h: sampling period), and s2 / (s2 + R), where s2 is the variance of the steps
of the fractional state, and R that of the white noise.
"""
FITTED = (60_000, 1_000_000)


def tasks(options: Options) -> list[Task]:
    """Return the tasks.

    There is one task for each combination of an estimator variant and a series. For the fits there is one
    task for each record length.
    """
    samples, lengths = (AGES[1], FITTED[:1]) if options.quick else (AGES[2], FITTED)
    axes = [f"{file.stem} {axis}" for file in sorted(RECORDINGS.glob("*.npz")) for axis in "xyz"]
    return [
        *(
            Task(name, differences, (variant, name, samples))
            for variant in VARIANTS
            for name in [*axes, *SIMULATED]
        ),
        *(Task(f"{n:,} samples", agreement, (n, options.seeds), n) for n in lengths),
    ]


def series(name: str, samples: int) -> Counts:
    """Return the series with this name, in counts of the board's sensor.

    The series is an axis of a recording, or simulated noise.
    """
    if name not in SIMULATED:
        stem, _, axis = name.rpartition(" ")
        with np.load(RECORDINGS / f"{stem}.npz") as d:
            scale = LSB_PER_DPS / float(d["lsb_per_dps"])
            return np.asarray(np.rint(d["gyro_raw"][:, "xyz".index(axis)] * scale), dtype=np.int16)
    rng, n, truth = np.random.default_rng(20260601), STARTUP + samples, SIMULATED[name]
    draw: Callable[[np.random.Generator], Any] = partial(np.random.Generator.standard_normal, size=n)
    if truth is not None:
        draw = FractionalState(truth[0], H ** truth[0] * truth[1], n).draw
    noise = draw(rng)
    return quantise(1 + SIGMA_DPS * noise / noise.std(), LSB_PER_DPS, FULL_SCALE_DPS)


def differences(variant: str, name: str, samples: int) -> list[Row]:
    """Return how much the estimates of board and host differ on a series.

    The differences are |Δα| and |Δf|. The row has their largest values in the first 3,000, 100,000 … samples
    (AGES) and in all samples (`worst`), and their values after the last sample (`end`). It also says how
    often the host's guard intervened.
    """
    counts = series(name, samples)
    bias, R = host_baseline(counts[:STARTUP])
    device, host = Device(variant), host_engine(variant, R)
    device.run(counts[:STARTUP])
    alphas, fs, valid = [], [], True
    for first in range(STARTUP, len(counts), CHUNK):
        part = counts[first : first + CHUNK]
        rows, expected = device.run(part), host.run(part[:, None] / LSB_PER_DPS - bias)
        alphas.append(np.abs(rows["alpha"] - expected.alpha[:, 0]))
        fs.append(np.abs(rows["f"] - expected.f[:, 0]))
        valid = valid and bool((rows["flags"] == 1).all())
    alpha, f = np.concatenate(alphas), np.concatenate(fs)
    ages = [age for age in AGES if age < len(alpha)] + [len(alpha)]
    return [
        {
            "variant": variant,
            "series": name,
            "always_valid": valid,
            "interventions": int(sum(host.interventions()[0])),
            "worst": [[age, float(alpha[:age].max()), float(f[:age].max())] for age in ages],
            "end": [float(alpha[-1]), float(f[-1])],
        }
    ]


def agreement(samples: int, records: int) -> list[Row]:
    """Return, for each record, how much the board's fit and the host's fit differ.

    `records`: number of records of each noise.
    """
    rng = np.random.default_rng(20261101)
    found = [compare(drawn(samples, *noise, rng)) for noise in NOISES * records]
    return [{"fitted": samples, **one} for one in found]


def drawn(n: int, alpha: float, g: float, weight: float, rng: np.random.Generator) -> Counts:
    """Return samples of a fractional state in white noise as sensor counts.

    The samples are drawn from the noise's spectrum.
    """
    lam = np.maximum(np.arange(n + 1), 1) * np.pi / n
    turn = np.exp(-1j * lam)
    density = weight / np.abs((1 - turn) ** alpha - g * turn) ** 2 + 1 - weight
    parts = rng.standard_normal((2, n + 1))
    y = np.fft.irfft(np.sqrt(density * n) * (parts[0] + 1j * parts[1]))[:n]
    return np.ascontiguousarray(np.rint(SIGMA * y).astype(np.int16))


def compare(counts: Counts) -> dict[str, Any]:
    """Return the differences between the board's fit and the host's fit of the same counts."""
    board = BoardSpectrum()
    board.add(counts)
    found = board.fit()
    octaves = Octaves(1)
    octaves.add(counts[:, np.newaxis].astype(np.float64))
    spectra = octaves.periodogram(0, H)
    candidates = CandidateModels(binned(spectra), H, len(counts))
    white = p_value(candidates.ratio_white, spectra.ordinates) >= LEVEL
    best = order_in_white(candidates.native)
    order = order_fit(candidates, best).alpha
    half = (order.high - order.low) / 2 if order.low is not None and order.high is not None else None
    return {
        "board": found.alpha,
        "host": best.eta[1],
        "half_widths": None if half is None else abs(found.alpha - best.eta[1]) / half,
        "same_verdict": white == (found.verdict == 1),
    }


def tables(rows: list[Row]) -> list[Table | str]:
    """Return a table of the estimates' differences for each variant, and one of the fits' differences."""
    found: list[Table | str] = []
    by_variant = grouped((row for row in rows if "variant" in row), lambda row: row["variant"])
    for variant, some in by_variant.items():
        cells = [
            (
                row["series"],
                "; ".join(f"{age:,}: {alpha:.1e} ({f:.1e})" for age, alpha, f in row["worst"]),
                "{:.1e} ({:.1e})".format(*row["end"]),
                f"{row['interventions']}",
                "yes" if row["always_valid"] else "NO",
            )
            for row in some
        ]
        headings = ("series", "worst |Δα| (|Δf|) up to", "at the end", "guard acted", "always valid")
        found.append(Table(f"Estimates, {variant}", headings, cells))
    fits = []
    for samples, each in grouped((row for row in rows if "fitted" in row), lambda row: row["fitted"]).items():
        apart = sorted(row["half_widths"] for row in each if row["half_widths"] is not None)
        fits.append(
            (
                f"{samples:,}",
                f"{float(np.median(apart)):.3f}",
                f"{apart[-1]:.3f}",
                f"{sum(one <= 0.1 for one in apart)} of {len(each)}",
                f"{sum(row['same_verdict'] for row in each)}",
            )
        )
    headings = ("samples", "median", "largest", "within a tenth", "judged the same, white or not")
    return [*found, Table("Fits: |Δα| in half-widths of the host's 95 % interval", headings, fits)]
