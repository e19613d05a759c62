"""How often `fltea fleet` calls a sensor odd that is not: fleets of real fits, of simulated noise.

    python -m tools.fleet_false_alarms                     a table in Markdown, some five minutes on two cores
    python -m tools.fleet_false_alarms --fits 200 --json   quicker, coarser
    python -m tools.fleet_false_alarms --day --fits 100    how many fleets raise any alert within a day

The live estimator of the daemon fits each record; fleets of one axis a sensor are drawn from these fits and
looked at as the program looks at them. Sensors that differ by themselves have N, B, K and density times a
factor of their own, which is what another gain would do; α and f stay.
"""

import argparse
import json
import math
import multiprocessing
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import Any

import msgspec
import numpy as np
from fltea.fleet.figures import QUANTITIES, Figure, figures_of
from fltea.fleet.messages import AxisFit
from fltea.fleet.roll import Axis, Roll, Sensor
from fltea.fleet.summary import look
from numpy.typing import NDArray

from tools.fleet_noise import NOISES, RATE_HZ, fits

SAMPLES = 100_000
DIFFER = (0.0, 0.03)
SIZES = (20, 100)
DAY_HZ = 10.0
DAY = 864_000
FIRST, GROWTH = 600, 1.2
"""Samples at the first look of a day, and by how much a record grows from look to look."""
Fits = list[AxisFit]


def _looks(noise: str, at: Sequence[int], rate_hz: float, seed: int) -> list[bytes]:
    """Messages of one axis, one for each look."""
    record = NOISES[noise].draw(at[-1], np.random.default_rng((seed, at[-1])), rate_hz)
    found = fits(record, at, rate_hz)
    return [msgspec.json.encode(msgspec.structs.replace(fit, spectrum=None)) for fit in found]


def made(noise: str, count: int, at: Sequence[int], rate_hz: float, jobs: int) -> list[Fits]:
    """Fits of so many sensors, each at all looks, as they come out of a message."""
    read = msgspec.json.Decoder(AxisFit).decode
    one = partial(_looks, noise, at, rate_hz)
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn")) as pool:
        return [[read(fit) for fit in looks] for looks in pool.map(one, range(count), chunksize=8)]


def all_figures(looks: Fits, rate_hz: float) -> list[dict[str, Figure]]:
    """Of one sensor, look by look."""
    found: list[dict[str, Figure]] = []
    for fit in looks:
        found.append(figures_of(fit, rate_hz, found[-1] if found else {}))
    return found


def times(figures: dict[str, Figure], factor: float) -> dict[str, Figure]:
    """Of a sensor whose noise is so many times as strong."""
    ratios = {quantity.name for quantity in QUANTITIES if quantity.log}
    return {
        name: Figure(*(factor * end for end in figure)) if name in ratios else figure
        for name, figure in figures.items()
    }


def odd_at(fleet: list[tuple[Fits, list[dict[str, Figure]], float]], turns: NDArray[np.int64]) -> set[str]:
    """By which figures anybody is called odd, each sensor at look number `turns` of its own."""
    roll = Roll()
    for place, ((looks, figures, factor), turn) in enumerate(zip(fleet, turns, strict=True)):
        sensor = roll.sensors[str(place)] = Sensor(str(place), 0.0, 0.0)
        fit = looks[turn]
        axis = Axis(fit.verdict, "", fit.unit, 0, times(figures[turn], factor), 0.0)
        sensor.axes["gyro_x"] = axis
    return {one.quantity for one in look(roll, 0.0).odd}


def share_of_fleets(
    pool: list[Fits], rate_hz: float, sensors: int, differ: float, count: int, *, ages: bool = False
) -> dict[str, float]:
    """Share of fleets in which anybody is ever called odd, by figure, and `any`; `look`: share of looks.

    ages: each sensor has been on for another time, and there is one look. Else all began at once and are
    looked at while their records grow; fits change little between these looks, so what one sees is an alert.
    """
    rng = np.random.default_rng(sensors)
    figures = [all_figures(looks, rate_hz) for looks in pool]
    ever: Counter[str] = Counter()
    times_odd, looks = 0, len(pool[0])
    for _ in range(count):
        members = rng.choice(len(pool), sensors, replace=False)
        factors = np.exp(rng.normal(0, differ, sensors))
        fleet = [(pool[i], figures[i], float(factor)) for i, factor in zip(members, factors, strict=True)]
        turns = [rng.integers(looks, size=sensors)] if ages else np.arange(looks)[:, np.newaxis]
        seen = [odd_at(fleet, np.broadcast_to(turn, sensors)) for turn in turns]
        times_odd += sum(map(bool, seen))
        quantities = set().union(*seen)
        ever.update(quantities)
        ever["any"] += bool(quantities)
    found = {name: number / count for name, number in ever.items()}
    return {"any": 0.0, **found, "look": times_odd / count / (1 if ages else looks)}


def measure(noise: str, given: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Rows of the table that are of one noise."""
    at, rate_hz = [SAMPLES], RATE_HZ
    if given.day:
        grown = FIRST * GROWTH ** np.arange(math.ceil(math.log(DAY / FIRST, GROWTH)))
        at, rate_hz = [*np.round(grown).astype(int).tolist(), DAY], DAY_HZ
    pool = made(noise, given.fits, at, rate_hz, given.jobs)
    for sensors in (size for size in SIZES if size <= given.fits):
        for differ in DIFFER:
            for ages in (False, True) if given.day else (False,):
                shares = share_of_fleets(pool, rate_hz, sensors, differ, given.fleets, ages=ages)
                yield {"noise": noise, "sensors": sensors, "differ": differ, "ages": ages, **shares}


def text(row: dict[str, Any]) -> str:
    """A row of the table."""
    names = [quantity.name for quantity in QUANTITIES]
    by = ", ".join(f"{name} {row[name]:.1%}" for name in names if name in row) or "none"
    kind = " | ".join([row["noise"] + (", of all ages" if row["ages"] else ""), str(row["sensors"])])
    return f"| {kind} | {row['differ']:.0%} | {row['any']:.1%} | {row['look']:.2%} | {by} |"


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--day", action="store_true", help="records that grow to a day, from one minute on")
    parser.add_argument("--fits", type=int, default=400, help="records of each noise")
    parser.add_argument("--fleets", type=int, default=100, help="drawn from these records")
    parser.add_argument("--noise", choices=NOISES, action="append", help="only this one; may be repeated")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", action="store_true", help="a line of JSON each")
    given = parser.parse_args()
    if given.fits < min(SIZES) or given.fleets < 1 or given.jobs < 1:
        parser.error(f"--fits: at least {min(SIZES)}, a fleet's sensors; --fleets and --jobs: at least 1")
    if not given.json:
        print("| noise | sensors | they differ by | fleets with any odd | looks | by figure |")
        print("|---|---|---|---|---|---|")
    for noise in given.noise or NOISES:
        for row in measure(noise, given):
            print(json.dumps(row) if given.json else text(row), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
