"""Draw a chart as SVG, with scales, curves, bands and legend, for notebooks, reports and the live page.

The chart has the colour of the text around it, light or dark. A curve has some hundred points at most, even
for a long record.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from itertools import groupby, pairwise
from typing import NamedTuple

from fltea.documents.chart_legend import LEGEND_LINE, Entry, legend
from fltea.documents.chart_scales import Axis, Scale, scale
from fltea.documents.chart_style import STYLES, Style, line
from fltea.records.arrays import Array

WIDTH, HEIGHT = 420, 260
SMALL = 130
"""Height of a small chart, which stands next to others and shows no values at the pointer [px]."""
LEFT, RIGHT, TOP, BOTTOM = 64, 10, 24, 40
MOST_POINTS = 200
"""A curve with at most this many points is drawn with all its points."""
COLUMN_PX = 3
"""Width of a column of a chart [px]. Of a curve with more than `MOST_POINTS` points, only the lowest and the
highest point in each column are drawn.
"""
MOST_TIPS = 80

Point = tuple[float, float]
Numbers = Sequence[float] | Array


class Curve(NamedTuple):
    """The points of a curve in one of `STYLES`, and the ends `low` and `high` of the band around it.

    The curve is interrupted where a number is missing or cannot be shown on the scales. If there are no y
    values, only the band is drawn. `name`: text at the middle of the curve. `label`: entry in the legend;
    empty for none.
    """

    x: Numbers
    y: Numbers
    style: str
    low: Numbers = ()
    high: Numbers = ()
    name: str = ""
    label: str = ""


class Bands(NamedTuple):
    """Ranges of the x axis in which the chart is grey over its whole height. `label`: entry in the legend."""

    ends: Sequence[tuple[float, float]]
    label: str = ""


NO_BANDS = Bands(())


def log_log(
    title: str,
    x_label: str,
    y_label: str,
    curves: Sequence[Curve],
    bands: Sequence[tuple[float, float]] = (),
    crosses: tuple[Sequence[float], Sequence[float]] = ((), ()),
    height: int = HEIGHT,
) -> str:
    """Return a chart with two logarithmic axes; an empty text if no value has a logarithm."""
    x, y = Axis(x_label, is_log=True), Axis(y_label, is_log=True)
    return chart(title, x, y, curves, Bands(bands), crosses, height)


def chart(
    title: str,
    x_axis: Axis,
    y_axis: Axis,
    curves: Sequence[Curve],
    bands: Bands = NO_BANDS,
    crosses: tuple[Sequence[float], Sequence[float]] = ((), ()),
    height: int = HEIGHT,
) -> str:
    """Return the chart, or an empty text if no value can be shown.

    When the pointer rests on the first curve, the values at that point are shown.

    `height`: height of the chart without its legend [px].
    """
    x = scale(x_axis, (v for c in curves for v in c.x), LEFT, WIDTH - RIGHT)
    y = scale(y_axis, (v for c in curves for v in c.y), height - BOTTOM, TOP)
    if x is None or y is None:
        return ""
    parts = [*_frame(title, x_axis, y_axis, x, y), *_bands(bands, x, y)]
    drawn = [(curve, STYLES[curve.style], _runs(x, y, curve.x, curve.y)) for curve in curves]
    for curve, style, _ in drawn:
        parts += _between(curve, style, x, y)
    for curve, style, runs in drawn:
        parts += _line(curve, style, runs, y)
    if height > SMALL:
        parts += _tips(curves[0], x, y)
    for at, up in (point for run in _runs(x, y, *crosses) for point in run):
        parts.append(
            f'<path d="M{at - 3:.1f} {up - 3:.1f}l6 6m0 -6l-6 6" stroke="#2f7de1" stroke-width="1.2"/>'
        )
    entries = [
        Entry(curve.label, style if len(curve.y) else None, style.colour if len(curve.low) else "")
        for curve, style, _ in drawn
        if curve.label
    ]
    if bands.label and bands.ends:
        entries.append(Entry(bands.label, None, "currentColor"))
    lines, below = legend(entries, height)
    height += below * LEGEND_LINE
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}" '
        f'viewBox="0 0 {WIDTH} {height}" '
        f'role="img" aria-label="{escape(title)}" font-size="11" fill="currentColor">'
        f"{''.join([*parts, *lines])}</svg>"
    )


def _frame(title: str, x_axis: Axis, y_axis: Axis, x: Scale, y: Scale) -> Iterator[str]:
    """Yield the SVG of the frame, the grid, the numbers and the titles."""
    yield (
        f'<rect x="{LEFT}" y="{TOP}" width="{WIDTH - LEFT - RIGHT}" height="{y.begin - TOP:g}" '
        'fill="none" stroke="currentColor" stroke-opacity="0.4"/>'
    )
    for value, word in x.ticks():
        at = x(value)
        yield _grid(at, TOP, at, y.begin) + _text(at, y.begin + 14, word)
    for value, word in y.ticks():
        at = y(value)
        yield _grid(LEFT, at, WIDTH - RIGHT, at) + _text(LEFT - 5, at + 4, word, "end")
    middle = (LEFT + WIDTH - RIGHT) / 2
    yield _text(middle, 14, title) + _text(middle, y.begin + BOTTOM - 8, x_axis.label)
    half = f"{(y.begin + BOTTOM) / 2:.0f}"
    yield (
        f'<text x="12" y="{half}" transform="rotate(-90 12 {half})" '
        f'text-anchor="middle">{escape(y_axis.label)}</text>'
    )


def _bands(bands: Bands, x: Scale, y: Scale) -> Iterator[str]:
    for ends in bands.ends:
        begin, end = (min(max(x(v), LEFT), WIDTH - RIGHT) if x.has(v) else LEFT for v in ends)
        yield (
            f'<rect x="{begin:.1f}" y="{TOP}" width="{end - begin:.1f}" height="{y.begin - TOP:g}" '
            'fill="currentColor" fill-opacity="0.2"/>'
        )


def _between(curve: Curve, style: Style, x: Scale, y: Scale) -> Iterator[str]:
    """Yield the SVG of the band around a curve, cut off at the frame."""
    known = [
        row
        for row in zip(curve.x, curve.low, curve.high, strict=False)
        if x.has(row[0]) and y.has(row[1]) and y.has(row[2])
    ]
    there = _thinned([(x(a), min(max(y(high), TOP), y.begin)) for a, _, high in known])
    back = _thinned([(x(a), min(max(y(low), TOP), y.begin)) for a, low, _ in known])
    if known:
        points = _points([*there, *back[::-1]])
        yield f'<polygon points="{points}" fill="{style.colour}" fill-opacity="{style.band_opacity:g}"/>'


def _line(curve: Curve, style: Style, runs: list[list[Point]], y: Scale) -> Iterator[str]:
    """Yield the SVG of the curve or its points, as far as they are inside the chart, and its name."""
    if style.is_points:
        dots = [point for run in runs for point in _thinned(run) if TOP <= point[1] <= y.begin]
        if dots:
            yield f'<path d="{"".join(f"M{a:.1f} {b:.1f}h0" for a, b in dots)}" fill="none" {line(style)}/>'
        return
    inside = [part for run in runs for part in _cut(_thinned(run), y.begin)]
    for part in inside:
        yield f'<polyline points="{_points(part)}" fill="none" {line(style)}/>'
    if curve.name and inside:
        longest = max(inside, key=len)
        at, up = longest[len(longest) // 2]
        yield _text(at, up - 4, curve.name)


def _runs(x: Scale, y: Scale, xs: Numbers, ys: Numbers) -> list[list[Point]]:
    """Return the points in pixels, divided into runs in which both coordinates are known."""
    pairs = zip(xs, ys, strict=False)
    grouped = groupby(pairs, key=lambda pair: x.has(pair[0]) and y.has(pair[1]))
    return [[(x(a), y(b)) for a, b in run] for is_known, run in grouped if is_known]


def _thinned(points: list[Point]) -> list[Point]:
    """Thin out a long curve: keep the lowest and the highest point of each column, in their order."""
    if len(points) <= MOST_POINTS:
        return points
    kept: list[Point] = [points[0]]
    for _, column in groupby(points, key=lambda point: int(point[0] / COLUMN_PX)):
        these = list(column)
        ends = {these.index(end(these, key=lambda point: point[1])) for end in (min, max)}
        kept += [these[i] for i in sorted(ends)]
    return [*kept, points[-1]]


def _cut(points: list[Point], bottom: float) -> list[list[Point]]:
    """Return the parts of a curve between the bottom and the top of the chart."""
    found: list[list[Point]] = []
    joins = False
    for (xa, ya), (xb, yb) in pairwise(points * 2 if len(points) == 1 else points):
        if ya == yb:
            begin, end = (0.0, 1.0) if TOP <= ya <= bottom else (1.0, 0.0)
        else:
            first, last = sorted((edge - ya) / (yb - ya) for edge in (TOP, bottom))
            begin, end = max(first, 0.0), min(last, 1.0)
        if begin >= end:
            joins = False
            continue
        if not (joins and begin == 0):
            found.append([(xa + begin * (xb - xa), ya + begin * (yb - ya))])
        found[-1].append((xa + end * (xb - xa), ya + end * (yb - ya)))
        joins = True
    return found


def _tips(curve: Curve, x: Scale, y: Scale) -> Iterator[str]:
    """Yield the SVG of invisible points that show their values when the pointer rests on them."""
    rows = list(zip(curve.x, curve.y, strict=False))
    for i in range(0, len(rows), max(1, math.ceil(len(rows) / MOST_TIPS))):
        a, b = rows[i]
        if not (x.has(a) and y.has(b) and TOP <= y(b) <= y.begin):
            continue
        ends = ""
        if i < min(len(curve.low), len(curve.high)):
            ends = f" ({curve.low[i]:.3g} to {curve.high[i]:.3g})"
        yield (
            f'<circle cx="{x(a):.1f}" cy="{y(b):.1f}" r="5" fill="none" pointer-events="all">'
            f"<title>{a:.3g}: {b:.3g}{ends}</title></circle>"
        )


def _points(points: Iterable[Point]) -> str:
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in points)


def _grid(x1: float, y1: float, x2: float, y2: float) -> str:
    ends = f'x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"'
    return f'<line {ends} stroke="currentColor" stroke-opacity="0.15"/>'


def _text(x: float, y: float, text: str, anchor: str = "middle") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'
