"""Decides whether the steps between times are those of a sensor's clock, and measures the sampling period."""

import math
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from fltea.recording.sample_numbers import Numbering
from fltea.recording.sample_times import EVEN_SHARE, EVENNESS, Elapsed, Floats, Ints

Blocks = Callable[[], Iterable[Floats]]
"""Function that yields elapsed times in blocks; each call begins anew."""

MOST_IN_TURNS = 4
"""Most sensors in turns that the times alone can reveal."""

SHORT_GAPS = 2, 3, 4
"""Steps of this many periods count as lost samples, however many there are. Bursts leave longer steps."""

NEARLY = 1e-3
"""Tolerance for a time to be a multiple of the grain, relative to the grain."""

COARSEST_S = 1e-3 * (1 + NEARLY)
"""Coarsest grain of times whose period is examined: a counter of milliseconds [s].

Coarser times, where nearly all steps are one grain, are ambiguous: 99 Hz in hundredths of a second look like
100 Hz with every hundredth sample lost.
"""

FEWEST_ODD, ODD_SHARE = 20, 0.005
"""Repeated times with different values, as a number and a share of rows, from which a clock is too coarse."""

RARE, CLEAN_SHARE = 0.05, 0.5
"""Quantile of stretches that counts as without lost samples, and smallest share of stretches without loss."""

FEWEST_BURSTS, MANY_BURSTS, ALIKE_SHARE = 3, 10, 0.7
"""Fewest long steps for regular bursts, for any bursts, and the share of long steps that have to be alike."""

MOST_IN_STEPS, NEARLY_ALL = 0.5, 0.8
"""Share of the time in long steps, for regular and for any bursts: a clock would have lost most samples."""


class Bursts(NamedTuple):
    """Rows that arrive `rows` at a time, once in each interval `every` (in the column's unit)."""

    rows: int
    every: float


class Clock(NamedTuple):
    """What the steps between times show, in the column's unit.

    `typical`: mean step without gaps. `even`: the steps are those of a sensor's clock.
    `bursts`: rows arrive in bursts. `is_coarse`: times are so rounded that different times became equal.
    `is_rounded`: times are rounded to a large part of the period.
    `in_turn`: number of sensors in turns, after which the steps repeat; 0: no turns.
    """

    typical: float
    median: float
    least: float
    largest: float
    even: bool
    bursts: Bursts | None = None
    is_coarse: bool = False
    is_rounded: bool = False
    in_turn: int = 0


def clock_of(blocks: Blocks, elapsed: Elapsed) -> Clock | None:
    """Examine elapsed times; return None if no time differs.

    `elapsed`: their column, with its counted faults.
    """
    medians, least, largest, count = [], math.inf, 0.0, 0
    for steps in _steps(blocks()):
        medians.append(float(np.median(steps)))
        least, largest = min(least, float(steps.min())), max(largest, float(steps.max()))
        count += len(steps)
    if not medians:
        return None
    median = float(np.median(medians))
    single, share, typical = _even_share(blocks(), median, EVENNESS * median, elapsed.odd)
    grain = _grain(blocks, median) if single < 1 else 0.0
    if single >= EVEN_SHARE and grain * elapsed.unit_s > COARSEST_S:
        grain = 0.0
    period = _by_stretches(blocks, median, grain) if grain else None
    if period == math.inf and grain < median / 2:  # the median step then contains no lost sample
        period = None
    if period is not None or (grain and share < EVEN_SHARE):
        step = median if period in (None, math.inf) else period
        _, share, mean = _even_share(blocks(), step or median, grain * (1 + NEARLY), elapsed.odd)
        typical = period or mean
    bursts = _bursts(blocks(), typical, elapsed.longest)
    is_coarse = grain > 0 and elapsed.odd - elapsed.backwards >= max(FEWEST_ODD, ODD_SHARE * count)
    is_other = single >= EVEN_SHARE or bursts is not None or elapsed.odd > 0
    turns = 0 if is_other else _in_turn(next(iter(_steps(blocks()))), grain)
    even = share >= EVEN_SHARE and 0 < typical < math.inf and not (bursts or is_coarse or turns)
    return Clock(typical, median, least, largest, even, bursts, is_coarse, period is not None, turns)


