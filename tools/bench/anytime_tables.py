"""How often white sensors are ever called anything else in 24 hours, for `verdict.ANYTIME_LEVEL`.

    python -m tools.bench.anytime_tables [--axes 200] [--noise gauss] [--seed 0] [--json]

Axis-days of white noise at 100 Hz are looked at whenever they have grown by 5 %: between such looks next to
nothing changes. For each rule and level: the share of axes for which it ever speaks.
"""

import argparse
import json
import math
import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import Any

import numpy as np
from fltea.spectrum.lines import FALSE_ALARM
from fltea.spectrum.octave_lines import find_octave_peaks
from fltea.spectrum.octaves import Octaves
from fltea.spectrum.spectral import examine
from fltea.spectrum.stationarity import find_change
from fltea.spectrum.verdict import LEVEL
from fltea.spectrum.warm import Warm
from numpy.typing import NDArray

Array = NDArray[np.float64]

H = 0.01
DAY = 8_640_000
FIRST, GROWTH = 200, 1.05
AT_ONCE = 1 << 16
LEVELS = (0.05, 0.01, 3e-3, 1e-3, 3e-4, 1e-4, 5e-5, 3e-5, 1e-5)
RULES = ("null test", "broad resonance", "peaks", "not stationary", "any")
NOISES: dict[str, Callable[[int, np.random.Generator], Array]] = {
    "gauss": lambda n, rng: rng.standard_normal(n),
    "lsb": lambda n, rng: np.rint(rng.standard_normal(n)),
    "t4": lambda n, rng: rng.standard_t(4, n),
}


def axis_day(noise: str, samples: int, seed: int) -> list[float]:
    """The highest level at which each rule is silent all the time."""
    rng = np.random.default_rng((seed, samples))
    sums, warm, taken = Octaves(1), Warm(), 0
    lowest = dict.fromkeys(RULES, 1.0)
    look = float(FIRST)
    while taken < samples:
        until = min(round(look), samples)
        while taken < until:
            part = min(until - taken, AT_ONCE)
            sums.add(NOISES[noise](part, rng)[:, np.newaxis])
            taken += part
        for rule, p in _look(sums, warm, taken).items():
            lowest[rule] = min(lowest[rule], p)
        look *= GROWTH
    lowest["any"] = min(lowest.values())
    return [lowest[rule] for rule in RULES]


def _look(sums: Octaves, warm: Warm, taken: int) -> dict[str, float]:
    """The levels from which on the rules speak now."""
    whole = sums.periodogram(0, H)
    e = examine(whole, taken * H, taken, peaks=(), warm=warm).evidence
    share = FALSE_ALARM / LEVEL
    found = (
        [level for level in LEVELS if find_octave_peaks(whole, level * share)]
        if (find_octave_peaks(whole, LEVELS[0] * share))
        else []
    )
    change = find_change(sums.cells(0, H), H, LEVELS[0] * share)
    return {
        "null test": e.p_all,
        # Believed if BIC < -2 log(LEVEL / level).
        "broad resonance": min(LEVEL * math.exp(e.contest.models["ar2"].bic / 2), 1.0),
        "peaks": found[-1] * 0.999 if found else 1.0,
        "not stationary": change.p / share if change else 1.0,
    }


def measure(noise: str, axes: int, samples: int, seed: int, jobs: int) -> dict[str, Any]:
    """Share of axes for which each rule ever speaks, by level; from its first look to the last."""
    seeds = range(seed, seed + axes)
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn")) as pool:
        lowest = np.array(list(pool.map(partial(axis_day, noise, samples), seeds)))
    shares = {
        rule: {str(level): float((lowest[:, i] < level).mean()) for level in LEVELS}
        for i, rule in enumerate(RULES)
    }
    return {"noise": noise, "axes": axes, "samples": samples, "ever": shares}


def text(figures: dict[str, Any]) -> str:
    """As a table."""
    head = "".join(f"{level:>9g}" for level in LEVELS)
    lines = [f"{figures['noise']}: {figures['axes']} axes, {figures['samples']:,} samples", " " * 16 + head]
    for rule, ever in figures["ever"].items():
        lines.append(f"{rule:<16}" + "".join(f"{share:>9.2%}" for share in ever.values()))
    return "\n".join(lines)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--axes", type=int, default=200, help="axes of each noise (default: 200)")
    parser.add_argument("--noise", choices=[*NOISES, "all"], default="all")
    parser.add_argument("--samples", type=int, default=DAY, help="of each axis (default: a day)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    for noise in NOISES if given.noise == "all" else [given.noise]:
        figures = measure(noise, given.axes, given.samples, given.seed, given.jobs)
        print(json.dumps(figures) if given.json else text(figures), flush=True)


if __name__ == "__main__":
    main()
