"""Describe steps of the bias and motion of the sensor in words, with a remedy for each."""

from collections.abc import Sequence

import numpy as np

from fltea.identification.data_checks import DataCheck, Severity
from fltea.identification.sensor_events import AxisEvents, BiasStep, MotionSpan
from fltea.sinks.changes import step_words
from fltea.sinks.words import figure
from fltea.spectrum.wording import listed

EVENT_CHECKS = MOTION, STEPS = "motion", "bias steps"
"""The kinds of data checks that this module makes."""
MOST_TOLD = 3
POPCORN = 6
"""A test for popcorn noise (a bias that jumps between two levels) is made if there are at least this many
steps.
"""
ALTERNATE = 0.9
"""In popcorn noise, at least this proportion of the steps goes in the direction opposite to the previous
step.
"""
AGREE = 5.0
"""Steps of popcorn noise have nearly equal sizes. The difference of each step's size from the median size is
divided by the σ of that size. The mean square of these ratios must be at most this.

If all sizes were equal, it would be about 1. The limit is higher, since the σ of a step is too small if steps
follow each other quickly.
"""


def event_checks(events: AxisEvents, unit: str, *, is_left_out: bool = True) -> tuple[DataCheck, ...]:
    """Return the data checks for the steps and the motion of an axis, with sizes in `unit`.

    `is_left_out`: whether the spectrum leaves out the samples in motion and breaks at the steps. False if too
    few samples would remain.
    """
    found = []
    if events.motion:
        then = "All figures leave it out." if is_left_out else "All figures include it."
        remedy = "Make the recording at rest: noise slower than the pauses between motions cannot be seen."
        severity: Severity = "warning" if is_left_out else "bad"
        found.append(DataCheck(MOTION, severity, f"The sensor moved {_moved(events.motion)}. {then}", remedy))
    if events.steps:
        then = (
            "The spectrum is that of the samples between steps."
            if is_left_out
            else "All figures include the steps: there are too few samples between them."
        )
        remedy = (
            "Was the sensor knocked, or did its supply or temperature change? If not, the steps come from "
            "the sensor itself."
        )
        found.append(DataCheck(STEPS, "warning", f"{_stepped(events.steps, unit)} {then}", remedy))
    return tuple(found)


def _stepped(steps: Sequence[BiasStep], unit: str) -> str:
    told = [step_words(one.size, one.size_std, unit, f"{one.at_s:.1f} s") for one in steps[:MOST_TOLD]]
    if len(steps) > MOST_TOLD:
        told.append(f"{len(steps) - MOST_TOLD} more")
    text = f"Bias: {listed(told)}."
    popcorn = popcorn_noise(steps)
    if popcorn is None:
        return text
    apart, every_s = popcorn
    return (
        f"Popcorn noise: the bias steps between two levels {apart:.2g} {unit} apart, every {every_s:.2g} s "
        f"or so. {text}"
    )


def popcorn_noise(steps: Sequence[BiasStep]) -> tuple[float, float] | None:
    """Return two figures of popcorn noise from the steps of a bias; None if the steps are not popcorn noise.

    The figures are the distance between the two levels and the mean time between steps [s].

    Steps of popcorn noise go up and down alternately, and their sizes agree within their σ.
    """
    if len(steps) < POPCORN:
        return None
    size, std, at_s = np.array([(one.size, one.size_std, one.at_s) for one in steps]).T
    alternate = float(np.mean(np.sign(size[1:]) != np.sign(size[:-1])))
    apart = float(np.median(np.abs(size)))
    off = float((((np.abs(size) - apart) / std) ** 2).mean())
    if alternate < ALTERNATE or off > AGREE:
        return None
    return apart, float(np.ptp(at_s)) / (len(steps) - 1)


def _moved(motion: Sequence[MotionSpan]) -> str:
    told = [f"from {one.begin_s:.0f} to {one.end_s:.0f} s ({_shown(one)})" for one in motion[:MOST_TOLD]]
    if len(motion) > MOST_TOLD:
        told.append(f"{len(motion) - MOST_TOLD} times more")
    return listed(told)


def _shown(one: MotionSpan) -> str:
    # No size is shown for the accelerometer, which does not measure how far the sensor turned.
    if one.largest is None or one.by == "accel":
        return f"shown by {one.by}"
    return f"shown by {one.by}, at most {figure(one.largest, 3, significant=True)} {one.unit}"
