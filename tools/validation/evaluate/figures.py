"""Heat maps of an evaluation as PNG files. They are rendered by Agg, so no window opens."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from fltea.records.arrays import Array
from pandas import DataFrame

from tools.validation.evaluate.settings import LIVE, WHITTLE
from tools.validation.evaluate.summaries import frame, medians
from tools.validation.pictures import new_figure, png
from tools.validation.runner import Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage


SHOWN = ("triple", "joint", "joint, tuned live", LIVE, WHITTLE)
LINES = {
    "triple": "C1o--",
    "joint": "C0s--",
    "joint, tuned live": "C9^-",
    LIVE: "C3D-",
    WHITTLE: "C7x:",
    "bound": "k-",
}
"""Estimators in the picture of the live fit's errors, and their line styles."""
GREY = "#d9d9d9"


class Map(NamedTuple):
    """A heat map.

    It shows one column, such as `rmse`, of the scores of one quantity, such as α. `low`, `high`: values at
    the ends of the colour scale. `colours`: name of the colour scale. `form`: format of the numbers in the
    cells.
    """

    title: str
    quantity: str
    column: str
    low: float
    high: float
    colours: str
    form: str


MAPS = {
    "error": Map("Root mean square error of α", "alpha", "rmse", 0.0, 0.4, "viridis_r", ".2f"),
    "bias": Map("Bias of α", "alpha", "bias", -0.4, 0.4, "RdBu", "+.2f"),
    "coverage": Map(
        "Proportion of 95 % intervals that contain the true α",
        "alpha",
        "coverage",
        0.0,
        1.0,
        "cividis",
        ".0%",
    ),
    "spread": Map(
        "Spread of α / Cramér–Rao bound (below 1 only with a bias)",
        *("alpha", "sd_over_bound", 0.0, 2.0, "PuOr", ".2g"),
    ),
    "f": Map("Median error of f, as a proportion of f", "f", "error_of_f", 0.0, 1.0, "viridis_r", ".0%"),
}


def draw(rows: list[Row]) -> dict[str, bytes]:
    """Return the pictures as contents of PNG files, by name.

    There is one picture for each of `MAPS`, one for the changed settings, and one for the errors of the
    fits and of the filters, with and without the live fit's Q and R.
    """
    scores, changes = shown(frame(rows, "rows")), shown(frame(rows, "changes"))
    maps = {name: _grid_map(scores, one) for name, one in MAPS.items()}
    return maps | {"settings": _settings_map(changes), "live": _live_lines(scores)}


def shown(scores: DataFrame) -> DataFrame:
    """Return the scores of the noises with an order, and add the column `error_of_f`.

    It is the median error of f divided by |f|.

    If at least half of the series of a noise have no estimate, the shown scores are NaN.
    """
    found = scores[scores.alpha.notna()].assign(error_of_f=lambda some: some.median_error / some.f.abs())
    columns = [one.column for one in MAPS.values()]
    found[columns] = found[columns].mask(found.without * 2 >= found.seeds)
    return found


def _grid_map(scores: DataFrame, one: Map) -> bytes:
    """Draw a panel for each estimator and record length.

    Each cell of a panel is a noise. Cells in the same column have the same s2/R: the variance of the state's
    steps divided by that of the white noise. Cells in the same row have the same α and f.
    """
    some = scores[scores.quantity == one.quantity]
    lengths = some.samples.unique()
    dynamics = some[["alpha", "f"]].drop_duplicates()
    height = 1.4 + len(SHOWN) * (0.7 + 0.24 * len(dynamics))
    figure = new_figure(2.0 + 2.7 * len(lengths), height)
    filters, fits = (some[some.estimator == name].seeds.iloc[0] for name in ("joint", LIVE))
    figure.suptitle(f"{one.title}\n{filters} seeds, the fits {fits}", fontsize=11, x=0.01, ha="left")
    panels = figure.subplots(len(SHOWN), len(lengths), sharex=True, sharey=True, squeeze=False)
    for line, estimator in zip(panels, SHOWN, strict=True):
        for axes, n in zip(line, lengths, strict=True):
            panel = some[(some.estimator == estimator) & (some.samples == n)]
            # in a panel, f decreases from row to row
            values = panel.assign(f=-panel.f).pivot(
                index=["alpha", "f"], columns="step_ratio", values=one.column
            )
            image = _paint(axes, values.to_numpy(dtype=np.float64), one)
            axes.set_title(f"{estimator}, {n:,} samples", fontsize=9)
            axes.set_xticks(
                range(len(values.columns)), [f"{ratio:g}" for ratio in values.columns], fontsize=8
            )
            axes.set_yticks(range(len(values)), [f"{a:g}, {-f:g}" for a, f in values.index], fontsize=8)
    for axes in panels[-1]:
        axes.set_xlabel("s2/R", fontsize=9)
    for axes in panels[:, 0]:
        axes.set_ylabel("α, f", fontsize=9)
    figure.colorbar(image, ax=panels, shrink=0.3, extend="max" if one.form != ".0%" else "neither")
    return png(figure)


