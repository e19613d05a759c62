"""Measures how often the null test of `fltea identify` rejects white noise.

The program also measures how often false peaks are found.

The series are simulated at 100 Hz: white noise, and fractional noise of several strengths in white noise. For
white noise, two tests are made. The test `live` uses the spectrum in constant memory, as `identify` and the
live fit do. The test `whole` uses the periodogram of the whole record. Two other parts of `make validate`
count other things: `gallery` counts wrong verdicts, and `evaluate` counts intervals that contain the true
value.
"""

import zlib
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
from fltea.identification.sums import octaves_of
from fltea.records.arrays import Array
from fltea.spectrum.last_refit import null_ratio
from fltea.spectrum.likelihood_ratio import p_value
from fltea.spectrum.periodogram import periodogram
from fltea.spectrum.spectral_lines import find_peaks

from tools.validation.recursions import FractionalState
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table, grouped, share_within

SEEDS, QUICK_SEEDS = 400, 20
"""Number of series of each white noise in a full and in a quick run.

For each noise with an order, the number of series of 10 min is a tenth of this number.
"""
H = 0.01
LENGTHS = {"30 s": 3_000, "200 s": 20_000, "10 min": 60_000}
OF_POWER = ("30 s", "10 min")
"""Lengths of the records of noise with a fractional order."""
WHITE: dict[str, Callable[[int, np.random.Generator], Array]] = {
    "Gaussian": lambda n, rng: rng.standard_normal(n),
    "one LSB per σ": lambda n, rng: np.rint(rng.standard_normal(n)),
    "t4 tails": lambda n, rng: rng.standard_t(4, n),
}
STRENGTHS: dict[str, tuple[float, float, float]] = {
    f"α {alpha}, f {f}, {share:.0%} of the power": (alpha, f, share)
    for alpha, f in ((0.1, 0.0), (0.3, 0.0), (0.3, -1.8), (0.6, -0.3), (0.6, -3.0))
    for share in (0.1, 0.3, 1.0)
}
"""Fractional noise in white noise: α, f [s^-α], and the proportion of the power that the fractional noise
has.
"""


def tasks(options: Options) -> list[Task]:
    """Return one task for each noise and record length."""
    of_white = [(name, length, options.seeds) for name in WHITE for length in LENGTHS]
    coloured = [
        (name, length, max(options.seeds // divide, 2))
        for name in STRENGTHS
        for length, divide in zip(OF_POWER, (1, 10), strict=True)
    ]
    return [
        Task(one[0], count, one, LENGTHS[one[1]]) for one in (*of_white, *coloured) if options.wanted(one[0])
    ]


def count(name: str, length: str, series: int) -> list[Row]:
    """Count how often the null test rejects at the 5 % and the 1 % level.

    Also count in how many series of white noise a line or resonance is found.
    """
    rng = np.random.default_rng((20260601, zlib.crc32(f"{name}, {length}".encode())))
    samples, white = LENGTHS[length], name in WHITE
    if not white:
        alpha, f, share = STRENGTHS[name]
        state = FractionalState(alpha, H**alpha * f, samples)
    counts = {spectrum: Counter[str]() for spectrum in (("live", "whole") if white else ("live",))}
    peaks = 0
    for _ in range(series):
        y = WHITE[name](samples, rng) if white else _in_white(state, share, samples, rng)
        whole = periodogram(y, H)
        for spectrum, lines in zip(counts, (octaves_of(y).periodogram(0, H), whole), strict=False):
            p = p_value(null_ratio(lines), lines.ordinates)
            counts[spectrum].update({"at 5 %": p < 0.05, "at 1 %": p < 0.01})
        peaks += white and bool(find_peaks(whole))
    record = {"noise": name, "length": length, "series": series, "peaks": peaks}
    return [record | {"spectrum": spectrum, **found} for spectrum, found in counts.items()]


def _in_white(state: FractionalState, share: float, n: int, rng: np.random.Generator) -> Array:
    x = state.draw(rng)
    return np.asarray(np.sqrt(share) * x / x.std() + np.sqrt(1 - share) * rng.standard_normal(n))


def tables(rows: list[Row]) -> list[Table | str]:
    """Return a table of false alarms on white noise, and a table of the test's power.

    The power is the proportion of series with an order for which the test rejects white noise.
    """
    white = [row for row in rows if row["noise"] in WHITE]
    coloured = grouped((row for row in rows if row["noise"] in STRENGTHS), lambda row: row["noise"])
    found: list[Table | str] = []
    if white:
        columns = ("at 5 %", "at 1 %", "peaks")
        cells: list[Any] = [
            (
                *(row[name] for name in ("noise", "length", "spectrum")),
                *(share_within(row[name], row["series"]) for name in columns),
            )
            for row in white
        ]
        found.append(Table("False alarms on white noise", ("noise", "record", "spectrum", *columns), cells))
    if coloured:
        cells = [
            (str(name), *(share_within(row["at 5 %"], row["series"]) for row in both))
            for name, both in coloured.items()
        ]
        found.append(Table("Power at 5 %", ("noise", *OF_POWER), cells))
    return found
