"""Heat maps of an evaluation as PNG; rendered by Agg, nothing here opens a window."""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tools.validation.evaluate import fit_summaries
from tools.validation.evaluate.cases import Case
from tools.validation.evaluate.run import LIVE, WHITTLE, Result, Row
from tools.validation.pictures import new_figure, png

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

Array = NDArray[np.float64]

SHOWN = ("triple", "joint", "joint, tuned live", LIVE, WHITTLE)
LINES = {
    "triple": "C1o--",
    "joint": "C0s--",
    "joint, tuned live": "C9^-",
    LIVE: "C3D-",
    WHITTLE: "C7x:",
    "bound": "k-",
}
"""Of the picture of what the live fit is worth, and their styles."""
GREY = "#d9d9d9"


class Map(NamedTuple):
    """A figure: what is shown of a row, and in which colours."""

    title: str
    short: str
    quantity: str
    value: Callable[[Row], float | None]
    low: float
    high: float
    colours: str
    form: str


def _relative(row: Row) -> float | None:
    error = row.score.median_error
    return None if error is None else error / abs(row.case.f or 1.0)


MAPS = {
    "error": Map(
        "Root mean square error of α",
        "error of α",
        "alpha",
        lambda row: row.score.rmse,
        0.0,
        0.4,
        "viridis_r",
        ".2f",
    ),
    "bias": Map("Bias of α", "bias of α", "alpha", lambda row: row.score.bias, -0.4, 0.4, "RdBu", "+.2f"),
    "coverage": Map(
        "Share of the 95 % intervals that hold the true α",
        "share of intervals that hold α",
        "alpha",
        lambda row: row.score.coverage,
        0.0,
        1.0,
        "cividis",
        ".0%",
    ),
    "spread": Map(
        "Spread of α over the Cramér–Rao bound (below 1 only with a bias)",
        "spread of α over the bound",
        "alpha",
        lambda row: row.score.sd_over_bound,
        0.0,
        2.0,
        "PuOr",
        ".2g",
    ),
    "f": Map(
        "Median error of f, as a share of f", "error of f", "f", _relative, 0.0, 1.0, "viridis_r", ".0%"
    ),
}


def draw(result: Result) -> dict[str, bytes]:
    """PNGs by name: one of each of `MAPS`, the changed settings, and errors before and after the live fit."""
    maps = {name: _grid_map(result, one) for name, one in MAPS.items()}
    return maps | {"settings": _settings_map(result), "live": _live_lines(result)}


def _grid_map(result: Result, one: Map) -> bytes:
    cases = [case for case in result.plan.grid if case.alpha is not None]
    dynamics = list(dict.fromkeys((case.alpha, case.f) for case in cases))
    ratios = list(dict.fromkeys(case.step_ratio for case in cases))
    lengths = result.plan.lengths
    found = {(r.case, r.samples, r.estimator): r for r in result.rows if r.quantity == one.quantity}
    height = 1.4 + len(SHOWN) * (0.7 + 0.24 * len(dynamics))
    figure = new_figure(2.0 + 2.7 * len(lengths), height)
    seeds = f"{result.plan.seeds} seeds, the fits {result.plan.fit_seeds}"
    figure.suptitle(f"{one.title}\n{seeds}", fontsize=11, x=0.01, ha="left")
    panels = figure.subplots(len(SHOWN), len(lengths), sharex=True, sharey=True, squeeze=False)
    for line, estimator in zip(panels, SHOWN, strict=True):
        for axes, n in zip(line, lengths, strict=True):
            values = [
                [_shown(found[Case(*pair, ratio), n, estimator], one) for ratio in ratios]
                for pair in dynamics
            ]
            image = _paint(axes, np.array(values, dtype=np.float64), one)
            axes.set_title(f"{estimator}, {n:,} samples", fontsize=9)
            axes.set_xticks(range(len(ratios)), [f"{ratio:g}" for ratio in ratios], fontsize=8)
            axes.set_yticks(range(len(dynamics)), [f"{a:g}, {f:g}" for a, f in dynamics], fontsize=8)
    for axes in panels[-1]:
        axes.set_xlabel("s2/R", fontsize=9)
    for axes in panels[:, 0]:
        axes.set_ylabel("α, f", fontsize=9)
    figure.colorbar(image, ax=panels, shrink=0.3, extend="max" if one.form != ".0%" else "neither")
    return png(figure)


