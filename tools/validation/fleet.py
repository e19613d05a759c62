"""Measures how often `fltea fleet` calls a healthy sensor odd.

The fleets are simulated, and their fits are real fits of simulated noise.

The daemon's live estimator fits each record. Fleets of sensors with one axis are drawn from these fits, and
compared as `fltea fleet` compares sensors. If the sensors of a fleet are to differ, the N, B, K and density
of each sensor are multiplied by a random factor, as if the sensor had another gain. α and f do not change. In
one part of the measurement the records grow to a day, and the sensors are compared repeatedly meanwhile.
"""

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
from fltea.fleet.figures import QUANTITIES, Figure, figures_of
from fltea.fleet.messages import AxisFit
from fltea.fleet.roll import Axis, Roll, Sensor
from fltea.fleet.summary import compare
from numpy.typing import NDArray

from tools.fleet_fits import NOISES, RATE_HZ, fits
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table, number

SEEDS, QUICK_SEEDS = 400, 20
"""Number of records of each noise in a full and in a quick run."""
FLEETS = 100
"""Number of fleets (groups of sensors) that are drawn at random from the simulated sensors."""
SAMPLES = 100_000
DIFFER = (0.0, 0.03)
SIZES = (20, 100)
DAY_HZ, DAY = 10.0, 864_000
FIRST, GROWTH = 600, 1.2
"""Number of samples at the first comparison of a day, and the factor by which the records grow from each
comparison to the next.
"""
AT_ONCE = 10
Fits = list[AxisFit]
Place = tuple[Fits, list[dict[str, Figure]], float]
"""A sensor of a fleet: its fit at each comparison, the figures of each fit, and the factor by which its noise
is multiplied.
"""


def tasks(options: Options) -> list[Task]:
    """Return the tasks, which fit records of simulated noise.

    Some tasks fit records of one length. Others, which --quick leaves out, fit records that grow to a day, at
    each time at which the sensors of a fleet are compared.
    """
    grown = FIRST * GROWTH ** np.arange(math.ceil(math.log(DAY / FIRST, GROWTH)))
    day = [*np.round(grown).astype(int).tolist(), DAY]
    return [
        Task(name, fitted, (name, first, min(AT_ONCE, options.seeds - first), at, rate_hz), at[-1])
        for at, rate_hz in (([SAMPLES], RATE_HZ), *(() if options.quick else ((day, DAY_HZ),)))
        for name in NOISES
        if options.wanted(name)
        for first in range(0, options.seeds, AT_ONCE)
    ]


def fitted(noise: str, first: int, count: int, at: Sequence[int], rate_hz: float) -> list[Row]:
    """Return a row for each of `count` sensors. It has the fits to the first `at[0]`, `at[1]`, … samples."""
    rows: list[Row] = []
    for seed in range(first, first + count):
        record = NOISES[noise].draw(at[-1], np.random.default_rng((seed, at[-1])), rate_hz)
        comparisons = [msgspec.structs.replace(fit, spectrum=None) for fit in fits(record, at, rate_hz)]
        rows.append({"noise": noise, "rate_hz": rate_hz, "fits": msgspec.to_builtins(comparisons)})
    return rows


def tables(rows: list[Row]) -> list[Table | str]:
    """Return a table of false alarms.

    It gives the proportion of fleets, and the proportion of comparisons, in which at least one sensor is
    called odd.
    """
    cells = []
    for name, rate_hz in dict.fromkeys((row["noise"], row["rate_hz"]) for row in rows):
        pool = [
            msgspec.convert(row["fits"], Fits)
            for row in rows
            if (row["noise"], row["rate_hz"]) == (name, rate_hz)
        ]
        grows = len(pool[0]) > 1
        for sensors in (size for size in SIZES if size <= len(pool)):
            for differ in DIFFER:
                for ages in (False, True) if grows else (False,):
                    shares = share_of_fleets(pool, rate_hz, sensors, differ, FLEETS, ages=ages)
                    kind = name + (", a day" if grows else "") + (", of all ages" if ages else "")
                    cells.append((kind, str(sensors), f"{differ:.0%}", *_shares(shares)))
    headings = ("noise", "sensors", "they differ by", "fleets with any odd", "comparisons", "by figure")
    return [Table(f"False alarms of {FLEETS} fleets", headings, cells)]


def _shares(shares: dict[str, float]) -> tuple[str, ...]:
    names = [one.name for one in QUANTITIES if one.name in shares]
    by = ", ".join(f"{name} {shares[name]:.1%}" for name in names) or "none"
    return number(shares["any"], ".1%"), number(shares["comparison"], ".2%"), by


def share_of_fleets(
    pool: list[Fits], rate_hz: float, sensors: int, differ: float, count: int, *, ages: bool = False
) -> dict[str, float]:
    """Return the proportion of fleets in which at least one sensor is called odd, at any time.

    A sensor is odd if one of its figures, such as N, differs from those of the others. The result has one
    proportion for each figure, and one for all figures together (`any`). `comparison` is the proportion of
    comparisons, not of fleets, in which at least one sensor is called odd.

    `ages`: if true, each sensor has been on for a different time, and the sensors are compared once. If
    false, all sensors began at the same time, and are compared again and again while their records grow. Fits
    change little from one comparison to the next, so an odd result would be repeated: a single one counts as
    an alert.
    """
    rng = np.random.default_rng(sensors)
    figures = [_all_figures(comparisons, rate_hz) for comparisons in pool]
    ever: Counter[str] = Counter()
    times_odd, comparisons = 0, len(pool[0])
    for _ in range(count):
        members = rng.choice(len(pool), sensors, replace=False)
        factors = np.exp(rng.normal(0, differ, sensors))
        fleet = [(pool[i], figures[i], float(factor)) for i, factor in zip(members, factors, strict=True)]
        turns: Any = (
            [rng.integers(comparisons, size=sensors)] if ages else np.arange(comparisons)[:, np.newaxis]
        )
        seen = [_odd_at(fleet, np.broadcast_to(turn, sensors)) for turn in turns]
        times_odd += sum(map(bool, seen))
        quantities = set().union(*seen)
        ever.update(quantities)
        ever["any"] += bool(quantities)
    found = {name: times / count for name, times in ever.items()}
    return {"any": 0.0, **found, "comparison": times_odd / count / (1 if ages else comparisons)}


def _all_figures(comparisons: Fits, rate_hz: float) -> list[dict[str, Figure]]:
    """Return, for each of a sensor's fits in `comparisons`, the figures that `fltea fleet` compares."""
    found: list[dict[str, Figure]] = []
    for fit in comparisons:
        found.append(figures_of(fit, rate_hz, found[-1] if found else {}))
    return found


def _odd_at(fleet: list[Place], turns: NDArray[np.int64]) -> set[str]:
    """Compare the sensors of a fleet once. Return the names of the figures by which any sensor is called odd.

    `turns`: for each sensor, which of its fits takes part (index).
    """
    logarithmic = {quantity.name for quantity in QUANTITIES if quantity.log}
    roll = Roll()
    for place, ((comparisons, figures, factor), turn) in enumerate(zip(fleet, turns, strict=True)):
        sensor = roll.sensors[str(place)] = Sensor(str(place), 0.0, 0.0)
        scaled = {
            name: Figure(*(factor * end for end in figure)) if name in logarithmic else figure
            for name, figure in figures[turn].items()
        }
        sensor.axes["gyro_x"] = Axis(comparisons[turn].verdict, "", comparisons[turn].unit, 0, scaled, 0.0)
    return {one.quantity for one in compare(roll, 0.0).odd}
