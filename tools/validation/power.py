"""How often the null test of `fltea identify` rejects, and how often it finds peaks that are not there.

Simulated series at 100 Hz of 3,000 samples (30 s) and 60,000 (10 min): white noise, and fractional noise of
several strengths in it. False claims and verdicts are the gallery's, intervals are counted by `evaluate`.
"""

import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
from fltea.identification.sums import lines_of, octaves_of
from fltea.spectrum.likelihood_ratio import null_fits, p_value
from fltea.spectrum.lines import find_peaks
from fltea.spectrum.periodogram import binned, periodogram
from numpy.typing import NDArray

from tools.validation.recursions import FractionalState
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table, grouped, share_within

Array = NDArray[np.float64]

SEEDS, QUICK_SEEDS = 400, 20
"""Series of each white noise; of 10 min a tenth for the power."""
H = 0.01
LENGTHS = {"30 s": 3_000, "10 min": 60_000}
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
"""Of fractional noise in white noise: α, f in s^-α, share of the power in the state."""


def tasks(options: Options) -> list[Task]:
    """Return a task for each noise and length."""
    return [
        Task(name, count, (name, length, max(options.seeds // divide, 2)), LENGTHS[length])
        for name in (*WHITE, *STRENGTHS)
        if options.wanted(name)
        for length, divide in (("30 s", 1), ("10 min", 1 if name in WHITE else 10))
    ]


def count(name: str, length: str, series: int) -> list[Row]:
    """Count rejections at 5 and 1 %, and series of white noise with a line or resonance."""
    rng = np.random.default_rng((20260601, zlib.crc32(f"{name}, {length}".encode())))
    samples, five, one, peaks = LENGTHS[length], 0, 0, 0
    state = None
    if name in STRENGTHS:
        alpha, f, _ = STRENGTHS[name]
        state = FractionalState(alpha, H**alpha * f, samples)
    for _ in range(series):
        y = WHITE[name](samples, rng) if state is None else _in_white(state, STRENGTHS[name][2], samples, rng)
        data = binned(lines_of(octaves_of(y), H))
        p = p_value(float(null_fits(data).likelihood_ratio[0]), data.ordinates)
        five, one = five + (p < 0.05), one + (p < 0.01)
        peaks += state is None and bool(find_peaks(periodogram(y, H)))
    return [
        {"noise": name, "length": length, "series": series, "at 5 %": five, "at 1 %": one, "peaks": peaks}
    ]


def _in_white(state: FractionalState, share: float, n: int, rng: np.random.Generator) -> Array:
    x = state.draw(rng)
    return np.asarray(np.sqrt(share) * x / x.std() + np.sqrt(1 - share) * rng.standard_normal(n))


def tables(rows: list[Row]) -> list[Table | str]:
    """Return false alarms and power."""
    white = [row for row in rows if row["noise"] in WHITE]
    coloured = grouped((row for row in rows if row["noise"] in STRENGTHS), lambda row: row["noise"])
    found: list[Table | str] = []
    if white:
        columns = ("at 5 %", "at 1 %", "peaks")
        cells: list[Any] = [
            (row["noise"], row["length"], *(share_within(row[name], row["series"]) for name in columns))
            for row in white
        ]
        found.append(Table("False alarms on white noise", ("noise", "record", *columns), cells))
    if coloured:
        cells = [
            (str(name), *(share_within(row["at 5 %"], row["series"]) for row in both))
            for name, both in coloured.items()
        ]
        found.append(Table("Power at 5 %", ("noise", *LENGTHS), cells))
    return found