def _live_lines(scores: DataFrame) -> bytes:
    """Draw the error of α against s2/R, in one panel for each record length.

    s2 is the variance of the steps of the fractional state, and R that of the white noise. The error is the
    median, over all noises with this ratio, of the root mean square error.
    """
    found = medians(scores)
    ratios, lengths = list(found.columns), scores.samples.unique()
    figure = new_figure(2.6 + 2.7 * len(lengths), 3.6)
    panels = figure.subplots(1, len(lengths), sharey=True, squeeze=False)[0]
    for axes, n in zip(panels, lengths, strict=True):
        for name, style in LINES.items():
            axes.loglog(ratios, found.loc[name, n], style, label=name, markersize=4, linewidth=1.4)
        axes.set_title(f"{n:,} samples", fontsize=9)
        axes.set_xticks(ratios, [f"{ratio:g}" for ratio in ratios], fontsize=8)
        axes.minorticks_off()
        axes.grid(alpha=0.3)
        axes.set_xlabel("s2/R", fontsize=9)
    ticks = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5]
    panels[0].set_yticks(ticks, [f"{tick:g}" for tick in ticks], fontsize=8)
    panels[0].set_ylabel("rms error of α, median over the noises", fontsize=9)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right upper", fontsize=8)
    return png(figure)


def _settings_map(changes: DataFrame) -> bytes:
    """Draw the error of α for each changed setting and noise, at the greatest record length."""
    n = changes.samples.max()
    some = changes[(changes.samples == n) & (changes.quantity == "alpha")]
    figure = new_figure(4.6 + 2.3 * some.noise.nunique(), 1.6 + 0.27 * some.estimator.nunique())
    title = f"Changed settings, {n:,} samples, {some.seeds.iloc[0]} seeds"
    figure.suptitle(title, fontsize=11, x=0.01, ha="left")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, name, short in zip(
        panels, ("error", "coverage"), ("error of α", "proportion of intervals that contain α"), strict=True
    ):
        values = some.pivot(index="estimator", columns="noise", values=MAPS[name].column)
        _paint(axes, values.to_numpy(dtype=np.float64), MAPS[name])
        axes.set_title(short, fontsize=9)
        heads = [str(noise).replace(", ", "\n").replace(" =", "") for noise in values.columns]
        axes.set_xticks(range(len(heads)), heads, fontsize=8)
        axes.set_yticks(range(len(values)), values.index, fontsize=8)
    return png(figure)


def _paint(axes: "Axes", values: Array, one: Map) -> "AxesImage":
    """Draw a heat map with numbers in its cells. Cells without a number are grey."""
    image = axes.imshow(values, cmap=one.colours, vmin=one.low, vmax=one.high, aspect="auto")
    axes.set_facecolor(GREY)
    axes.tick_params(length=0)
    for (line, column), value in np.ndenumerate(values):
        if np.isnan(value):
            continue
        red, green, blue, _ = image.to_rgba(np.array(value))
        dark = 0.3 * red + 0.6 * green + 0.1 * blue < 0.5
        text = ">900%" if one.form == ".0%" and value > 9 else format(value, one.form)
        colour = "white" if dark else "black"
        axes.text(column, line, text, ha="center", va="center", fontsize=7.5, color=colour)
    return image
