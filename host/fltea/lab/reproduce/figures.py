"""Draw figures 2–10 and 12–20 of Macias & Sierociuk 2023 as PNG: the original and the estimates for each L.

One run is drawn, as in the paper: the run of the seed whose error of the order is the median of all seeds. If
the true order is not known, it is the run with the median order. No window is opened, since matplotlib's Agg
renders the figures.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fltea.estimator.engine import Estimates
from fltea.lab.reproduce.runs import Outcome
from fltea.lab.reproduce.scenarios import SOURCE_ALPHA, Data, Scenario
from fltea.records.arrays import Array
from fltea.records.whole_file import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

QUANTITIES = ("state", "order", "parameter")
"""The quantities of the paper's figures for each example and axis, in their order."""

# Styles of the curves for the lengths L. Wide pale lines are drawn first and narrow dark lines on top, so
# that all stay visible where the curves agree. The longest L takes the first style, the shortest the last.
STYLES: tuple[dict[str, Any], ...] = (
    {"color": "#9ecae1", "linewidth": 4.0},
    {"color": "#fd8d3c", "linewidth": 1.9},
    {"color": "#31a354", "linewidth": 1.2, "linestyle": (0, (6, 2))},
    {"color": "#542788", "linewidth": 0.9, "linestyle": (0, (2, 2))},
)
ORIGINAL: dict[str, Any] = {"color": "black", "linewidth": 0.8}


