"""Count how often each published interval contains the true value, on noises with random parameters.

An interval of a part's parameter counts only if the chosen model has exactly the true parts. Otherwise the
parameter describes something else. N counts wherever it is published. For most quantities an axis counts as 0
or 1. For the Allan deviation it counts with the proportion of points that are inside their band, and for the
forecasts with the proportion of stretches of time that are inside theirs.
"""

import math
import zlib
from typing import Any

import numpy as np

from tools.validation.closed_form import samples
from tools.validation.coverage import measure
from tools.validation.coverage.populations import POPULATIONS, H, Population, between
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import NONE, Table, grouped, number

SEEDS, QUICK_SEEDS = 400, 20
"""Number of axes of each population."""
FORECAST_SHARE = 2
"""FORECAST_SHARE: only one out of this number of axes gets a forecast, since a forecast takes longer."""


def tasks(options: Options) -> list[Task]:
    """Return a task for each population (a kind of noise with random parameters)."""
    return [
        Task(name, count, (name, options.seeds), one.longest)
        for name, one in POPULATIONS.items()
        if options.wanted(name)
    ]


def count(name: str, axes: int) -> list[Row]:
    """Count the intervals of a population that contain the true value; return one row for each quantity."""
    population = POPULATIONS[name]
    rng = np.random.default_rng([45, zlib.crc32(name.encode())])
    seen = [one for number in range(axes) for one in _axis(population, rng, number)]
    rows: list[Row] = []
    for quantity, those in grouped(seen, lambda one: one.quantity).items():
        published = [one for one in those if one.published]
        misses = np.array([one.below + one.above for one in published])
        widths = [one.width for one in published if one.width is not None]
        rows.append(
            {
                "population": name,
                "quantity": quantity,
                "intervals": len(those),
                "published": len(published),
                "below": sum(one.below for one in published),
                "above": sum(one.above for one in published),
                "squares": float((misses**2).sum()),
                "width": float(np.median(widths)) if widths else None,
            }
        )
    return rows


def _axis(population: Population, rng: np.random.Generator, number: int) -> list[measure.Seen]:
    parts = population.draw(rng)
    n = round(between(rng, population.shortest, population.longest))
    y = samples(parts, n, H, rng)
    axis = measure.analyse(parts, y)
    found = list(measure.of_fit(axis))
    if population.steady:
        found += [*measure.of_drift(axis, y), *measure.of_allan(axis, y)]
        if number % FORECAST_SHARE == 0:
            found += measure.of_forecast(axis, y)
    return found


def tables(rows: list[Row]) -> list[Table | str]:
    """Return tables of how often each quantity's interval contains the true value.

    The first table is over all populations (kinds of noise) together, the second has each by itself.
    """
    whole = [
        (str(quantity), *_cells(those))
        for quantity, those in sorted(grouped(rows, lambda row: row["quantity"]).items())
    ]
    single = [(row["population"], row["quantity"], *_cells([row])) for row in rows]
    columns = "published", "hold the truth", "truth below", "truth above", "width"
    return [
        Table("Intervals of 95 % that hold the truth", ("interval of", *columns), whole),
        Table("By population", ("population", "interval of", *columns), single, brief=False),
    ]


def _cells(rows: list[Row]) -> tuple[str, ...]:
    total, published, below, above, squares = (
        sum(row[name] for row in rows) for name in ("intervals", "published", "below", "above", "squares")
    )
    if not published:
        return f"0 of {total}", *([NONE] * 4)
    missed = (below + above) / published
    error = math.sqrt(max(squares / published - missed**2, 0.0) / published)
    widths: list[Any] = [row["width"] for row in rows if row["width"] is not None]
    return (
        f"{published} of {total}",
        f"{100 * (1 - missed):.1f} ± {100 * error:.1f} %",
        f"{100 * below / published:.1f} %",
        f"{100 * above / published:.1f} %",
        number(float(np.median(widths)) if widths else None, ".2g"),
    )