def _live_lines(result: Result) -> bytes:
    """The median error of α over the noises of each s2/R, a panel a length."""
    headings, rows = fit_summaries.errors(result)
    ratios = [float(heading) for heading in headings[2:]]
    found = {(row[0], row[1]): [np.nan if c == "–" else float(c) for c in row[2:]] for row in rows}
    figure = new_figure(2.6 + 2.7 * len(result.plan.lengths), 3.6)
    panels = figure.subplots(1, len(result.plan.lengths), sharey=True, squeeze=False)[0]
    for axes, n in zip(panels, result.plan.lengths, strict=True):
        for name, style in LINES.items():
            axes.loglog(ratios, found[name, f"{n:,}"], style, label=name, markersize=4, linewidth=1.4)
        axes.set_title(f"{n:,} samples", fontsize=9)
        axes.set_xticks(ratios, [f"{ratio:g}" for ratio in ratios], fontsize=8)
        axes.minorticks_off()
        axes.grid(alpha=0.3)
        axes.set_xlabel("s2/R", fontsize=9)
    ticks = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5]
    panels[0].set_yticks(ticks, [f"{tick:g}" for tick in ticks], fontsize=8)
    panels[0].set_ylabel("error of α (rms), median of the noises", fontsize=9)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right upper", fontsize=8)
    return png(figure)


def _settings_map(result: Result) -> bytes:
    """The error of α of every changed setting on every noise it was tried on, after the longest length."""
    n = result.plan.changed_lengths[-1]
    rows = [
        r for r in result.changes if r.samples == n and r.quantity == "alpha" and r.case.alpha is not None
    ]
    names = list(dict.fromkeys(r.estimator for r in rows))
    cases = list(dict.fromkeys(r.case for r in rows))
    found = {(r.estimator, r.case): r for r in rows}
    figure = new_figure(4.6 + 2.3 * len(cases), 1.6 + 0.27 * len(names))
    title = f"Changed settings, {n:,} samples, {result.plan.seeds} seeds"
    figure.suptitle(title, fontsize=11, x=0.01, ha="left")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, one in zip(panels, (MAPS["error"], MAPS["coverage"]), strict=True):
        values = [[_shown(found[name, case], one) for case in cases] for name in names]
        _paint(axes, np.array(values, dtype=np.float64), one)
        axes.set_title(one.short, fontsize=9)
        heads = [f"α {c.alpha:g}\nf {c.f:g}\ns2/R {c.step_ratio:g}" for c in cases]
        axes.set_xticks(range(len(cases)), heads, fontsize=8)
        axes.set_yticks(range(len(names)), names, fontsize=8)
    return png(figure)


def _shown(row: Row, one: Map) -> float:
    """NaN where half of the seeds or more have no value."""
    value = one.value(row)
    return np.nan if value is None or row.score.without * 2 >= row.score.seeds else value


def _paint(axes: "Axes", values: Array, one: Map) -> "AxesImage":
    """A heat map with its numbers; grey where there is none."""
    image = axes.imshow(values, cmap=one.colours, vmin=one.low, vmax=one.high, aspect="auto")
    axes.set_facecolor(GREY)
    axes.tick_params(length=0)
    for (line, column), value in np.ndenumerate(values):
        if np.isnan(value):
            continue
        red, green, blue, _ = image.to_rgba(np.array(value))
        dark = 0.3 * red + 0.6 * green + 0.1 * blue < 0.5
        text = _text(value, one.form)
        colour = "white" if dark else "black"
        axes.text(column, line, text, ha="center", va="center", fontsize=7.5, color=colour)
    return image


def _text(value: float, form: str) -> str:
    return ">900%" if form == ".0%" and value > 9 else format(value, form)
