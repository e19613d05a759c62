"""Runs `fltea identify` on records of the gallery's noises, and judges whether the verdicts are right.

The first main figure is the number of right verdicts. The second is the number of records that are called
fractional although their noise has no order. The third is the number of unsure claims: an order is claimed
although 2 log L of a model without an order is smaller by at most `MARGIN`. There should be no unsure claims.
"""

import zlib
from collections import Counter
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from fltea.identification.about_levels import analyse_series
from fltea.identification.axis import IdentifyOptions
from fltea.identification.left_out import NOTHING
from fltea.identification.load import GYRO_UNIT, Series
from fltea.identification.values import value_data_checks
from fltea.records.arrays import Array
from fltea.spectrum.wording import duration

from tools.validation.gallery import against
from tools.validation.gallery.noises import NOISES
from tools.validation.gallery.right import Right, right_verdicts
from tools.validation.pictures import new_figure, png
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table, grouped, share

if TYPE_CHECKING:
    from matplotlib.axes import Axes


SEEDS = QUICK_SEEDS = 1
"""Number of records of each noise, rate and length."""
RATES_HZ = (5.0, 100.0, 1_000.0)
LENGTHS_S = (30.0, 600.0, 10_800.0)
QUICK = (100.0, 600.0)
"""Sample rate [Hz] and length [s] of the records in a quick run."""
MARGIN = 6.0
"""An order may be claimed only if 2 log L of the model with an order is larger by more than this than 2 log L
of any model without an order.
"""
SCALE = 0.01
"""Standard deviation that the gallery's white noise has when it is identified [deg/s], as for a real sensor.
"""
CHECKS = "dead band", "common value", "clipped"
"""Data checks that must not report a problem, except on the noises that have this problem."""
COLOURS = {"right": "#4c9f70", "cannot be told": "#e9c46a", "wrong": "#d1495b"}
SIGNS = {"right": "", "cannot be told": "?", "wrong": "✗"}
"""The sign next to each verdict. It shows the outcome to readers who cannot distinguish the colours."""
ACROSS = 6
"""Number of small pictures next to each other in a row."""


def tasks(options: Options) -> list[Task]:
    """Return a task for each record."""
    rates, lengths = ((QUICK[0],), (QUICK[1],)) if options.quick else (RATES_HZ, LENGTHS_S)
    return [
        Task(name, analyse, (name, rate, length, number), round(rate * length))
        for name in NOISES
        if options.wanted(name)
        for rate in rates
        for length in lengths
        for number in range(options.first, options.first + options.seeds)
    ]


def draw(name: str, rate_hz: float, duration_s: float, number: int) -> Array:
    """Return the samples of record `number` of a noise, which are always the same."""
    samples = round(rate_hz * duration_s)
    seed = [number, zlib.crc32(name.encode()), round(rate_hz), samples]
    return NOISES[name].draw(samples, rate_hz, np.random.default_rng(seed))


def analyse(name: str, rate_hz: float, duration_s: float, number: int) -> list[Row]:
    """Draw one record and identify it.

    Return the verdict, the order with its 95 % interval, and the spectral lines.
    """
    y, noise = draw(name, rate_hz, duration_s, number), NOISES[name]
    cell: Row = {"noise": name, "rate_hz": rate_hz, "duration_s": duration_s, "record": number}
    known = {"truth": noise.truth, "has_order": noise.has_order, "true_alpha": noise.alpha}
    return [cell | known | judged(name, rate_hz, y)]


def judged(name: str, rate_hz: float, y: Array) -> Row:
    """Return the program's result for a record of a noise, and whether the verdict is right."""
    noise, truth, seen = NOISES[name], _right(name, rate_hz, len(y)), _seen(y, 1 / rate_hz)
    outcome = truth.outcome(seen["kind"])
    if noise.check or seen["checks"]:  # the verdict is not judged if a data check reports a problem
        outcome = "right" if noise.check in seen["checks"] else "wrong"
    reason = truth.accepted.get(seen["kind"], "") if outcome == "cannot be told" else ""
    return seen | {"outcome": outcome, "right": sorted(truth.right), "reason": reason}


