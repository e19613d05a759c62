"""Measure what the daemon's live fit gives for noises that change while they are measured.

The expected results are: with a fading memory, the fit is right again when three time constants of the memory
have passed since the change. Without fading, the verdict is "not stationary". The samples of a knock on the
sensor are left out. A slow drift of the offset changes nothing.
"""

from collections import Counter
from typing import NamedTuple

import numpy as np
from fltea.records.arrays import Array
from fltea.settings.live import LiveConfig
from fltea.spectrum.live_axes import LiveAxes

from tools.validation.evaluate import cases
from tools.validation.evaluate.cases import POWER, Case, H
from tools.validation.runner import Row

CONSTANT = 10_000
"""Time constant with which the live fit's memory fades [samples]."""
BEFORE, AFTER = 30_000, 3 * CONSTANT
"""Numbers of samples before and after the change of the noise."""
BLOCK = 1_000
"""Number of samples that are passed to the fit in one call."""
KNOCK_SAMPLES, KNOCK_SIGMAS = 80, 60.0
DRIFT_SIGMAS, DRIFT_S = 20.0, 200.0
"""DRIFT_SIGMAS, DRIFT_S: for the change "temperature drifts", the size of the change of the offset [standard
deviations of the noise], and the time constant of its exponential course [s].
"""


class Shift(NamedTuple):
    """A noise, and the change that happens in the middle of the run."""

    name: str
    before: Case
    after: Case
    gain: float = 1.0
    """Factor by which the change multiplies the noise's power."""
    knock: bool = False
    drift: bool = False
    stationary: bool = False
    """Whether the noise itself stays the same. The change then only adds a disturbance, or nothing."""


SHIFTS: tuple[Shift, ...] = (
    Shift("none", Case(0.8, -1.0, 3.0), Case(0.8, -1.0, 3.0), stationary=True),
    Shift("α from 0.4 to 0.8", Case(0.4, -1.0, 3.0), Case(0.8, -1.0, 3.0)),
    Shift("power doubled", Case(0.8, -1.0, 3.0), Case(0.8, -1.0, 3.0), gain=2.0),
    Shift("knocked", Case(0.8, -1.0, 3.0), Case(0.8, -1.0, 3.0), knock=True, stationary=True),
    Shift("temperature drifts", Case(0.8, -1.0, 3.0), Case(0.8, -1.0, 3.0), drift=True, stationary=True),
)


def samples(shift: Shift, seeds: int) -> Array:
    """Draw y for all seeds, as an array (BEFORE + AFTER, seeds)."""
    y = np.concatenate(
        [
            cases.samples(shift.before, seeds, BEFORE, record=2),
            np.sqrt(shift.gain) * cases.samples(shift.after, seeds, AFTER, record=3),
        ]
    )
    sigma = np.sqrt(POWER)
    if shift.knock:
        t = np.arange(KNOCK_SAMPLES)
        ringing = KNOCK_SIGMAS * sigma * np.exp(-t / 20) * np.cos(2 * np.pi * 0.2 * t)
        y[BEFORE : BEFORE + KNOCK_SAMPLES] += ringing[:, np.newaxis]
    if shift.drift:
        y += (DRIFT_SIGMAS * sigma * -np.expm1(-np.arange(len(y)) * H / DRIFT_S))[:, np.newaxis]
    return y


def score_shift(shift: Shift, seeds: int) -> list[Row]:
    """Return the scores of the live fit at the end of the series, with and without a fading memory."""
    y = samples(shift, seeds)
    return [_score(shift, y, memory) for memory in (None, CONSTANT * H)]


def _score(shift: Shift, y: Array, memory_s: float | None) -> Row:
    axes = tuple(f"series {i}" for i in range(y.shape[1]))
    settings = LiveConfig(memory=None if memory_s is None else f"{memory_s:g}s")
    live = LiveAxes(axes, H, settings, "deg/s")
    for begin in range(0, len(y), BLOCK):
        live.add(y[begin : begin + BLOCK])
    found = list(live.fit(curves=False).values())
    truth = shift.after.alpha or 0.0
    errors = [abs(one.alpha.value - truth) for one in found if one.alpha.value is not None]
    ends = [(one.alpha.low, one.alpha.high) for one in found]
    causes = Counter(cause for one in found for cause, count in one.left_out.items() if count)
    return {
        "kind": "shifts",
        "change": shift.name,
        "memory_s": memory_s,
        "series": len(found),
        # number of 95 % intervals that contain the α after the change, and the error of α
        "holds": sum(low is not None and high is not None and low <= truth <= high for low, high in ends),
        "median_error": round(float(np.median(errors)), 6) if errors else None,
        "verdicts": dict(sorted(Counter(str(one.verdict) for one in found).items())),
        # for each cause of leaving out samples: number of series in which samples were left out
        "left_out": dict(sorted(causes.items())),
    }
