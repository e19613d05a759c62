"""Draw the legend of a chart in rows below it, where it hides nothing."""

import textwrap
from collections.abc import Sequence
from html import escape
from typing import NamedTuple

from fltea.documents.chart_style import Style, line

LEGEND_LINE = 15
"""Height of a row of the legend [px]."""
BEGIN, END = 12, 412
"""Left and right end of a row of the legend [px]."""
SAMPLE, SPACE = 22, 6
"""Width of the short piece of a curve before its label, and of the space after that piece [px]."""
LETTER = 5.6
"""Average width of a letter in the chart's text size [px]."""
BETWEEN = 14


class Entry(NamedTuple):
    """An entry of the legend.

    `style`: style of the curve, if there is one. `band`: colour of its band, or "".
    """

    label: str
    style: Style | None
    band: str


def legend(entries: Sequence[Entry], top: float) -> tuple[list[str], int]:
    """Return the SVG of the legend below `top` (pixels), and its number of rows; long labels are wrapped."""
    found: list[str] = []
    left, row = float(BEGIN), 0
    for entry in entries:
        words = textwrap.wrap(entry.label, int((END - BEGIN - SAMPLE - SPACE) / LETTER))
        width = SAMPLE + SPACE + LETTER * max(map(len, words))
        if left > BEGIN and left + width > END:
            left, row = BEGIN, row + 1
        middle = top + (row + 0.5) * LEGEND_LINE
        found += _sample(entry, left, middle)
        for number, text in enumerate(words):
            at = middle + 4 + number * LEGEND_LINE
            found.append(f'<text x="{left + SAMPLE + SPACE:.1f}" y="{at:.1f}">{escape(text)}</text>')
        if len(words) > 1:
            left, row = BEGIN, row + len(words)
        else:
            left += width + BETWEEN
    return found, row + (left > BEGIN)


def _sample(entry: Entry, left: float, middle: float) -> list[str]:
    found = []
    if entry.band:
        found.append(
            f'<rect x="{left:.1f}" y="{middle - 5:.1f}" width="{SAMPLE}" height="10" '
            f'fill="{entry.band}" fill-opacity="0.25"/>'
        )
    if entry.style is not None and entry.style.is_points:
        found.append(f'<path d="M{left + SAMPLE / 2:.1f} {middle:.1f}h0" fill="none" {line(entry.style)}/>')
    elif entry.style is not None:
        found.append(
            f'<line x1="{left:.1f}" y1="{middle:.1f}" x2="{left + SAMPLE:.1f}" y2="{middle:.1f}" '
            f"{line(entry.style)}/>"
        )
    return found
