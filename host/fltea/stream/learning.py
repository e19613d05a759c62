"""What the tracker of an axis is to go by: made of what the live fit has found, where the look is made.

It is made of the samples that the tracker remembered when the look began. So the samples that come meanwhile
wait for nothing, and nothing depends on how long it takes.
"""

from typing import NamedTuple

from msgspec.structs import replace as with_fields

from fltea.estimator.offset_walk import CONSTANT, Rivals, system_of
from fltea.estimator.tracker import Remembered, TrackerModel, TrackerRules
from fltea.noise.heading import heading_std, heading_stds, rested
from fltea.noise.left_open import distance
from fltea.noise.parts import Part
from fltea.noise.system import System, system
from fltea.records.arrays import Array
from fltea.records.fit import Interval
from fltea.records.records import GYRO_UNIT
from fltea.spectrum.live_axes import Noise
from fltea.spectrum.wording import names

ENOUGH = 3000
"""Samples: a fit of fewer knows too little of what is slow, and the bank of walks goes on."""
FEWEST, LIKELIER = 300, 30.0
"""Samples, from which on a fit counts that makes them so much likelier than the bank does, in 2 log L."""
AHEAD_S = 1, 10, 60, 600, 3600
GROWTH, APART = 1.5, 0.5
"""A filter is made again for a record that is so much longer, or for a noise so much likelier, by log L."""
EVERY = 2
"""Of so many values of what the offset may do one is tried: the bias is as good, in a fifth of the time."""
DIGITS = 3
"""Of the figures of a fit: the last ones differ between a run and its replay."""


class Learned(NamedTuple):
    """A noise, and what follows for its filter."""

    noise: Noise
    model: str
    """The names of its parts."""
    tracker_model: TrackerModel
    """What the tracker goes by."""
    system: System
    """The mean of all that the offset may do."""
    K: Interval
    """How the offset walks, as of `OffsetWalk`."""
    at_rest: Array
    """Covariance of x after a rest as long as the fit's record, (n, n)."""
    h: float
    headings: dict[int, float]
    """The deviation of the heading so many seconds after it; empty for what is no rate."""

    def heading_std(self, t_s: float) -> float:
        """Return the deviation of the integral t_s after the rest."""
        return heading_std(self.system, self.at_rest, self.h, t_s)


class Learner(NamedTuple):
    """Learns what the tracker of one axis is to go by; in any thread."""

    remembered: Remembered
    rules: TrackerRules
    h: float
    unit: str
    knows_offset: bool
    """Whether the settings give it."""

    def learned(self, noise: Noise | None, before: Learned | None) -> Learned | None:
        """Return what to go by from now on: `before` unless something is new, sure enough, and possible."""
        if noise is None or noise.samples < FEWEST:
            return before
        if before is not None and _says_the_same(noise, before.noise, self.h):
            return before
        parts, n = tuple(_rounded(part) for part in noise.parts), noise.samples
        try:
            if self.knows_offset:
                found, walk = system(parts, self.h, n, found=True), CONSTANT
                rivals = Rivals(found)
            else:
                found, walk, _, rivals = system_of(parts, self.h, n, self.remembered, every=EVERY)
            if before is None and n < ENOUGH:
                of_walks = self.remembered.likelihood_of_walks()
                if not self.remembered.likelihood(found) - of_walks > LIKELIER:
                    return None
            tracker_model = TrackerModel(self.rules, *rivals)
            P = rested(found, n)
            stds = heading_stds(found, P, self.h, AHEAD_S) if self.unit == GYRO_UNIT else ()
        except (ValueError, ArithmeticError):  # at the edge of what is stationary: the last one goes on
            return before
        model = names(map(type, noise.parts))
        headings = dict(zip(AHEAD_S, stds, strict=False))
        K = Interval() if walk.is_found else walk.K(self.h)
        return Learned(noise, model, tracker_model, found, K, P, self.h, headings)


def _says_the_same(noise: Noise, before: Noise, h: float) -> bool:
    """Return whether so little is new that the filter is not made again."""
    if noise.samples > GROWTH * before.samples or noise.drifts != before.drifts:
        return False
    if [type(part) for part in noise.parts] != [type(part) for part in before.parts]:
        return False
    return distance(noise.parts, before.parts, h, noise.samples) < APART


def _rounded(part: Part) -> Part:
    figures = ((name, getattr(part, name)) for name in part.__struct_fields__)
    # A number of samples stays a whole one.
    rounded = {name: x if isinstance(x, int) else float(f"{x:.{DIGITS}g}") for name, x in figures}
    return with_fields(part, **rounded)
