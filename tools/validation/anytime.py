"""Measure how often white noise gets a verdict other than white within 24 hours.

The significance level `evidence.ANYTIME_LEVEL` was chosen with these measurements.

A simulated day of one axis at 100 Hz is fitted as often as a live sensor (fltea.stream.fit_times): in two
thousand refits, a hundred of them with a new model search. A rule is one of the tests that can turn a verdict
from white to another, such as that for peaks. For each rule and significance level, the tables give the
proportion of axes for which the rule ever rejects white noise. They also give the proportion of axes that
ever get a verdict other than white; for this, the program's own levels are used. Noises with relaxations
(first-order Gauss-Markov processes) are not white and have no order. For them, the tables give the proportion
of axes that are ever called fractional.
"""

import math
from collections.abc import Callable

import numpy as np
from fltea.records.arrays import Array
from fltea.spectrum.drift import FALSE_ALARM as FALSE_DRIFT
from fltea.spectrum.evidence import ANYTIME_LEVEL, APART, LEVEL, Evidence
from fltea.spectrum.last_refit import LastRefit
from fltea.spectrum.live_axes import FEWEST_SAMPLES
from fltea.spectrum.octaves import Octaves
from fltea.spectrum.spectral import examine
from fltea.spectrum.spectral_lines import FALSE_ALARM, find_peaks
from fltea.spectrum.stationarity import find_change
from fltea.spectrum.verdict import decide
from fltea.stream.fit_times import RefitTimes

from tools.validation.power import WHITE
from tools.validation.recursions import Stream
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table, grouped, share

Draw = Callable[[int], Array]

SEEDS, QUICK_SEEDS = 200, 4
"""Number of axes of each noise. The axes of a quick run are simulated for half an hour instead of a day."""
H = 0.01
DAY, SHORT = 8_640_000, 180_000
PERIOD = round(1 / H)
AT_ONCE = 1 << 16
LEVELS = (0.05, 0.01, 3e-3, 1e-3, 3e-4, 1e-4, 5e-5, 3e-5, 1e-5)


def _relaxations(poles: tuple[float, ...], rng: np.random.Generator) -> Draw:
    """Return a function that draws samples of white noise plus AR(1) processes of unit variance.

    Each call of the function continues the same processes.
    """
    sizes = [math.sqrt(1 - pole * pole) for pole in poles]
    streams = [Stream([size], [1.0, -pole]) for pole, size in zip(poles, sizes, strict=True)]

    def draw(n: int) -> Array:
        y = rng.standard_normal(n)
        for one in streams:
            y += one.run(rng.standard_normal(n))
        return y

    return draw


POLES = {"AR(.5)": (0.5,), "AR(.99)": (0.99,), "AR(.99) + AR(.5)": (0.99, 0.5)}


def tasks(options: Options) -> list[Task]:
    """Return a task for each axis."""
    return [
        Task(name, axis, (name, SHORT if options.quick else DAY, seed))
        for name in (*WHITE, *POLES)
        if options.wanted(name)
        for seed in range(options.seeds)
    ]


def axis(noise: str, samples: int, seed: int) -> list[Row]:
    """Simulate an axis; return, for each rule, the lowest significance level at which it ever rejects.

    A rule is a test that can reject white noise. If its significance level were lower than the result, it
    would not have rejected white noise on this axis at any time.
    """
    rng = np.random.default_rng((seed, samples))
    draw: Draw = (lambda n: WHITE[noise](n, rng)) if noise in WHITE else _relaxations(POLES[noise], rng)
    sums, last_refit, taken, of = Octaves(1), LastRefit(), 0, _levels if noise in WHITE else _claim
    times = RefitTimes(1 / H, grows=True, every=True)
    times.begin(PERIOD)
    lowest: dict[str, float] = {}
    while (until := times.due) <= samples:
        while taken < until:
            part = min(until - taken, AT_ONCE)
            sums.add(np.ascontiguousarray(draw(part)[:, np.newaxis]))
            taken += part
        refit = times.at(taken, taken, PERIOD, noticed=False)
        if is_search := refit is not None and refit.fresh:
            last_refit.forget()
        if taken >= FEWEST_SAMPLES:
            for rule, p in of(sums, last_refit, taken, is_search=is_search).items():
                lowest[rule] = min(lowest.get(rule, 1.0), p)
    if noise in WHITE:
        lowest["any rule"] = min(level for rule, level in lowest.items() if rule != "verdict")
    return [{"noise": noise, "samples": samples, "lowest": lowest}]


def _evidence(sums: Octaves, last_refit: LastRefit, taken: int) -> Evidence:
    whole, drift = sums.lines_and_drift(0, H)
    cells = sums.cells(0, H)
    return examine(
        whole, taken * H, taken, cells=cells, drift=drift, level=ANYTIME_LEVEL, last_refit=last_refit
    ).evidence


def _levels(sums: Octaves, last_refit: LastRefit, taken: int, *, is_search: bool) -> dict[str, float]:
    """Return, for each rule, the lowest significance level at which it rejects white noise after one fit.

    The fit is that of the first `taken` samples. `is_search`: whether it includes a model search. Without a
    search, the rules for peaks and for changes of the noise do not apply; their result is 1.
    """
    e = _evidence(sums, last_refit, taken)
    f = e.candidates
    bic = min(f.bic(one) for one in (f.plain, f.ordered) if one is not None)
    by_level = FALSE_ALARM / LEVEL
    found: list[float] = []
    change = None
    whole = sums.periodogram(0, H)
    if is_search:
        change = find_change(sums.cells(0, H), H, LEVELS[0] * by_level)
    if is_search and find_peaks(whole, LEVELS[0] * by_level):
        found = [level for level in LEVELS if find_peaks(whole, level * by_level)]
    return {
        "null test": e.p_all,
        # `bic` is the best model's BIC minus that of white noise. At the level LEVEL, this rule rejects white
        # noise if -bic exceeds APART; at another level, if -bic exceeds APART + 2 log(LEVEL / level). The
        # expression below is this equation, solved for `level`.
        "sentences": min(LEVEL * math.exp((bic + APART) / 2), 1.0),
        "drift": next(
            (level * 0.999 for level in LEVELS[::-1] if e.slow.is_drift(FALSE_DRIFT * level / LEVEL)), 1.0
        ),
        "peaks": found[-1] * 0.999 if found else 1.0,
        "not stationary": change.p / by_level if change else 1.0,
        "verdict": 1.0 if decide(e).kind == "white" else 0.0,
    }


def _claim(sums: Octaves, last_refit: LastRefit, taken: int, *, is_search: bool) -> dict[str, float]:
    """Return {"fractional": 0} if the noise is called fractional after this fit, otherwise {"fractional": 1}.

    The numbers are significance levels, as those of `_levels`: 0 counts as a rejection at every level, 1 as
    none.
    """
    return {"fractional": 0.0 if decide(_evidence(sums, last_refit, taken)).kind == "fractional" else 1.0}


def tables(rows: list[Row]) -> list[Table | str]:
    """Return tables of how often white noise is rejected.

    They give the proportion of axes for which each rule ever rejects white noise, for each significance
    level.
    """
    found: list[Table | str] = []
    for name, axes in grouped(rows, lambda row: row["noise"]).items():
        shares = [
            (rule, *(share(sum(row["lowest"][rule] < level for row in axes), len(axes)) for level in LEVELS))
            for rule in axes[0]["lowest"]
        ]
        title = f"{name}: {len(axes)} axes, {axes[0]['samples']:,} samples"
        found.append(Table(title, ("rule", *(f"{level:g}" for level in LEVELS)), shares))
    return found
