"""Spectrum, Allan deviation and the like as SVG, for notebooks, reports and the live page (pure)."""

import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import NamedTuple

from fltea.records.fit import FitAllan, FitSpectrum
from fltea.records.units import FLICKER

WIDTH, HEIGHT = 420, 260
SMALL = (480, 150)
LEFT, RIGHT, TOP, BOTTOM = 64, 10, 24, 40
MOST_TICKS, FEW_DECADES = 8, 2.2
STYLES = {
    "data": 'stroke="currentColor" stroke-opacity="0.7" stroke-width="1.2"',
    "model": 'stroke="#d95f02" stroke-width="2"',
    "mark": 'stroke="#a05fd0" stroke-width="1.3" stroke-dasharray="5 4"',
}


class Curve(NamedTuple):
    """The points of a line in one of `STYLES`, and the ends low and high of the band around it.

    name: stands at the middle of the line.
    """

    x: Sequence[float]
    y: Sequence[float]
    style: str
    low: Sequence[float] = ()
    high: Sequence[float] = ()
    name: str = ""


def spectrum(
    s: FitSpectrum,
    unit: str,
    left_out: Sequence[tuple[float, float]] = (),
    board: tuple[Sequence[float], Sequence[float]] = ((), ()),
    size: tuple[int, int] = (WIDTH, HEIGHT),
) -> str:
    """Return noise density and fitted model; bands that were left out are grey. board: its own bins."""
    title = "Spectrum (orange: fitted" + (", grey: left out" if left_out else "")
    title += ", crosses: the board's bins)" if board[0] else ")"
    curves = [Curve(s.hz, s.density, "data"), Curve(s.hz, s.model, "model")]
    return log_log(title, "frequency [Hz]", f"density [{unit}/√Hz]", curves, left_out, board, size)


def allan(a: FitAllan, unit: str) -> str:
    """Return the Allan deviation with its intervals, that of the model, and the lines of N, B and K."""
    curves = [Curve(a.tau_s, a.adev, "data", a.low, a.high), Curve(a.tau_s, a.model, "model")]
    for name, value, slope, read_at in (
        ("N", a.N, -0.5, 1.0),
        ("B", None if a.B is None else FLICKER * a.B, 0.0, 1.0),
        ("K", a.K, 0.5, 3.0),
    ):
        if value is not None:
            line = [(tau, value * (tau / read_at) ** slope) for tau in a.tau_s]
            seen = [(tau, y) for tau, y in line if min(a.adev) / 2 <= y <= max(a.adev) * 2]
            if len(seen) > 1:
                curves.append(Curve([tau for tau, _ in seen], [y for _, y in seen], "mark", name=name))
    title = "Allan deviation, 95 % (orange: fitted)"
    return log_log(title, "averaging time τ [s]", f"deviation [{unit}]", curves)


class _Scale(NamedTuple):
    """A logarithmic scale between two ends, in pixels."""

    low: float
    high: float
    begin: float
    end: float

    def __call__(self, value: float) -> float:
        share = (math.log10(value) - self.low) / (self.high - self.low)
        return self.begin + share * (self.end - self.begin)

    def ticks(self) -> list[float]:
        """Decades, and some steps between them where few decades fit in."""
        span = self.high - self.low
        steps = (1, 2, 3, 5, 7) if span < 1 else (1, 2, 5) if span < FEW_DECADES else (1,)
        powers = range(math.floor(self.low), math.ceil(self.high) + 1)
        found = [float(f"{step}e{power}") for power in powers for step in steps]
        shown = [value for value in found if self.low <= math.log10(value) <= self.high]
        return shown[:: max(1, math.ceil(len(shown) / MOST_TICKS))]


