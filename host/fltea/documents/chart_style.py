"""Styles of the curves in charts; each colour is visible on white and on black."""

from typing import NamedTuple


class Style(NamedTuple):
    """Style of a curve or of single points, and of the band around it; widths and dashes are in pixels."""

    colour: str
    width: float
    dash: str = ""
    opacity: float = 1.0
    band_opacity: float = 0.15
    is_points: bool = False


STYLES = {
    "data": Style("currentColor", 1.2, opacity=0.7),
    "points": Style("currentColor", 3.0, opacity=0.7, is_points=True),
    "model": Style("#d95f02", 2.0),
    "rival": Style("#2f7de1", 1.6, "6 2"),
    "white": Style("#2f9e44", 1.5, "2 2"),
    "own": Style("#a05fd0", 1.6, band_opacity=0.3),
    "mark": Style("#a05fd0", 1.3, "5 4"),
    "step": Style("#d95f02", 1.2, "1 3"),
    "grey": Style("currentColor", 1.0, opacity=0.5, band_opacity=0.2),
    "bar": Style("currentColor", 1.5),
    "limit": Style("currentColor", 1.0, "2 3"),
}


def line(style: Style) -> str:
    """Return the SVG attributes of a curve."""
    found = f'stroke="{style.colour}" stroke-width="{style.width:g}"'
    if style.opacity < 1:
        found += f' stroke-opacity="{style.opacity:g}"'
    if style.dash:
        found += f' stroke-dasharray="{style.dash}"'
    return found + (' stroke-linecap="round"' if style.is_points else "")
