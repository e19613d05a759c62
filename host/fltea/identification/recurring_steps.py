"""Steps of a bias that come again: what they are worth for the samples to come (pure).

A step is taken out of the spectrum, but where some have come more will. Between two levels the bias is a
telegraph signal, whose spectrum is that of a relaxation (Machlup, J. Appl. Phys. 25, 1954); other steps sum
up as those of a walk do.
"""

import math
from collections.abc import Sequence

from fltea.identification.event_checks import popcorn_noise
from fltea.identification.forecast_judge import Learned
from fltea.identification.sensor_events import BiasStep
from fltea.noise.system import System

FEWEST = 3
"""Steps, from which on more are expected."""
CLEAR = 3.0
"""Deviations from which on a step counts."""


def with_steps(tracked: Learned, steps: Sequence[BiasStep], h: float) -> Learned:
    """Return the tracked system of an axis with the steps that its bias will go on to make.

    h: sampling period in s.
    """
    steps = [one for one in steps if abs(one.size) > CLEAR * one.size_std]
    if len(steps) < FEWEST:
        return tracked
    popcorn = popcorn_noise(steps)
    if popcorn is None:
        system = _walking(tracked.system, math.fsum(one.size**2 for one in steps) / tracked.samples)
    else:
        apart, every_s = popcorn
        # Levels ± apart / 2, each left at a rate of 1 / every_s: twice that is how fast it forgets.
        system = tracked.system.with_relaxation((apart / 2) ** 2, math.exp(-2 * h / every_s))
    return tracked._replace(system=system, steps_recur=True)


def _walking(system: System, q: float) -> System:
    """Return the same with an offset that walks by steps of this variance, too."""
    offsets = (system.a == 1.0).nonzero()[0]
    if not len(offsets):
        return system
    Q = system.Q.copy()
    Q[offsets[-1], offsets[-1]] += q
    return system._replace(Q=Q)