def log_log(
    title: str,
    x_label: str,
    y_label: str,
    curves: Sequence[Curve],
    bands: Sequence[tuple[float, float]] = (),
    crosses: tuple[Sequence[float], Sequence[float]] = ((), ()),
    size: tuple[int, int] = (WIDTH, HEIGHT),
) -> str:
    """Return the chart without values that have no logarithm, or nothing if no value has one.

    size: its width and height in pixels; one that is `SMALL` has no values under the pointer.
    """
    xs = _usable(v for c in curves for v in c.x)
    ys = _usable(v for c in curves for v in c.y)
    if not xs or not ys:
        return ""
    width, height = size
    x = _Scale(*_ends(xs), LEFT, width - RIGHT)
    y = _Scale(*_ends(ys), height - BOTTOM, TOP)
    parts = [f'<rect x="{LEFT}" y="{TOP}" width="{width - LEFT - RIGHT}" height="{height - TOP - BOTTOM}" '
             'fill="none" stroke="currentColor" stroke-opacity="0.4"/>']  # fmt: skip
    for value in x.ticks():
        at = x(value)
        parts.append(_line(at, TOP, at, height - BOTTOM) + _text(at, height - BOTTOM + 14, _number(value)))
    for value in y.ticks():
        at = y(value)
        parts.append(_line(LEFT, at, width - RIGHT, at) + _text(LEFT - 5, at + 4, _number(value), "end"))
    for low, high in bands:
        begin, end = (min(max(x(v), LEFT), width - RIGHT) if v > 0 else LEFT for v in (low, high))
        parts.append(
            f'<rect x="{begin:.1f}" y="{TOP}" width="{end - begin:.1f}" height="{height - TOP - BOTTOM}" '
            'fill="currentColor" fill-opacity="0.2"/>'
        )
    for curve in curves:
        if curve.low:
            there = _path(x, y, curve.x, curve.high)
            back = _path(x, y, [*curve.x][::-1], [*curve.low][::-1])
            points = " ".join(there + back)
            parts.append(f'<polygon points="{points}" fill="currentColor" fill-opacity="0.15"/>')
        path = _path(x, y, curve.x, curve.y)
        parts.append(f'<polyline points="{" ".join(path)}" fill="none" {STYLES[curve.style]}/>')
        if curve.name and path:
            at, up = map(float, path[len(path) // 2].split(","))
            parts.append(_text(at, up - 4, curve.name))
    if size != SMALL:
        parts += _tips(curves[0], x, y)
    for point in _path(x, y, *crosses):
        at, up = map(float, point.split(","))
        parts.append(
            f'<path d="M{at - 3:.1f} {up - 3:.1f}l6 6m0 -6l-6 6" stroke="#2f7de1" stroke-width="1.2"/>'
        )
    middle = (LEFT + width - RIGHT) / 2
    parts.append(_text(middle, 14, title) + _text(middle, height - 8, x_label))
    parts.append(
        f'<text x="12" y="{height / 2:.0f}" transform="rotate(-90 12 {height / 2:.0f})" '
        f'text-anchor="middle">{escape(y_label)}</text>'
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" '
        f'role="img" aria-label="{escape(title)}" font-size="11" fill="currentColor">{"".join(parts)}</svg>'
    )


def _tips(curve: Curve, x: _Scale, y: _Scale) -> list[str]:
    """Points that nobody sees, with what a pointer that rests on them says."""
    tips = []
    for i, (a, b) in enumerate(zip(curve.x, curve.y, strict=False)):
        for point in _path(x, y, [a], [b]):
            at, height = point.split(",")
            ends = (
                f" ({curve.low[i]:.3g} to {curve.high[i]:.3g})"
                if i < min(len(curve.low), len(curve.high))
                else ""
            )
            tips.append(
                f'<circle cx="{at}" cy="{height}" r="5" fill="none" pointer-events="all">'
                f"<title>{a:.3g}: {b:.3g}{ends}</title></circle>"
            )
    return tips


def _usable(values: Iterable[float]) -> list[float]:
    return [v for v in values if math.isfinite(v) and v > 0]


def _ends(values: Sequence[float]) -> tuple[float, float]:
    """Return logarithms of the ends, with some room, also of one value."""
    low, high = math.log10(min(values)), math.log10(max(values))
    room = max(0.05 * (high - low), 0.1)
    return low - room, high + room


def _path(x: _Scale, y: _Scale, xs: Sequence[float], ys: Sequence[float]) -> list[str]:
    """Points that have a logarithm, as far as there are both numbers; none leaves the chart."""
    bottom, top = 10**y.low, 10**y.high
    return [
        f"{x(a):.1f},{y(min(max(b, bottom), top)):.1f}"
        for a, b in zip(xs, ys, strict=False)
        if math.isfinite(a) and a > 0 and math.isfinite(b) and b > 0
    ]


def _line(x1: float, y1: float, x2: float, y2: float) -> str:
    ends = f'x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"'
    return f'<line {ends} stroke="currentColor" stroke-opacity="0.15"/>'


def _text(x: float, y: float, text: str, anchor: str = "middle") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'


def _number(value: float) -> str:
    return f"{value:g}" if 1e-3 <= value <= 1e3 else f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e")