def _seen(y: Array, h: float) -> Row:
    """Return the program's result for the samples `y`. Only this function of the gallery calls the program.

    The field `alpha` has the value of α and the ends of its interval. The field `ahead` is a difference: 2
    log L of the best model with an order, minus 2 log L of that model without an order that has the most
    parameters. It is None if no model has an order.
    """
    if (y == y[0]).all():
        text = "All samples are the same."
        return {"kind": "constant", "text": text, "alpha": None, "lines_hz": [], "ahead": None, "checks": []}
    seen = analyse_series(Series(SCALE * y, GYRO_UNIT, None), h, IdentifyOptions(), NOTHING).analysis
    evidence, candidates = seen.summed.seen.evidence, seen.summed.seen.evidence.candidates
    verdict = seen.verdict
    alpha = verdict.order.alpha
    return {
        "checks": [
            data_check.kind for data_check in value_data_checks(y, GYRO_UNIT) if data_check.kind in CHECKS
        ],
        "kind": verdict.kind,
        "text": verdict.text,
        "alpha": [alpha.value, alpha.low, alpha.high],
        "lines_hz": [peak.frequency_hz for peak in evidence.peaks],
        "ahead": None if candidates.ordered is None else candidates.lead_over_rich,
    }


@cache
def _right(name: str, rate_hz: float, samples: int) -> Right:
    return right_verdicts(NOISES[name], rate_hz, samples)


def tables(rows: list[Row]) -> list[Table | str]:
    """Return the main figures as sentences, and tables of the verdicts.

    The tables have the wrong verdicts, the verdicts for each true kind of noise, and the verdicts on records
    that cannot tell, with reasons.
    """
    record = ("noise", "record", "verdict")
    wrong = _cells(rows, "wrong", lambda some: ", ".join(some[0]["right"]))
    untellable = _cells(rows, "cannot be told", lambda some: "; ".join({row["reason"]: 0 for row in some}))
    return [
        *summary(rows),
        Table("Wrong", (*record, "right would be"), wrong),
        _truth_against_verdict(rows),
        Table("Cannot be told", (*record, "reason"), untellable, brief=False),
    ]


def _cells(rows: list[Row], outcome: str, why: Callable[[list[Row]], str]) -> list[tuple[str, ...]]:
    """Return a row for each noise, rate and length of which any record has this outcome."""
    found: list[tuple[str, ...]] = []
    for cell in grouped(rows, lambda row: (row["noise"], _record(row))).values():
        if some := [row for row in cell if row["outcome"] == outcome]:
            by_kind = grouped(some, lambda row: row["kind"])
            kinds = ", ".join(f"{kind} {len(each)}" for kind, each in by_kind.items())
            found.append((cell[0]["noise"], _record(cell[0]), f"{kinds} of {len(cell)}", why(some)))
    return found


def compared(before: list[Row], after: list[Row]) -> list[Table | str]:
    """Return tables of the verdicts that changed since an earlier run, for each noise, rate and length."""
    return against.tables(before, after)


def summary(rows: list[Row]) -> list[str]:
    """Return the main figures, one sentence each."""
    count = {outcome: sum(row["outcome"] == outcome for row in rows) for outcome in COLOURS}
    with_order = [row for row in rows if row["has_order"]]
    claims = [row for row in rows if row["kind"] == "fractional"]
    true_claims = [row for row in claims if row["has_order"]]
    tellable = [row for row in with_order if row["right"] == ["fractional"]]
    called = [row for row in tellable if row["kind"] == "fractional"]
    close = [row for row in claims if row["ahead"] is None or row["ahead"] <= MARGIN]
    total, without, false = len(rows), len(rows) - len(with_order), len(claims) - len(true_claims)
    shares = {outcome: share(number, total) for outcome, number in count.items()}
    return [
        f"Of {total} records {count['right']} verdicts are right ({shares['right']}), "
        f"{count['cannot be told']} say less because the record cannot tell ({shares['cannot be told']}), "
        f"and {count['wrong']} are wrong ({shares['wrong']}).",
        f'Of {without} records of noises without an order {false} are called "fractional" '
        f"({share(false, without)}).",
        f'Of {len(with_order)} records of noises with an order {len(true_claims)} are called "fractional", '
        f"{len(called)} of the {len(tellable)} that are long enough to tell it from relaxations.",
        f'Of {len(claims)} claims of "fractional" {len(close)} have a model without an order '
        f"within {MARGIN:g} in 2 log L.",
    ]


def _truth_against_verdict(rows: list[Row]) -> Table:
    columns = list(dict.fromkeys(map(_record, rows)))
    groups = grouped(rows, lambda row: (row["noise"], _record(row)))
    lines = [
        (name, NOISES[name].words, *(_verdicts(groups.get((name, column), [])) for column in columns))
        for name in dict.fromkeys(row["noise"] for row in rows)
    ]
    return Table("Truth against verdict", ("noise", "truth", *columns), lines, brief=False)


