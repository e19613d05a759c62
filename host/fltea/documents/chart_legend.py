"""What the lines and bands of a chart are, in rows below it, where they hide nothing (pure)."""

import textwrap
from collections.abc import Sequence
from html import escape
from typing import NamedTuple

from fltea.documents.chart_style import Style, line

LEGEND_LINE = 15
"""Height of a row in pixels."""
BEGIN, END = 12, 412
"""Ends of a row in pixels."""
SAMPLE, SPACE = 22, 6
"""Width of the sample of a line, and the space behind it."""
LETTER = 5.6
"""Width of a letter on average, in pixels at the chart's size of text."""
BETWEEN = 14


class Entry(NamedTuple):
    """What a line or a band is. style: of the line, if it has one. band: its colour, if there is one."""

    label: str
    style: Style | None
    band: str


def legend(entries: Sequence[Entry], top: float) -> tuple[list[str], int]:
    """Return the SVG below `top` (pixels) and how many rows it has; long labels are broken."""
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
