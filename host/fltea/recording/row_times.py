"""Times that stand beside the samples of a table: they tell the rate, and which samples are missing."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.recording.columns import SECONDS
from fltea.recording.files import EVEN_SHARE, EVENNESS, LONGEST_S, SHORTEST_STEP_S
from fltea.recording.spool import Spool
from fltea.records.errors import UsageError
from fltea.settings.how import TimeUnit

AT_ONCE = 1 << 16
PLAUSIBLE_HZ = 5.0, 10_000.0
"""Rates at which a gyroscope is recorded. A column that says no unit and gives another is not in seconds."""

GRAINS = (1.0, 0.1, 1e-2, 1e-3, 1e-4)
"""Of rounded times, in their own unit."""

SHORT_GAPS = 2, 3, 4
"""Steps of so many samples are a clock's, too, however many there are. Bursts leave longer ones."""

NEARLY = 1e-3
"""Of a grain: times are on it."""

ALIKE = 0.2
"""A rate that is given and one by the times are the same, whose unit nobody says."""


class Steps(NamedTuple):
    """From row to row, in the column's unit. typical: their mean, without gaps. even: they are a clock's."""

    typical: float
    median: float
    least: float
    largest: float
    even: bool


def steps_of(spool: Spool) -> Steps:
    """Look at the column `time`, of two rows or more, a block at a time."""
    medians, least, largest = [], math.inf, -math.inf
    for steps in _steps(spool):
        medians.append(float(np.median(steps)))
        least, largest = min(least, float(steps.min())), max(largest, float(steps.max()))
    median = float(np.median(medians))
    share, typical = _even_share(spool, median, EVENNESS * median)
    if share < EVEN_SHARE and median > 0:
        grain = _grain(spool)
        if median >= 2 * grain > EVENNESS * median:  # rounded: 2 and 3 ms in turns are 400 Hz
            share, typical = _even_share(spool, median, grain * (1 + NEARLY))
    return Steps(typical, median, least, largest, share >= EVEN_SHARE and typical > 0)


def rate_of(path: Path, name: str, unit: TimeUnit | None, spool: Spool, span: float) -> tuple[float, float]:
    """Rate in Hz of samples whose times are a device's, and the seconds in one of their unit.

    span: the last time.

    Raises:
        UsageError: uneven times, or ones that are not in seconds.
    """
    if spool.length("time") < 2:
        raise UsageError(f"{path}: one row alone tells no rate; give it: --rate 100.")
    steps = steps_of(spool)
    scale = SECONDS[unit or "s"]
    if unit is None and steps.even and not _plausible(1 / steps.typical):
        _ask_unit(path, name, 1 / steps.typical)
    if not steps.even or steps.median * scale < SHORTEST_STEP_S or span * scale > LONGEST_S:
        in_unit = unit or "s"
        raise UsageError(
            f"{path}: column '{name}': the steps are too uneven for a device's clock (median "
            f"{steps.median:.3g} {in_unit}, from {steps.least:.3g} to {steps.largest:.3g} {in_unit}). If "
            "these are times of arrival, give the rate: --rate 100 (the column then tells no gaps)."
        )
    return 1.0 / (steps.typical * scale), scale


def _plausible(rate_hz: float) -> bool:
    return PLAUSIBLE_HZ[0] <= rate_hz <= PLAUSIBLE_HZ[1]


def _ask_unit(path: Path, name: str, in_seconds_hz: float) -> None:
    rates = {unit: in_seconds_hz / scale for unit, scale in SECONDS.items()}
    likely = [unit for unit, rate in rates.items() if _plausible(rate)]
    told = " or ".join(f"--time-unit {unit} ({rates[unit]:.6g} Hz)" for unit in likely)
    raise UsageError(
        f"{path}: column '{name}' says no unit, and in seconds its steps would be {in_seconds_hz:.4g} Hz. "
        f"Say what it counts: {told or '--time-unit s, ms, us or ns'}."
    )


def told_by_times(
    path: Path, name: str, unit: TimeUnit | None, spool: Spool, rate_hz: float
) -> tuple[float | None, str]:
    """Where the rate is given: the step in the column's unit that numbers the rows, and what has to be told.

    None: the rows number themselves.
    """
    if spool.length("time") < 2:
        return None, ""
    steps = steps_of(spool)
    if not steps.even or steps.least <= 0:
        why = "runs backwards or stands still" if steps.least <= 0 else "has steps too uneven for a clock"
        return None, (
            f"{path}: column '{name}' {why}, so it cannot tell which samples are missing: with --rate "
            f"{rate_hz:g} all rows count as evenly spaced."
        )
    found = [1 / (steps.typical * SECONDS[u]) for u in ([unit] if unit else SECONDS)]
    nearest = min(found, key=lambda rate: abs(math.log(rate / rate_hz)))
    if abs(nearest / rate_hz - 1) > ALIKE:
        return steps.typical, (
            f"{path}: by its column '{name}' the rate is {nearest:.6g} Hz; --rate {rate_hz:g} is used, and "
            "the column tells only which samples are missing."
        )
    return steps.typical, ""


def _steps(spool: Spool) -> Iterator[NDArray[np.float64]]:
    last: list[float] = []
    for (times,) in spool.blocks(["time"], AT_ONCE):
        steps = np.diff(times, prepend=last)
        last = [float(times[-1])]
        if len(steps):
            yield steps


def _even_share(spool: Spool, median: float, tolerance: float) -> tuple[float, float]:
    """How many steps are near the median or, as short gaps are, a multiple; and the mean of the former."""
    count = even = near = 0
    total = 0.0
    for steps in _steps(spool):
        single = steps[np.abs(steps - median) <= tolerance]
        count, even, near = count + len(steps), even + len(single), near + len(single)
        total += float(single.sum())
        for times in SHORT_GAPS if tolerance < median / 2 else ():
            even += int((np.abs(steps - times * median) <= tolerance).sum())
    return even / count, total / near if near else 0.0


def _grain(spool: Spool) -> float:
    """The coarsest on which all times are; infinite if there is none."""
    for grain in GRAINS:
        if all(
            bool((np.abs(times / grain - np.rint(times / grain)) < NEARLY).all())
            for (times,) in spool.blocks(["time"], AT_ONCE)
        ):
            return grain
    return math.inf
