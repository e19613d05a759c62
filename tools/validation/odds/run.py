"""Validates the odds of an order.

This part measures how reliable the odds are, and how many true orders are found with the help of the odds.

Noises are drawn from the populations that the odds were calibrated on, with other seeds.
"""

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from fltea.records.odds import MOST

from tools.validation.odds.counts import count
from tools.validation.odds.populations import POPULATIONS
from tools.validation.pictures import new_figure, png
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table, grouped, interval, share

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SEEDS, QUICK_SEEDS = 400, 40
"""Number of noises of each population and length in a full and in a quick run."""
SEED = 2026
LENGTHS = (3_000, 20_000, 60_000, 200_000)
AT_ONCE = 20
TELLS = 20.0
"""With odds of this size or more, a person would rely on the order."""
BINS = (1 / MOST, 0.1, 1 / 3, 0.8, 1.25, 3.0, 10.0, 1e9)
FALSE_SHARES = (0.01, 0.02, 0.05, 0.1)


def tasks(options: Options) -> list[Task]:
    """Return one task for each group of AT_ONCE noises of one population and length."""
    lengths = LENGTHS[:2] if options.quick else LENGTHS
    return [
        Task(
            f"{population}, {n}",
            count,
            (population, n, first, min(AT_ONCE, options.seeds - first), SEED),
            n,
        )
        for n in lengths
        for population in POPULATIONS
        if options.wanted(population)
        for first in range(0, options.seeds, AT_ONCE)
    ]


def tables(rows: list[Row]) -> list[Table | str]:
    """Return three tables.

    The tables say how reliable the odds are, how often an order is claimed falsely and rightly, and how many
    true orders are found.

    The last table gives the proportion of true orders that are found if a given proportion of claims is false
    (FALSE_SHARES).
    """
    return [_reliability(rows), _claims(rows), _found(rows)]


def _weights(rows: Sequence[Row]) -> list[float]:
    """Return the weight of each row.

    At each length, the rows of a population together have the population's weight.
    """
    by_kind = grouped(rows, lambda row: (row["population"], row["samples"]))
    return [
        POPULATIONS[row["population"]][1] / len(by_kind[row["population"], row["samples"]]) for row in rows
    ]


def reliability(rows: Sequence[Row]) -> list[tuple[int, float, float, float]]:
    """Return, for each range of odds, the predicted and the observed proportion of noises with an order.

    Each row also has the number of noises and the standard error of the observed proportion.
    """
    told = [row for row in rows if row["odds"] is not None]
    weight = np.array(_weights(told))
    odds = np.array([row["odds"] for row in told])
    has = np.array([row["population"] == "order" for row in told])
    found = []
    for low, high in itertools.pairwise(BINS):
        w, said, true = (a[(odds >= low) & (odds < high)] for a in (weight, odds / (1 + odds), has))
        if len(w):
            seen = float(w @ true / w.sum())
            effective = float(w.sum() ** 2 / (w @ w))
            error = math.sqrt(max(seen * (1 - seen), 1 / effective) / effective)
            found.append((len(w), float(w @ said / w.sum()), seen, error))
    return found


def _reliability(rows: list[Row]) -> Table:
    cells = [
        (_samples(n), str(count), f"{said:.1%}", f"{seen:.1%} ± {2 * error:.1%}")
        for n, some in grouped(rows, lambda row: row["samples"]).items()
        for count, said, seen, error in reliability(some)
    ]
    return Table("Odds that come true", ("record", "noises", "an order, said", "an order, seen"), cells)


def _claims(rows: list[Row]) -> Table:
    cells = []
    for (population, n), some in grouped(rows, lambda row: (row["population"], row["samples"])).items():
        claims = sum(row["kind"] == "fractional" for row in some)
        low, high = interval(claims, len(some))
        tells = sum(_log_odds(row) >= math.log(TELLS) for row in some)
        cells.append(
            (
                population,
                _samples(n),
                share(claims, len(some)),
                f"{low:.1%} … {high:.1%}",
                share(tells, len(some)),
            )
        )
    headings = ("noise", "record", 'called "fractional"', "95 %", f"odds of {TELLS:.0f} : 1 or more")
    return Table("Claims", headings, cells)


def _log_odds(row: Row) -> float:
    return -math.inf if row["odds"] is None else math.log(row["odds"])


def operating(rows: Sequence[Row], against: str) -> tuple[list[float], list[float]]:
    """Return how often an order is claimed falsely, and how often rightly, for each of many thresholds.

    An order is claimed if the best model with an order leads by at least the threshold (see `_score`). Two
    lists are returned, from the highest threshold to the lowest:
        false claims, as proportions of the noises of the population `against`, which have no order;
        right claims, as proportions of the noises with an order.
    """
    scores = {
        name: np.array([_score(row) for row in rows if row["population"] == name])
        for name in ("order", against)
    }
    bounds = np.unique(np.concatenate(list(scores.values())))[::-1]
    false, true = (
        [0.0, *((one[:, None] >= bounds).mean(axis=0)).tolist()] for one in (scores[against], scores["order"])
    )
    return false, true


def _score(row: Row) -> float:
    """Return the lead: BIC of the best model without an order, minus that of the best model with one.

    The odds are computed from it and from other figures. Unlike the odds, the lead has no limit.
    """
    return -math.inf if row["lead"] is None else float(row["lead"])


def _found(rows: list[Row]) -> Table:
    cells = []
    names = [name for name in POPULATIONS if name != "order"]
    for n, some in grouped(rows, lambda row: row["samples"]).items():
        if not any(row["population"] == "order" for row in some):
            continue
        for name in names:
            if not any(row["population"] == name for row in some):
                continue
            false, true = operating(some, name)
            best = [max(t for f, t in zip(false, true, strict=True) if f <= most) for most in FALSE_SHARES]
            cells.append((_samples(n), name, *(f"{one:.0%}" for one in best)))
    headings = ("record", "against", *(f"{one:.0%} false" for one in FALSE_SHARES))
    return Table("Orders found at a share of false ones", headings, cells)


def _samples(n: int) -> str:
    return f"{n:,}"


def pictures(rows: list[Row]) -> dict[str, bytes]:
    """Return two pictures.

    One picture shows how reliable the odds are, the other how many orders are found for each proportion of
    false claims.
    """
    figure = new_figure(11.0, 4.6)
    left, right = figure.subplots(1, 2)
    by_length = grouped(rows, lambda row: row["samples"])
    left.plot([0, 1], [0, 1], color="#999999", linewidth=1)
    for n, some in by_length.items():
        _, said, seen, error = (np.array(column) for column in zip(*reliability(some), strict=True))
        left.errorbar(said, seen, 2 * error, marker="o", markersize=4, capsize=2, label=f"{n:,} samples")
    left.set(xlabel="share of orders, as the odds say", ylabel="share of orders, seen")
    left.legend(frameon=False)
    _draw_found(right, by_length[max(n for n in by_length if n <= 60_000)])
    return {"curves": png(figure)}


def _draw_found(axes: "Axes", rows: list[Row]) -> None:
    for name in POPULATIONS:
        if name != "order":
            axes.plot(*operating(rows, name), label=f"against: {name}")
    axes.axvline(0.01, color="#999999", linewidth=1)
    axes.set(
        xlabel="share of noises without an order above a bound of the odds",
        ylabel="share of orders above it",
        xscale="log",
        xlim=(2e-3, 1.0),
        title=f"{rows[0]['samples']:,} samples",
    )
    axes.legend(frameon=False)