def _in_turn(steps: Floats, grain: float) -> int:
    """Return after how many steps the steps repeat; 0 if they do not, except by rounding to `grain`."""
    for count in range(2, min(MOST_IN_TURNS, len(steps) // 4) + 1):
        middle = np.array([np.median(steps[k::count]) for k in range(count)])
        usual = np.resize(middle, len(steps))
        is_even = np.ptp(middle) <= max(EVENNESS * middle.min(), grain * (1 + NEARLY))
        if not is_even and (np.abs(steps - usual) <= EVENNESS * middle.min()).mean() >= EVEN_SHARE:
            return count
    return 0


def _steps(blocks: Iterable[Floats]) -> Iterator[Floats]:
    last: list[float] = []
    for times in blocks:
        steps = np.diff(times, prepend=last)
        last = [float(times[-1])]
        steps = steps[steps > 0]
        if len(steps):
            yield steps


def _even_share(
    blocks: Iterable[Floats], median: float, tolerance: float, odd: int
) -> tuple[float, float, float]:
    """Return the share of steps near `median`, that near 1 to 4 times `median`, and the mean step.

    The mean is that of the steps near `median`.
    """
    count, near, gaps, total = odd, 0, 0, 0.0
    for steps in _steps(blocks):
        single = steps[np.abs(steps - median) <= tolerance]
        count, near, total = count + len(steps), near + len(single), total + float(single.sum())
        for times in SHORT_GAPS if tolerance < median / 2 else ():
            gaps += int((np.abs(steps - times * median) <= tolerance).sum())
    return near / count, (near + gaps) / count, total / near if near else 0.0


def _grain(blocks: Blocks, median: float) -> float:
    """Return the power of ten that divides all times, if it is a large part of the period; else 0."""
    grain = 10.0 ** math.floor(math.log10(median * (1 + NEARLY)))
    is_fine = grain <= EVENNESS * median
    on_it = (bool((np.abs(t / grain - np.rint(t / grain)) < NEARLY).all()) for t in blocks())
    return 0.0 if is_fine or not all(on_it) else grain


def _by_stretches(blocks: Blocks, median: float, grain: float) -> float | None:
    """Return the period of rounded times, measured over long stretches; None: the period is the median step.

    Steps of 1 and 2 ms are those of 800 Hz in whole ms if all stretches of equally many steps have the same
    length, except for the grain. With 1000 Hz and losses, some stretches have as many ms as steps. The result
    is infinite if the stretches are too short to decide.
    """
    found = [(len(t), _of_block(t, median, grain)) for t in blocks() if len(t) > 1]
    total = sum(rows for rows, _ in found)
    told = [(rows, period) for rows, period in found if period is not None]
    if 2 * sum(rows for rows, _ in told) <= total:
        return None
    return sum(rows * period for rows, period in told) / sum(rows for rows, _ in told)


def _of_block(times: Floats, median: float, grain: float) -> float | None:
    steps = np.diff(times)
    excess = float(steps[steps < (SHORT_GAPS[-1] + 0.5) * median].mean()) / median - 1
    most = len(times) // 4
    rows = max(4, math.ceil(2 / max(abs(excess), 1e-9)))
    if rows > most or (excess > 0 and _shortest(times, rows) < rows * median + grain / 2):
        return None
    period, rows = math.inf, 8
    while rows <= most:
        stretches = times[rows:] - times[:-rows]
        clean = stretches <= _shortest(times, rows) + grain * (1 + NEARLY)
        if clean.mean() < CLEAN_SHARE:
            break
        period, rows = float(stretches[clean].mean()) / rows, 2 * rows
    if period == math.inf:
        return period
    steps[steps > (SHORT_GAPS[-1] + 0.5) * period] = period
    times = np.cumsum(steps)  # numbered samples, since some stretches lack samples
    numbers = (
        Numbering(period, 1 / period, is_rounded=True).add(times, np.zeros(len(times), np.bool_)).sequence
    )
    return float(times[-1] - times[0]) / int(numbers[-1] - numbers[0])


def _shortest(times: Floats, rows: int) -> float:
    return float(np.quantile(times[rows:] - times[:-rows], RARE, method="lower"))


def _bursts(blocks: Iterable[Floats], period: float, longest: float) -> Bursts | None:
    """Return the bursts in which rows arrive, as when a radio collects rows; None without bursts."""
    places: list[Ints] = []
    found: list[Floats] = []
    count, total = 0, 0.0
    for steps in _steps(blocks):
        long = np.flatnonzero((steps > (SHORT_GAPS[-1] + 0.5) * period) & (steps <= longest))
        places.append(count + long)
        found.append(steps[long])
        count, total = count + len(steps), total + float(steps[steps <= longest].sum())
    long = np.concatenate(found)
    if len(long) < FEWEST_BURSTS:
        return None
    rows, middle = np.diff(np.concatenate(places)), float(np.median(long))
    usual = float(np.median(rows))
    alike = (
        (np.abs(rows - round(usual)) <= max(1.0, usual / 4)).mean(),
        (np.abs(long / middle - 1) <= 0.5).mean(),
    )
    share = float(long.sum()) / total
    is_regular = share > MOST_IN_STEPS and min(alike) >= ALIKE_SHARE
    if usual > 1 and (is_regular or (share > NEARLY_ALL and len(long) >= MANY_BURSTS)):
        return Bursts(round(usual), (usual - 1) * period + middle)
    return None