def _verdicts(cell: Sequence[Row]) -> str:
    found = Counter(f"{row['kind']}{SIGNS[row['outcome']]}" for row in cell)
    if len(cell) == 1:
        return next(iter(found))
    return ", ".join(f"{text} {count}" for text, count in found.most_common())


def _record(row: Row) -> str:
    return f"{row['rate_hz']:g} Hz, {duration(row['duration_s'])}"


def pictures(rows: list[Row]) -> dict[str, bytes]:
    """Return two pictures as PNG.

    One picture is a grid of outcomes. The other has the spectra of all noises, with truth and verdict.
    """
    return {"cells": _grid(rows), "spectra": _spectra(rows)}


def _grid(rows: list[Row]) -> bytes:
    """Return a grid of outcomes: a row for each noise, a column for each rate and length."""
    from matplotlib.patches import Patch, Rectangle

    groups = grouped(rows, lambda row: (row["noise"], _record(row)))
    names = list(dict.fromkeys(row["noise"] for row in rows))
    columns = list(dict.fromkeys(map(_record, rows)))
    figure = new_figure(3.4 + 0.62 * len(columns), 1.4 + 0.19 * len(names))
    axes = figure.subplots()
    axes.set_facecolor("#eeeeee")
    for line, name in enumerate(names):
        for column, record in enumerate(columns):
            outcomes = [row["outcome"] for row in groups.get((name, record), [])]
            left = column - 0.5
            for outcome, colour in COLOURS.items():
                width = 0.96 * outcomes.count(outcome) / max(len(outcomes), 1)
                axes.add_patch(Rectangle((left, line - 0.46), width, 0.92, color=colour, lw=0))
                if width:
                    axes.text(left + width / 2, line, SIGNS[outcome], ha="center", va="center", fontsize=6)
                left += width
    axes.set_xlim(-0.55, len(columns) - 0.45)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_yticks(range(len(names)), names, fontsize=7)
    axes.xaxis.tick_top()
    axes.set_xticks(range(len(columns)), [one.replace(", ", "\n") for one in columns], fontsize=7)
    axes.tick_params(length=0)
    handles = [Patch(color=colour, label=outcome) for outcome, colour in COLOURS.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return png(figure)


def _spectra(rows: list[Row]) -> bytes:
    """Return a picture with a small panel for each noise.

    The panel shows the noise's first record with the rate and length of `QUICK`, or the first record of all
    if none has these.
    """
    shown = [
        next((row for row in some if (row["rate_hz"], row["duration_s"]) == QUICK), some[0])
        for some in grouped(rows, lambda row: row["noise"]).values()
    ]
    lines = -(-len(shown) // ACROSS)
    figure = new_figure(2.15 * ACROSS, 1.6 * lines)
    panels = figure.subplots(lines, ACROSS, squeeze=False).ravel().tolist()
    for panel, row in zip(panels, shown, strict=False):
        _spectrum(panel, row)
    for panel in panels[len(shown) :]:
        panel.set_visible(False)
    return png(figure)


def _spectrum(axes: "Axes", row: Row) -> None:
    """Draw a periodogram in bins, the true density, and the verdict."""
    from matplotlib.ticker import NullFormatter

    noise, rate_hz = NOISES[row["noise"]], row["rate_hz"]
    y = draw(noise.name, rate_hz, row["duration_s"], row["record"])
    n, window = len(y), np.hanning(len(y))
    power = np.abs(np.fft.rfft((y - y.mean()) * window)) ** 2 / (window**2).sum()
    edges = np.unique(np.geomspace(2, n // 2, 60).astype(int))
    counts = np.diff(edges)
    hz = np.add.reduceat(np.arange(n // 2 + 1.0), edges)[:-1] / counts * rate_hz / n
    axes.loglog(hz, np.add.reduceat(power, edges)[:-1] / counts, color="#777777", lw=1.0)
    if noise.treatment is None:
        truth = noise.spectrum(2 * np.pi * hz / rate_hz, rate_hz)
        axes.loglog(hz, np.maximum(truth, 1e-4), "k--", lw=0.8)
    axes.set_title(noise.name, fontsize=8, pad=2)
    axes.yaxis.set_minor_formatter(NullFormatter())
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, high / 300), high)
    box = {"facecolor": COLOURS[row["outcome"]], "alpha": 0.75, "lw": 0, "pad": 1.5}
    axes.text(0.03, 0.04, row["kind"], transform=axes.transAxes, fontsize=7, bbox=box)
    axes.tick_params(labelsize=6, pad=1)