def median_seed(scenario: Scenario, results: Mapping[int, Outcome]) -> tuple[int, str]:
    """Return the index of the seed to draw, and in words why this seed was chosen."""
    outcome = next(iter(results.values()))
    if scenario.single:
        return 0, "the one run there is"
    good = np.flatnonzero(~outcome.not_finite)
    if not len(good):
        return 0, f"not one of {len(outcome.order):,} is finite"
    rank = outcome.order if scenario.alpha is not None else outcome.settled_order
    middle = good[np.argsort(rank[good], kind="stable")[len(good) // 2]]
    what = "error of the order" if scenario.alpha is not None else "order"
    return int(middle), f"median {what} of {len(outcome.order):,}"


def draw(
    path: Path,
    caption: str,
    quantity: str,
    scenario: Scenario,
    data: Data,
    estimates: Mapping[int, Estimates],
    note: str,
) -> None:
    """Write one figure of one run; `data` and `estimates` hold this run alone.

    Raises:
        FlteaError: the file cannot be written.
    """
    figure = _figure(caption, note, height=5.6 if quantity == "state" else 4.4)
    t = _times(scenario)
    original, curves = _curves(quantity, scenario, data, estimates)
    # A second panel shows only a fortieth of the run, so that changes from sample to sample are visible.
    fortieth = slice(len(t) // 2, len(t) // 2 + len(t) // 40)
    names = [None, fortieth] if quantity == "state" else [None]
    panels = figure.subplots(len(names), squeeze=False, height_ratios=[5, 3][: len(names)])[:, 0]
    for axes, part in zip(panels, names, strict=True):
        _panel(axes, t, original, curves, _label(quantity, scenario), part, measured=scenario.alpha is None)
    panels[-1].set_xlabel("time [s]")
    _save(figure, path)


def draw_unknown(
    path: Path,
    cases: Mapping[str, tuple[Scenario, Data, Mapping[int, Estimates]]],
    note: str,
) -> None:
    """Write the figure of the paper's section 6.2: order and parameter for each kind of source noise.

    Raises:
        FlteaError: the file cannot be written.
    """
    figure = _figure("Section 6.2: the source noise is not known", note, height=6.2)
    panels = figure.subplots(2, 2, sharex=True, sharey="row")
    for column, (name, (scenario, data, estimates)) in enumerate(cases.items()):
        t = _times(scenario)
        for row, quantity in enumerate(("order", "parameter")):
            axes = panels[row][column]
            original, curves = _curves(quantity, scenario, data, estimates)
            _panel(axes, t, original, curves, _label(quantity, scenario) if column == 0 else "")
            if quantity == "order" and column == 1 and scenario.alpha is not None:
                axes.axhline(scenario.alpha[0] + SOURCE_ALPHA, color="black", linewidth=0.8, linestyle=":")
                axes.annotate(
                    "α₁ + α₂", (t[-1], scenario.alpha[0] + SOURCE_ALPHA), (0, 4), ha="right",
                    textcoords="offset points", fontsize=9,
                )  # fmt: skip
        panels[0][column].set_title(name, fontsize=10)
        panels[1][column].set_xlabel("time [s]")
    _save(figure, path)


def _curves(
    quantity: str, scenario: Scenario, data: Data, estimates: Mapping[int, Estimates]
) -> tuple[Array | None, dict[str, Array]]:
    """Return the original curve of a quantity, and the curves of its estimates, by their names in the legend.

    The original is the true or measured curve; None if neither is known.
    """
    attribute = {"state": "x", "order": "alpha", "parameter": "f"}[quantity]
    curves = {f"L = {L:,}": getattr(got, attribute)[:, 0] for L, got in estimates.items()}
    original: Array | None = None
    if quantity == "state":
        original = (data.y if data.x is None else data.x)[:, 0]
    elif quantity == "order":
        original = scenario.alpha
    elif scenario.f is not None:
        original = np.full(scenario.samples, scenario.f)
    return original, curves


def _times(scenario: Scenario) -> Array:
    return np.arange(1.0, scenario.samples + 1) * np.asarray(scenario.filters.h, dtype=np.float64)


def _label(quantity: str, scenario: Scenario) -> str:
    state = f"state [{scenario.unit}]" if scenario.unit else "state"
    return {"state": state, "order": "order α", "parameter": "parameter f [s$^{-α}$]"}[quantity]


def _figure(caption: str, note: str, height: float) -> "Figure":
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, height), dpi=130, layout="constrained")
    figure.suptitle(caption, fontsize=11, x=0.01, ha="left")
    figure.supxlabel(note, fontsize=7.5, color="#555555", x=0.01, ha="left")
    return figure


def _panel(
    axes: "Axes",
    t: Array,
    original: Array | None,
    curves: Mapping[str, Array],
    label: str,
    part: slice | None = None,
    *,
    measured: bool = False,
) -> None:
    """Draw a panel: a whole run with a legend, or only the samples `part` of it, without a legend."""
    styles = [*STYLES[: len(curves) - 1], STYLES[-1]]
    shown = part or slice(None)
    if original is not None and measured:  # drawn first, so that it does not cover the estimates
        axes.plot(t[shown], original[shown], label="measured", color="#999999", linewidth=0.6)
    # a line of measured noise over a whole run is thinner, since its points are dense
    slender = 0.4 if measured and part is None else 1.0
    for style, (name, values) in zip(styles, curves.items(), strict=True):
        width = slender * style["linewidth"]
        axes.plot(t[shown], _drawable(values[shown]), label=name, **{**style, "linewidth": width})
    if original is not None and not measured:
        axes.plot(t[shown], original[shown], label="original", **ORIGINAL)
    axes.set_ylabel(label)
    axes.grid(alpha=0.25)
    if part is None:
        axes.set_xlim(0, t[-1])
        axes.set_ylim(*_limits(original, curves))
        axes.legend(loc="best", fontsize=8, framealpha=0.9)
    else:
        axes.set_xlim(t[part][0], t[part][-1])


def _limits(original: Array | None, curves: Mapping[str, Array]) -> tuple[float, float]:
    """Return the range of values to show. It leaves out the highest 0.2 % and the lowest 0.2 %.

    Estimates are often extreme just after the beginning of a run. If they were shown in full, the rest would
    look flat.
    """
    known = [] if original is None else [original]
    values = np.concatenate([*known, *(v[np.isfinite(v) & (np.abs(v) < 1e6)] for v in curves.values())])
    if not len(values):
        return -1.0, 1.0
    low, high = np.percentile(values, [0.2, 99.8])
    margin = 0.12 * (high - low) or 0.1
    return float(low - margin), float(high + margin)


def _drawable(values: Array) -> Array:
    """Return the values with NaN where an estimate is not finite or too large to draw."""
    return np.where(np.isfinite(values) & (np.abs(values) < 1e6), values, np.nan)


def _save(figure: "Figure", path: Path) -> None:
    with whole_file(path) as file:
        figure.savefig(file, format="png")
