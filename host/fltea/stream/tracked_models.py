"""Make the model for the tracker of an axis from a live fit, in the thread that makes the fit.

The model is made with the samples that the tracker remembered when the refit began. Later samples therefore
do not wait for the model, and the model does not depend on how long the computation takes.
"""

from typing import NamedTuple

from msgspec.structs import replace as with_fields

from fltea.estimator.offset_walk import CONSTANT, Rivals, system_of
from fltea.estimator.tracker import Remembered, TrackerModel, TrackerRules
from fltea.noise.heading import heading_std, heading_stds, rested
from fltea.noise.left_open import distance
from fltea.noise.linear_system import System
from fltea.noise.parts import Part
from fltea.noise.system import system
from fltea.records.arrays import Array
from fltea.records.fit import Interval
from fltea.records.records import GYRO_UNIT
from fltea.spectrum.live_axes import Noise
from fltea.spectrum.wording import names

ENOUGH = 3000
"""The tracker begins with a bank: filters that run side by side, each for a random walk of another size. If a
fit has at least this number of samples, its noise model replaces the bank. A fit of fewer samples shows too
little of slow noise.
"""
FEWEST, LIKELIER = 300, 30.0
"""The tracker begins with a bank of random-walk models. A fit of fewer than `FEWEST` samples never replaces
the bank. A fit of fewer than `ENOUGH` samples replaces it only if its noise model is far likelier: with that
model, 2 log L (twice the log likelihood) is higher by more than `LIKELIER` than with the bank.
"""
AHEAD_S = 1, 10, 60, 600, 3600
GROWTH, APART = 1.5, 0.5
"""After a fit, the tracker gets a new filter in any of these cases. The record has grown by more than the
factor `GROWTH`. The noise model has other parts than before, or drift has come or gone. Or the old noise
model describes the new noise badly: its expected log likelihood is lower by at least `APART`.
"""
EVERY = 2
"""The drift of the sensor's offset is searched on a grid of step variances, correlation times and slopes.
Of each, only every second value (`EVERY`) is tried. That takes a fifth of the time, and the bias is as
accurate as with all values.
"""
DIGITS = 3
"""Number of significant digits to which the figures of a fit are rounded, since further digits may differ
between a run and its replay.
"""


class TrackedModel(NamedTuple):
    """A noise model of an axis, and the tracker model that follows from it."""

    noise: Noise
    model: str
    """Names of the noise model's parts."""
    tracker_model: TrackerModel
    """The noise model in the form that the tracker uses."""
    system: System
    """State-space system of the noise model, with the drift of the sensor's offset. The samples allow several
    drifts; the system has their weighted mean.
    """
    K: Interval
    """Rate random walk K of the sensor's offset, with its interval. Empty if the offset may be constant, or
    if the fitted noise model already has the random walk as a part.
    """
    at_rest: Array
    """Covariance (n, n) of the n states of `system`, at the end of a rest as long as the fitted record."""
    h: float
    headings: dict[int, float]
    """Standard deviation of the heading error, by the number of seconds after the sensor's rest has ended.
    Empty for a sensor other than a gyroscope.
    """

    def heading_std(self, t_s: float) -> float:
        """Return the standard deviation of the heading error `t_s` seconds after the end of a rest.

        For a sensor other than a gyroscope, the result is the standard deviation of the error of the
        integrated samples.
        """
        return heading_std(self.system, self.at_rest, self.h, t_s)


class TrackedModelMaker(NamedTuple):
    """Makes the tracker model of one axis; may run in any thread."""

    remembered: Remembered
    rules: TrackerRules
    h: float
    unit: str
    knows_offset: bool
    """Whether the user has given the sensor's offset in the settings."""

    def tracked_model(self, noise: Noise | None, before: TrackedModel | None) -> TrackedModel | None:
        """Return the tracker model to use from now on; None for the bank with which a tracker begins.

        `noise`: noise model of the newest fit. `before`: the tracker model in use, which is returned if the
        noise has hardly changed, if the fit has too few samples, or if no filter can be made for the new
        noise.
        """
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
        # no filter can be made for a new model that is at the edge of stationarity, so the previous model
        # stays in use
        except (ValueError, ArithmeticError):
            return before
        model = names(map(type, noise.parts))
        headings = dict(zip(AHEAD_S, stds, strict=False))
        K = Interval() if walk.is_found else walk.K(self.h)
        return TrackedModel(noise, model, tracker_model, found, K, P, self.h, headings)


def _says_the_same(noise: Noise, before: Noise, h: float) -> bool:
    """Return whether the noise model of the tracker, `before`, also describes the new noise well enough."""
    if noise.samples > GROWTH * before.samples or noise.drifts != before.drifts:
        return False
    if [type(part) for part in noise.parts] != [type(part) for part in before.parts]:
        return False
    return distance(noise.parts, before.parts, h, noise.samples) < APART


def _rounded(part: Part) -> Part:
    figures = ((name, getattr(part, name)) for name in part.__struct_fields__)
    # A parameter of a noise part that is an integer, such as the length of a mean, is not rounded.
    rounded = {name: x if isinstance(x, int) else float(f"{x:.{DIGITS}g}") for name, x in figures}
    return with_fields(part, **rounded)
