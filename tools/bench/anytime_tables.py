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
from fltea.spectrum.evidence import ANYTIME_LEVEL, LEVEL
from fltea.spectrum.lines import FALSE_ALARM
from fltea.spectrum.octave_lines import find_octave_peaks
from fltea.spectrum.octaves import Octaves
from fltea.spectrum.spectral import examine
from fltea.spectrum.stationarity import find_change
from fltea.spectrum.verdict import decide
from fltea.spectrum.warm import Warm
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]

H = 0.01
DAY = 8_640_000
FIRST, GROWTH = 200, 1.05
AT_ONCE = 1 << 16
LEVELS = (0.05, 0.01, 3e-3, 1e-3, 3e-4, 1e-4, 5e-5, 3e-5, 1e-5)
CLAIMS = ("fractional",)
RULES = ("null test", "broad resonance", "peaks", "not stationary", "any")
Draw = Callable[[int], Array]


def _relaxations(poles: tuple[float, ...], shares: tuple[float, ...], rng: np.random.Generator) -> Draw:
    """AR(1) processes of unit variance, times `shares`, in white noise; it goes on from call to call."""
    states = [np.array([0.0]) for _ in poles]

    def draw(n: int) -> Array:
        y = rng.standard_normal(n)
        for i, (phi, share) in enumerate(zip(poles, shares, strict=True)):
            step = share * math.sqrt(1 - phi * phi) * rng.standard_normal(n)
            part, states[i] = lfilter([1.0], [1.0, -phi], step, zi=states[i])
            y += part
        return y

    return draw


WHITE: dict[str, Callable[[np.random.Generator], Draw]] = {
    "gauss": lambda rng: rng.standard_normal,
    "lsb": lambda rng: lambda n: np.rint(rng.standard_normal(n)),
    "t4": lambda rng: lambda n: rng.standard_t(4, n),
}
RELAXING: dict[str, Callable[[np.random.Generator], Draw]] = {
    "AR(.5)": partial(_relaxations, (0.5,), (1.0,)),
    "AR(.99)": partial(_relaxations, (0.99,), (1.0,)),
    "AR(.99) + AR(.5)": partial(_relaxations, (0.99, 0.5), (1.0, 1.0)),
}
NOISES = WHITE | RELAXING
"""The latter are not white, and of no order: how often are they ever called fractional?"""


def axis_day(noise: str, samples: int, seed: int) -> list[float]:
    """The highest level at which each rule is silent all the time."""
    draw = NOISES[noise](np.random.default_rng((seed, samples)))
    sums, warm, taken = Octaves(1), Warm(), 0
    rules = RULES if noise in WHITE else CLAIMS
    lowest = dict.fromkeys(rules, 1.0)
    look = float(FIRST)
    while taken < samples:
        until = min(round(look), samples)
        while taken < until:
            part = min(until - taken, AT_ONCE)
            sums.add(np.ascontiguousarray(draw(part)[:, np.newaxis]))
            taken += part
        for rule, p in (_look if noise in WHITE else _claim)(sums, warm, taken).items():
            lowest[rule] = min(lowest[rule], p)
        look *= GROWTH
    if noise in WHITE:
        lowest["any"] = min(lowest.values())
    return [lowest[rule] for rule in rules]


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


def _claim(sums: Octaves, warm: Warm, taken: int) -> dict[str, float]:
    """Whether the noise is called fractional now: below every level, or below none."""
    whole, cells = sums.periodogram(0, H), sums.cells(0, H)
    seen = examine(whole, taken * H, taken, cells=cells, level=ANYTIME_LEVEL, warm=warm)
    return {CLAIMS[0]: 0.0 if decide(seen.evidence).kind == "fractional" else 1.0}


def measure(noise: str, axes: int, samples: int, seed: int, jobs: int) -> dict[str, Any]:
    """Share of axes for which each rule ever speaks, by level; from its first look to the last."""
    seeds = range(seed, seed + axes)
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn")) as pool:
        lowest = np.array(list(pool.map(partial(axis_day, noise, samples), seeds)))
    shares = {
        rule: {str(level): float((lowest[:, i] < level).mean()) for level in LEVELS}
        for i, rule in enumerate(RULES if noise in WHITE else CLAIMS)
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
