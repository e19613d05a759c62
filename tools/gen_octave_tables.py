"""Works out the tables of the device's spectrum: writes firmware/core/engine/octave_tables.hpp."""

import math
from pathlib import Path

from generated import engine_header, rows

SOURCE, HEADER = "tools/gen_octave_tables.py", "firmware/core/engine/octave_tables.hpp"
BLOCK = 256
"""Samples of a block (firmware/core/engine/block_fft.hpp)."""
LOWEST, LINES = 45, 45
"""Lines of a level that are used (firmware/core/engine/welch_level.hpp, octave_ladder.hpp)."""
MIDDLE = 0.49998341447554523
TAPS = (
    *(-4.962987862434643e-05, 0.0006422540255711147, -0.002734441417494108, 0.00802032401027231),
    *(-0.019227637930233975, 0.0415367046593286, -0.09122480814029417, 0.3130455274337019),
)
"""Of the half-band filter (firmware/core/engine/half_band.hpp), of the distances 15, 13, ..., 1."""

ABOUT = f"""\
// Cosines, sines and Hann's window for a block of {BLOCK} in integers (block_fft.hpp), and what the filters
// before a level leave of the power of its lines.
"""
TEMPLATE = """\
// In 2^-30, of the i-th {block}th part of a turn. In a template, so that the header may be included more than
// once.
template <class Unused = void>
struct CosineTable {{
    static constexpr std::int32_t one = INT32_C(1) << 30;
    static const std::int32_t half_turn[{size}];

    // 0 <= i < {half}.
    static std::int32_t cosine(int i) {{ return half_turn[i]; }}
    static std::int32_t sine(int i) {{ return half_turn[i < {quarter} ? {quarter} - i : i - {quarter}]; }}
    // Of the window, at even and odd places.
    static std::int32_t even(int i) {{ return window(2 * i); }}
    static std::int32_t odd(int i) {{ return window(2 * i + 1); }}

  private:
    static std::int32_t window(int i) {{ return one / 2 - half_turn[i < {half} ? i : {block} - i] / 2; }}
}};

// Over the power gain of the filters before a level, of its line lowest + i: of level 1, of level 2, and of
// all deeper ones, among which it differs by less than 2e-4.
template <class Unused = void>
struct OctaveGains {{
    static constexpr int lines = {lines};
    static const float over[3][lines];
}};

// clang-format off
template <class Unused>
const std::int32_t CosineTable<Unused>::half_turn[] = {{
{rows}
}};
template <class Unused>
const float OctaveGains<Unused>::over[3][OctaveGains<Unused>::lines] = {{
{gains}
}};
// clang-format on
"""


def over_gain(line: int, level: int) -> float:
    """Over the power gain of the filters before a level, of one of its lines."""
    gain = 1.0
    for passed in range(1, level + 1):
        angle = 2 * math.pi * line / BLOCK / 2**passed
        gain *= MIDDLE + sum(2 * c * math.cos((15 - 2 * k) * angle) for k, c in enumerate(TAPS))
    return gain**-2


def outputs(root: Path) -> dict[str, str]:
    """Return the header."""
    half = BLOCK // 2
    cosines = [f"{round(math.cos(2 * math.pi * i / BLOCK) * 2**30)}" for i in range(half + 1)]
    levels = []
    for level in (1, 2, 12):
        over = [f"{over_gain(LOWEST + i, level):.9f}f" for i in range(LINES)]
        levels.append("    {\n" + rows(over, 7, 8 * " ") + "\n    },")
    body = TEMPLATE.format(
        block=BLOCK,
        half=half,
        quarter=half // 2,
        size=half + 1,
        rows=rows(cosines, 6),
        lines=LINES,
        gains="\n".join(levels),
    )
    return {HEADER: engine_header(HEADER, SOURCE, body, ABOUT, ("cstdint",))}
