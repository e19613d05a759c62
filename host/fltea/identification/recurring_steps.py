"""Add steps of the bias to the noise model for future samples, if several steps were found.

Steps are left out of the spectrum. But if several occurred, more will follow. A bias that jumps between two
levels is a telegraph signal, which has the spectrum of a relaxation (a first-order Gauss-Markov process;
Machlup, J. Appl. Phys. 25, 1954). Other steps add up to a random walk.
"""

import math
from collections.abc import Sequence

from fltea.identification.event_checks import popcorn_noise
from fltea.identification.forecast_judge import FittedSystem
from fltea.identification.sensor_events import BiasStep
from fltea.noise.linear_system import System

FEWEST = 3
"""Further steps are expected if at least this many steps were found."""
CLEAR = 3.0
"""A step counts if its size is at least this many times its standard deviation."""


def with_steps(tracked: FittedSystem, steps: Sequence[BiasStep], h: float) -> FittedSystem:
    """Return the tracked system (state-space model) of an axis, with the steps to expect of its bias."""
    steps = [one for one in steps if abs(one.size) > CLEAR * one.size_std]
    if len(steps) < FEWEST:
        return tracked
    popcorn = popcorn_noise(steps)
    if popcorn is None:
        system = _walking(tracked.system, math.fsum(one.size**2 for one in steps) / tracked.samples)
    else:
        apart, every_s = popcorn
        # The levels are apart / 2 above and below their mean. The bias changes from either level to the other
        # at the rate 1 / every_s, so its correlation decays at twice this rate.
        system = tracked.system.with_relaxation((apart / 2) ** 2, math.exp(-2 * h / every_s))
    return tracked._replace(system=system, steps_recur=True)


def _walking(system: System, q: float) -> System:
    """Return the state-space model with the variance `q` per sample added to its offset's random walk."""
    offsets = (system.a == 1.0).nonzero()[0]
    if not len(offsets):
        return system
    Q = system.Q.copy()
    Q[offsets[-1], offsets[-1]] += q
    return system._replace(Q=Q)
