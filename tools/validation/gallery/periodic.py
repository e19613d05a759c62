"""Periodic additions to a noise: glitches at equal intervals, and hum whose frequency varies."""

import math
from typing import NamedTuple

import numpy as np
from fltea.records.arrays import Array
from fltea.records.fit import VerdictKind
from scipy.signal import lfilter

FEWEST_SAMPLES, FEWEST_PERIODS, SURELY_ALIKE = 10, 10, 8.0
"""A comb of spectral lines has to be found if three conditions hold.

A period has at least FEWEST_SAMPLES samples. A record has more than FEWEST_PERIODS periods. The correlation
of the record with itself one period later is more than SURELY_ALIKE standard deviations.
"""
FAR, FEW_ORDINATES, MANY_ORDINATES = 5.0, 10.0, 100.0
"""Limits for a sine of varying frequency, on which "resonance" is the right verdict.

The aliased frequency is far from 0 if it is more than FAR of its standard deviations. If the periodogram has
enough frequencies (ordinates) within one standard deviation, no other verdict is accepted. Far from 0, more
than FEW_ORDINATES are enough. Near 0, more than MANY_ORDINATES are.
"""


class Glitches(NamedTuple):
    """A disturbance that is added to a few samples of each period.

    A period need not be a whole number of samples.

    `late`: each disturbance is early or late by up to this number of samples.
    """

    period_s: float
    size: float
    samples: int = 1
    late: int = 0

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """Return `n` samples, which begin at a random phase."""
        period = self.period_s * rate_hz
        at = np.floor(np.arange(rng.uniform(0, period), n, period)).astype(int)
        at += rng.integers(-self.late, self.late + 1, len(at))
        y = np.zeros(n)
        for i in range(self.samples):
            y[at[(at + i >= 0) & (at + i < n)] + i] += self.size
        return y


class WanderingLine(NamedTuple):
    """A sine whose frequency is a first-order Gauss-Markov process with the mean `hz`."""

    hz: float
    amplitude: float
    spread_hz: float
    tau_s: float

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """Return `n` samples, which begin at a random phase."""
        pole = math.exp(-1 / (rate_hz * self.tau_s))
        steps = self.spread_hz * math.sqrt(1 - pole**2) * rng.standard_normal(n)
        start = [pole * self.spread_hz * rng.standard_normal()]
        frequency, _ = lfilter([1.0], [1.0, -pole], steps, zi=start)
        phase = 2 * math.pi * (rng.uniform() + np.cumsum(self.hz + frequency) / rate_hz)
        return np.asarray(self.amplitude * np.sin(phase))


Said = tuple[set[VerdictKind], dict[VerdictKind, str]]
"""The verdicts that are right, and the verdicts that are accepted, each with its reason."""


def right_periodic(one: Glitches | WanderingLine, rate_hz: float, n: int) -> Said:
    """Return the right and the accepted verdicts on white noise of variance 1 to which `one` is added."""
    return _glitches(one, rate_hz, n) if isinstance(one, Glitches) else _wandering(one, rate_hz, n)


def _glitches(one: Glitches, rate_hz: float, n: int) -> Said:
    period = one.period_s * rate_hz
    if period < FEWEST_SAMPLES:
        why = f"{period:.3g} samples in a period: the comb has few lines"
        kinds: list[VerdictKind] = ["line or resonance", "white", "undecided", "resonance"]
        if 2 * one.late + one.samples >= period:
            kinds += ["low-pass", "anti-persistent"]
            why = "late by up to a period: the glitches are noise"
        return {"comb", "line"}, dict.fromkeys(kinds, why)
    share = one.samples * one.size**2 / (period + one.samples * one.size**2)
    alike = share * math.sqrt(n / (one.late * 2 + 1 + (period % 1 > 0)))
    if n / period > FEWEST_PERIODS and alike > SURELY_ALIKE:
        return {"comb"}, {}
    why = f"{n / period:.3g} periods, which are alike by {alike:.2g} standard deviations"
    return {"comb"}, {"line": why, "line or resonance": why, "white": why, "undecided": why}


def _wandering(one: WanderingLine, rate_hz: float, n: int) -> Said:
    wide = one.spread_hz * n / rate_hz
    away = one.hz % rate_hz
    if min(away, rate_hz - away) > FAR * one.spread_hz:
        if wide > FEW_ORDINATES:
            return {"resonance"}, {}
        why = f"the line is {wide:.2g} ordinates wide"
        return {"resonance"}, {"line": why, "line or resonance": why}
    if wide > MANY_ORDINATES:
        return {"resonance"}, {}
    why = f"about frequency 0 the line is {wide:.2g} ordinates wide: relaxations look the same"
    alike: list[VerdictKind] = ["low-pass", "drift", "relaxations", "fractional or relaxations"]
    alike += ["white", "undecided"]
    return {"resonance"}, dict.fromkeys(alike, why)
