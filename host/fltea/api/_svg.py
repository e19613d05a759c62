"""A small chart with two logarithmic axes, as SVG: notebooks show it without any library."""

import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import NamedTuple

WIDTH, HEIGHT = 420, 260
LEFT, RIGHT, TOP, BOTTOM = 64, 10, 24, 40
MOST_TICKS = 8
STYLES = {
    "data": 'stroke="currentColor" stroke-opacity="0.7" stroke-width="1.2"',
    "model": 'stroke="#d95f02" stroke-width="2"',
}


class Curve(NamedTuple):
    """The points of a line in one of `STYLES`, and the ends low and high of the band around it."""

    x: Sequence[float]
    y: Sequence[float]
    style: str
    low: Sequence[float] = ()
    high: Sequence[float] = ()


class _Scale(NamedTuple):
    """A logarithmic scale between two ends, in pixels."""

    low: float
    high: float
    begin: float
    end: float

    def __call__(self, value: float) -> float:
        share = (math.log10(value) - self.low) / (self.high - self.low)
        return self.begin + share * (self.end - self.begin)

    def ticks(self) -> list[int]:
        decades = range(math.ceil(self.low), math.floor(self.high) + 1)
        return list(decades[:: max(1, math.ceil(len(decades) / MOST_TICKS))])


def log_log(title: str, x_label: str, y_label: str, curves: Sequence[Curve]) -> str:
    """Return the chart without values that have no logarithm, or nothing if no value has one."""
    xs = _usable(v for c in curves for v in c.x)
    ys = _usable(v for c in curves for v in c.y)
    if not xs or not ys:
        return ""
    x = _Scale(*_ends(xs), LEFT, WIDTH - RIGHT)
    y = _Scale(*_ends(ys), HEIGHT - BOTTOM, TOP)
    parts = [f'<rect x="{LEFT}" y="{TOP}" width="{WIDTH - LEFT - RIGHT}" height="{HEIGHT - TOP - BOTTOM}" '
             'fill="none" stroke="currentColor" stroke-opacity="0.4"/>']  # fmt: skip
    for power in x.ticks():
        at = x(10.0**power)
        parts.append(_line(at, TOP, at, HEIGHT - BOTTOM) + _text(at, HEIGHT - BOTTOM + 14, _power(power)))
    for power in y.ticks():
        at = y(10.0**power)
        parts.append(_line(LEFT, at, WIDTH - RIGHT, at) + _text(LEFT - 5, at + 4, _power(power), "end"))
    for curve in curves:
        if curve.low:
            there = _path(x, y, curve.x, curve.high)
            back = _path(x, y, [*curve.x][::-1], [*curve.low][::-1])
            points = " ".join(there + back)
            parts.append(f'<polygon points="{points}" fill="currentColor" fill-opacity="0.15"/>')
        points = " ".join(_path(x, y, curve.x, curve.y))
        parts.append(f'<polyline points="{points}" fill="none" {STYLES[curve.style]}/>')
    middle = (LEFT + WIDTH - RIGHT) / 2
    parts.append(_text(middle, 14, title) + _text(middle, HEIGHT - 8, x_label))
    parts.append(
        f'<text x="12" y="{HEIGHT / 2:.0f}" transform="rotate(-90 12 {HEIGHT / 2:.0f})" '
        f'text-anchor="middle">{escape(y_label)}</text>'
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" '
        f'viewBox="0 0 {WIDTH} {HEIGHT}" '
        f'role="img" aria-label="{escape(title)}" font-size="11" fill="currentColor">{"".join(parts)}</svg>'
    )


def _usable(values: Iterable[float]) -> list[float]:
    return [v for v in values if math.isfinite(v) and v > 0]


def _ends(values: Sequence[float]) -> tuple[float, float]:
    """Return logarithms of the ends, with some room, also of one value."""
    low, high = math.log10(min(values)), math.log10(max(values))
    room = max(0.05 * (high - low), 0.1)
    return low - room, high + room


def _path(x: _Scale, y: _Scale, xs: Sequence[float], ys: Sequence[float]) -> list[str]:
    bottom, top = 10**y.low, 10**y.high
    return [
        f"{x(a):.1f},{y(min(max(b, bottom), top)):.1f}"
        for a, b in zip(xs, ys, strict=True)
        if math.isfinite(a) and a > 0 and math.isfinite(b) and b > 0
    ]


def _line(x1: float, y1: float, x2: float, y2: float) -> str:
    ends = f'x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"'
    return f'<line {ends} stroke="currentColor" stroke-opacity="0.15"/>'


def _text(x: float, y: float, text: str, anchor: str = "middle") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'


def _power(power: int) -> str:
    return f"{10.0**power:g}" if -3 <= power <= 3 else f"1e{power}"
