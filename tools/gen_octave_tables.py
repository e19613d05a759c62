"""Computes the tables of the board's spectrum, and writes firmware/core/engine/octave_tables.hpp."""

import math
from pathlib import Path

from tools.generated import rendered

SOURCE, HEADER = "tools/gen_octave_tables.py", "firmware/core/engine/octave_tables.hpp"
BLOCK = 256
"""Number of samples in a block (firmware/core/engine/block_fft.hpp)."""
LOWEST, LINES = 45, 45
"""LOWEST: the first FFT bin that is used in each level of the spectrum. LINES: the number of bins that are
used.

Each level has half the sampling rate of the level before (engine/octave_ladder.hpp, engine/welch_level.hpp).
"""
MIDDLE = 0.49998341447554523
TAPS = (
    *(-4.962987862434643e-05, 0.0006422540255711147, -0.002734441417494108, 0.00802032401027231),
    *(-0.019227637930233975, 0.0415367046593286, -0.09122480814029417, 0.3130455274337019),
)
"""Coefficients of the half-band filter (firmware/core/engine/half_band.hpp) at the distances 15, 13, ..., 1
from its centre.
"""


def over_gain(line: int, level: int) -> float:
    """Return 1 divided by the power gain of the half-band filters that the samples pass before `level`.

    Each level of the spectrum has half the sampling rate of the level before, after one such filter. The gain
    is that at the frequency of FFT bin `line` of this level.
    """
    gain = 1.0
    for passed in range(1, level + 1):
        angle = 2 * math.pi * line / BLOCK / 2**passed
        gain *= MIDDLE + sum(2 * c * math.cos((15 - 2 * k) * angle) for k, c in enumerate(TAPS))
    return gain**-2


def outputs(root: Path) -> dict[str, str]:
    """Return the path and the text of the header file."""
    half = BLOCK // 2
    text = rendered(
        "octave_tables.hpp",
        block=BLOCK,
        half=half,
        cosines=[round(math.cos(2 * math.pi * i / BLOCK) * 2**30) for i in range(half + 1)],
        lines=LINES,
        gains=[[f"{over_gain(LOWEST + i, level):.9f}f" for i in range(LINES)] for level in (1, 2, 12)],
    )
    return {HEADER: text}
