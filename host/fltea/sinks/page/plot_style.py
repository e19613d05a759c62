"""Colours and what all figures have in common; the page's script gives them their theme."""

from typing import Any

from bokeh.models import ColumnDataSource

SAMPLE, STATE, ESTIMATE, FIT, MARK = "#8796ab", "#e07b00", "#2f7de1", "#10996b", "#a05fd0"
"""Colours that stand out on a light ground and on a dark one."""

BAND = "#9aa5b1"
"""Grey of references and of what is left out."""

INKED = "of the device"
"""Name of lines to which the page's script gives its ink, which stands out from `ESTIMATE` on any ground."""

COMMON: dict[str, Any] = {
    "sizing_mode": "stretch_width",
    "toolbar_location": None,
    "tools": "",
    "background_fill_color": None,
    "border_fill_color": None,
    "outline_line_color": None,
    "output_backend": "canvas",
    "min_border_left": 64,
}


def source(*columns: str) -> ColumnDataSource:
    """Return a source whose columns are empty."""
    return ColumnDataSource({name: [] for name in columns})
