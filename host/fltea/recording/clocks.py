"""Decides by the steps between times whether a sensor's clock gave them, and measures the sampling period."""

import math
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from fltea.recording.sample_numbers import Numbering
from fltea.recording.sample_times import EVEN_SHARE, EVENNESS, Elapsed, Floats, Ints

Blocks = Callable[[], Iterable[Floats]]
"""Function that yields the elapsed times of a column in blocks. Each call starts at the first block again."""

MOST_IN_TURNS = 4
"""Largest number of alternating sensors that can be recognised from the times alone."""

SHORT_GAPS = 2, 3, 4
"""A step between times that is this many sampling periods long means lost samples, even if many steps are as
long. A longer step may also be a pause between bursts of rows.
"""

NEARLY = 1e-3
"""A time is taken as a multiple of a resolution if it differs from one by less than this proportion of the
resolution.
"""

COARSEST_S = 1e-3 * (1 + NEARLY)
"""Coarsest resolution of times that is taken into account if nearly all steps between times are equal [s].

With a coarser resolution, these equal steps are taken as the period, since the times do not show the true
one: in hundredths of a second, 99 Hz looks like 100 Hz with every hundredth sample lost.
"""

FEWEST_ODD, ODD_SHARE = 20, 0.005
"""A clock is taken as too coarse if many rows repeat the time of the row before, with other values: at least
FEWEST_ODD rows, and at least the fraction ODD_SHARE of all rows.
"""

RARE, CLEAN_SHARE = 0.05, 0.5
"""A stretch of n rows lasts longer if samples were lost in it. Of the durations of all stretches of n rows,
the quantile RARE is taken as the duration without loss. If fewer than the fraction CLEAN_SHARE of the
stretches are about as short, the period is not measured from stretches of n rows.
"""

FEWEST_BURSTS, MANY_BURSTS, ALIKE_SHARE = 3, 10, 0.7
"""A long step between times may be a pause between two bursts of rows. Bursts are recognised from at least
this many pauses: FEWEST_BURSTS if the bursts are regular, MANY_BURSTS if not. Bursts are regular if at least
the fraction ALIKE_SHARE of them have about equally many rows, and as many pauses are about equally long.
"""

MOST_IN_STEPS, NEARLY_ALL = 0.5, 0.8
"""Bursts of rows are recognised only if the pauses between them take more than this fraction of the whole
time: MOST_IN_STEPS if the bursts are regular, NEARLY_ALL if not.
"""


class Bursts(NamedTuple):
    """Bursts of `rows` rows, one burst in each interval `every` (in the unit of the column of times)."""

    rows: int
    every: float


class Clock(NamedTuple):
    """What the steps between times show about their clock. All times are in the unit of their column.

    `typical`: sampling period, as far as the steps show it. `median`, `least`, `largest`: median, smallest
    and largest step. `even`: whether the steps are those of a sensor's clock. `bursts`: the bursts in which
    rows arrive, or None. `is_coarse`: whether times are rounded so coarsely that different times became
    equal. `is_rounded`: whether equal periods give different steps, since times are rounded to a large part
    of the period. `in_turn`: number of sensors whose rows alternate; 0 if the steps do not show this.
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
    """Examine elapsed times, and return what is known of their clock; None if all times are equal.

    `elapsed`: the converter that made these elapsed times from a column, with its counts of faulty times.
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
    # The stretches are too short to measure the period. But the median step is more than two units of the
    # resolution, so rounding changes it little.
    if period == math.inf and grain < median / 2:
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
    """Return the number of alternating sensors that the steps between rows show; 0 if they show none.

    With two sensors, for instance, short and long steps alternate. Steps that differ only by the rounding of
    times to multiples of `grain` show nothing.
    """
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
    """Compare the steps between times with their median.

    Return three numbers: the fraction of steps near the median; the fraction of steps near 1, 2, 3 or 4
    medians, as lost samples cause them; and the mean of the steps near the median.

    `tolerance`: how far a step that is near may differ. `odd`: number of faulty times, which count as steps.
    """
    count, near, gaps, total = odd, 0, 0, 0.0
    for steps in _steps(blocks):
        single = steps[np.abs(steps - median) <= tolerance]
        count, near, total = count + len(steps), near + len(single), total + float(single.sum())
        for times in SHORT_GAPS if tolerance < median / 2 else ():
            gaps += int((np.abs(steps - times * median) <= tolerance).sum())
    return near / count, (near + gaps) / count, total / near if near else 0.0


def _grain(blocks: Blocks, median: float) -> float:
    """Return the resolution to which all times are rounded, a power of ten.

    Return 0 if the resolution is much finer than the period.
    """
    grain = 10.0 ** math.floor(math.log10(median * (1 + NEARLY)))
    is_fine = grain <= EVENNESS * median
    on_it = (bool((np.abs(t / grain - np.rint(t / grain)) < NEARLY).all()) for t in blocks())
    return 0.0 if is_fine or not all(on_it) else grain


def _by_stretches(blocks: Blocks, median: float, grain: float) -> float | None:
    """Return the period of rounded times, measured over long stretches; None if the median step is right.

    Example: times in whole ms have steps of 1 and 2 ms, and the median step is 1 ms. This has two causes:
    - The rate is 800 Hz. Then all stretches with the same number of steps have nearly the same length. The
      period is this length divided by the number of steps.
    - The rate is 1000 Hz, and samples were lost. Then some stretches without loss last exactly as many ms as
      they have steps. The median step is right.

    The result is infinite if the stretches are too short to decide.
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
    times = np.cumsum(steps)
    # `Numbering` gives the times their sample numbers; it skips numbers where samples are missing
    numbers = (
        Numbering(period, 1 / period, is_rounded=True).add(times, np.zeros(len(times), np.bool_)).sequence
    )
    return float(times[-1] - times[0]) / int(numbers[-1] - numbers[0])


def _shortest(times: Floats, rows: int) -> float:
    return float(np.quantile(times[rows:] - times[:-rows], RARE, method="lower"))


def _bursts(blocks: Iterable[Floats], period: float, longest: float) -> Bursts | None:
    """Return the bursts in which rows arrive, as from a radio; None if rows do not come in bursts."""
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
