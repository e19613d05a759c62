"""The gallery as PNG: a grid of its cells, and every noise's spectrum with truth and verdict.

Rendered by Agg; nothing here opens a window.
"""

import io
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tools.validation.gallery.noises import NOISES
from tools.validation.gallery.run import QUICK, Cell, Gallery, Seen, draw
from tools.validation.gallery.table import duration

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

COLOURS = {"right": "#4c9f70", "cannot be told": "#e9c46a", "wrong": "#d1495b"}
MARKS = {"right": "", "cannot be told": "?", "wrong": "✗"}
"""For those who do not see the colours."""
GREY = "#eeeeee"
DOTS_PER_INCH = 80
PALETTE = 64
ACROSS = 6
"""Small pictures in a row."""
BINS = 60


def grid(gallery: Gallery) -> bytes:
    """A row a noise, a column a rate and length; a cell is split as its records are."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch, Rectangle

    names = list(dict.fromkeys(one.cell.noise for one in gallery.seen))
    columns = list(dict.fromkeys((one.cell.rate_hz, one.cell.duration_s) for one in gallery.seen))
    figure = Figure(figsize=(3.4 + 0.62 * len(columns), 1.4 + 0.19 * len(names)), dpi=DOTS_PER_INCH)
    figure.set_layout_engine("constrained")
    axes = figure.subplots()
    axes.set_facecolor(GREY)
    for line, name in enumerate(names):
        for column, (rate, length) in enumerate(columns):
            found: list[str] = [
                one.outcome
                for one in gallery.seen
                if (one.cell.noise, one.cell.rate_hz, one.cell.duration_s) == (name, rate, length)
            ]
            left = column - 0.5
            for outcome, colour in COLOURS.items():
                width = found.count(outcome) / max(len(found), 1)
                axes.add_patch(Rectangle((left, line - 0.46), 0.96 * width, 0.92, color=colour, lw=0))
                if width:
                    middle = left + 0.48 * width
                    axes.text(middle, line, MARKS[outcome], ha="center", va="center", fontsize=6)
                left += 0.96 * width
    axes.set_xlim(-0.55, len(columns) - 0.45)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_yticks(range(len(names)), names, fontsize=7)
    heads = [f"{rate:g} Hz\n{duration(length)}" for rate, length in columns]
    axes.xaxis.tick_top()
    axes.set_xticks(range(len(columns)), heads, fontsize=7)
    axes.tick_params(length=0)
    handles = [Patch(color=colour, label=outcome) for outcome, colour in COLOURS.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return _png(figure)


def spectra(gallery: Gallery) -> bytes:
    """A small picture of each noise: its periodogram in bins, the true density, and what was said of it."""
    from matplotlib.figure import Figure

    shown = _shown(gallery)
    rows = -(-len(shown) // ACROSS)
    figure = Figure(figsize=(2.15 * ACROSS, 1.6 * rows), dpi=DOTS_PER_INCH)
    figure.set_layout_engine("constrained")
    panels = figure.subplots(rows, ACROSS, squeeze=False).ravel().tolist()
    for panel, one in zip(panels, shown, strict=False):
        _spectrum(panel, one)
    for panel in panels[len(shown) :]:
        panel.set_visible(False)
    return _png(figure)


def _shown(gallery: Gallery) -> list[Seen]:
    """Of each noise the first record at the quick rate and length, or else the first of all."""
    firsts: dict[str, Seen] = {}
    for one in gallery.seen:
        known = firsts.get(one.cell.noise)
        if known is None or (_quick(one.cell) and not _quick(known.cell)):
            firsts[one.cell.noise] = one
    return list(firsts.values())


def _quick(cell: Cell) -> bool:
    return (cell.rate_hz, cell.duration_s) == QUICK


def _spectrum(axes: "Axes", one: Seen) -> None:
    from matplotlib.ticker import NullFormatter

    y = draw(one.cell)
    n, rate = len(y), one.cell.rate_hz
    window = np.hanning(n)
    power = np.abs(np.fft.rfft((y - y.mean()) * window)) ** 2 / (window**2).sum()
    edges = np.unique(np.geomspace(2, n // 2, BINS).astype(int))
    counts = np.diff(edges)
    hz = np.add.reduceat(np.arange(n // 2 + 1.0), edges)[:-1] / counts * rate / n
    axes.loglog(hz, np.add.reduceat(power, edges)[:-1] / counts, color="#777777", lw=1.0)
    noise = NOISES[one.cell.noise]
    if noise.treatment is None:
        axes.loglog(hz, np.maximum(noise.spectrum(2 * np.pi * hz / rate, rate), 1e-4), "k--", lw=0.8)
    axes.set_title(one.cell.noise, fontsize=8, pad=2)
    axes.yaxis.set_minor_formatter(NullFormatter())
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, high / 300), high)
    axes.text(
        0.03,
        0.04,
        one.kind,
        transform=axes.transAxes,
        fontsize=7,
        bbox={"facecolor": COLOURS[one.outcome], "alpha": 0.75, "lw": 0, "pad": 1.5},
    )
    axes.tick_params(labelsize=6, pad=1)


def draw_all(gallery: Gallery) -> dict[str, bytes]:
    """PNGs by name."""
    return {"cells": grid(gallery), "spectra": spectra(gallery)}


def _png(figure: "Figure") -> bytes:
    """With a palette, which takes a quarter of the room."""
    from PIL import Image

    drawn, small = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", metadata={"Software": None})
    Image.open(drawn).convert("RGB").quantize(PALETTE).save(small, format="png", optimize=True)
    return small.getvalue()
