"""Whether the steps between times are those of a sensor's clock, and what its period is (pure)."""

import math
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from fltea.recording.sample_numbers import Numbering
from fltea.recording.sample_times import EVEN_SHARE, EVENNESS, Elapsed, Floats, Ints

Blocks = Callable[[], Iterable[Floats]]
"""Gives elapsed times, a block at a time, each time it is called."""

MOST_IN_TURNS = 4
"""Sensors whose turns are known by the times alone."""

SHORT_GAPS = 2, 3, 4
"""Steps of so many periods are a clock's, too, however many there are. Bursts leave longer ones."""

NEARLY = 1e-3
"""Of a grain: times are on it."""

COARSEST_S = 1e-3 * (1 + NEARLY)
"""Of a counter of milliseconds. In coarser times, where nearly all steps are one grain, a longer one lacks a
sample: 99 Hz in hundredths of a second look like 100 Hz that lose each hundredth sample."""

FEWEST_ODD, ODD_SHARE = 20, 0.005
"""Repeated times with other values by which a clock is as coarse as its samples: so many, and of all rows."""

RARE, CLEAN_SHARE = 0.05, 0.5
"""The shortest stretches lack no sample; and of those that tell a period so many lack none."""

FEWEST_BURSTS, MANY_BURSTS, ALIKE_SHARE = 3, 10, 0.7
"""Long steps tell bursts if so many of them are alike, or if nearly all time is in many of them."""

MOST_IN_STEPS, NEARLY_ALL = 0.5, 0.8
"""Of the time, that is in long steps: then a clock would have lost most of its samples."""


class Bursts(NamedTuple):
    """Rows that come `rows` at a time, once in `every`, in the column's unit."""

    rows: int
    every: float


class Clock(NamedTuple):
    """What steps say, in the column's unit.

    typical: the mean without gaps. even: they are a clock's. bursts: why they are none. is_coarse: times are
    rounded, and some are the same that were not. is_rounded: they are, to a good part of the period. in_turn:
    after so many steps they are the same again, as where so many sensors take turns; 0: they are not.
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
    """Look at elapsed times; None if there is no step. elapsed: what they are of, with all that were odd."""
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
    if period == math.inf and grain < median / 2:  # then no step that lacks a sample is near the median
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
    """After how many steps they are the same again; 0 if they are not, or only rounded to a grain."""
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
    """The shares of steps near the median, and with those near a multiple, as short gaps are.

    The third is the mean of the steps near the median.
    """
    count, near, gaps, total = odd, 0, 0, 0.0
    for steps in _steps(blocks):
        single = steps[np.abs(steps - median) <= tolerance]
        count, near, total = count + len(steps), near + len(single), total + float(single.sum())
        for times in SHORT_GAPS if tolerance < median / 2 else ():
            gaps += int((np.abs(steps - times * median) <= tolerance).sum())
    return near / count, (near + gaps) / count, total / near if near else 0.0


def _grain(blocks: Blocks, median: float) -> float:
    """The power of ten on which all times are, if it is a good part of the period; else 0."""
    grain = 10.0 ** math.floor(math.log10(median * (1 + NEARLY)))
    is_fine = grain <= EVENNESS * median
    on_it = (bool((np.abs(t / grain - np.rint(t / grain)) < NEARLY).all()) for t in blocks())
    return 0.0 if is_fine or not all(on_it) else grain


def _by_stretches(blocks: Blocks, median: float, grain: float) -> float | None:
    """The period of rounded times by long stretches; None: it is the median, and longer steps lack samples.

    Steps of 1 and 2 ms are those of 800 Hz in whole ms if all stretches of as many steps are alike, to the
    grain; of 1000 Hz with losses some are as many ms as steps. Infinite: the stretches are too short to tell.
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
    times = np.cumsum(steps)  # some of these stretches did lack samples; once all are numbered, none does
    numbers = (
        Numbering(period, 1 / period, is_rounded=True).add(times, np.zeros(len(times), np.bool_)).sequence
    )
    return float(times[-1] - times[0]) / int(numbers[-1] - numbers[0])


def _shortest(times: Floats, rows: int) -> float:
    return float(np.quantile(times[rows:] - times[:-rows], RARE, method="lower"))


def _bursts(blocks: Iterable[Floats], period: float, longest: float) -> Bursts | None:
    """Whether rows come in bursts, as where a board or a radio gathers them and the times are of arrival."""
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
