"""Weight the possible drifts of an offset by likelihood: random walks, slow relaxations and slopes.

The fit of the spectrum leaves out noise whose period is longer than a tenth of the record. A Kalman filter
uses such noise as well. So for each possible drift, a Kalman filter computes the likelihood of all samples,
and the drift is weighted by it. The possible drifts are:

- none: the offset is constant
- a random walk, with step variances from hardly visible to obvious in a record of n samples
- a bounded walk: a relaxation (first-order Gauss-Markov process), which does not wander off without limit
- each of these with a slope in addition

A random walk that the fit of the spectrum has found may really be a bounded walk. The likelihood shows this
in a much shorter record than the spectrum does.
"""

import functools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from fltea import _native
from fltea.estimator.tracker import Remembered
from fltea.noise.heading import rested
from fltea.noise.linear_system import Coordinate, System, offset_of, ramp_of, relaxation_of
from fltea.noise.parts import Part, Relaxation, Walk
from fltea.noise.system import system
from fltea.records.arrays import Array, Mask
from fltea.records.fit import Interval

SHARES = tuple(10.0 ** (k / 2) for k in range(1, 10))
"""Step variances that a random walk of the offset may have, if the fit of the spectrum has found no walk.

The unit is the spectrum at `LEVEL_AT`, divided by the square of the number of samples.
"""
AROUND = tuple(10.0 ** (k / 4) for k in range(-2, 3))
"""Step variances that the random walk of the offset may have, if the fit of the spectrum has found a walk.
The unit is the step variance that the fit has found.
"""
BOUNDS = tuple(2.0**k / (20 * math.pi) for k in range(7))
"""Correlation times that a bounded walk of the offset may have, as ratios to the record's length. Even the
shortest is too long for the spectrum to show.
"""
BOUNDS_FOUND = tuple(one / 4 for one in BOUNDS[:2]) + BOUNDS
"""`BOUNDS` and two shorter times, which are used if the fit of the spectrum has found a random walk: this
walk may really be bounded.
"""
SLOW = BOUNDS_FOUND[1]
"""A relaxation may be confused with a random walk if its correlation time is at least this ratio times the
record's length.
"""
RISES = 1.0, 10.0, 100.0, 1000.0
"""Prior standard deviations that the slope of the offset may have. The unit is the error of the slope of a
straight line that is fitted to as many samples of white noise.
"""
STAYS, ENDLESS, RAMPS = 0.6, 0.5, 0.25
"""Prior probabilities. STAYS: an offset does not walk. ENDLESS: the walk of an offset that walks is a random
walk, not a bounded one. RAMPS: an offset has a slope.
"""
CERTAIN = 0.95
LEAST = 0.05
"""Least weight with which a bounded walk or a slope of the offset gets a state in the filter, and with which
a random walk of the offset counts as part of the noise. The weight of a walk is its posterior probability;
for that of a slope, see `OffsetWalk._with_slope`.
"""
LEAST_RIVAL = 0.02
"""Two noise models are kept, one with an offset that walks and one with a constant offset, if each is more
probable than this. Later samples decide between the two.
"""
MOST_OF_RIVALS = 6
"""The two models (`LEAST_RIVAL`) are kept only if the noise without the offset has at most this many states.
Noise with more states can look like a walk of the offset, so samples hardly decide between the models; and
two such models cost much time.
"""
LEVEL_AT = 1e-3
"""Low frequency at which the noise model's spectrum is read, as a unit for steps and slopes [rad/sample]."""


class OffsetRelaxation(NamedTuple):
    """The relaxation (first-order Gauss-Markov process) that a filter uses for all bounded walks."""

    variance: float
    a: float
    """Factor by which the relaxation decays from one sample to the next."""

    def part(self, h: float) -> Relaxation:
        """Return this relaxation as one part (component) of a noise model; `h`: sampling period [s]."""
        return Relaxation(math.sqrt(self.variance), -h / math.log(self.a))


class OffsetWalk(NamedTuple):
    """All drifts that an offset may have, each with its posterior probability as weight.

    Entry i of each array belongs to drift i.
    """

    steps: Array
    """Variance of a step of the walk; 0 if the offset does not walk."""
    taus: Array
    """Correlation time of the walk in samples; infinite for an unbounded walk."""
    slopes: Array
    """Prior standard deviation of the offset's slope, per sample; 0 if the drift has no slope."""
    weights: Array
    is_found: bool = False
    """Whether the fit of the spectrum has found a walk of the offset, or a slow relaxation that may be such a
    walk.
    """
    likelihood: float = -math.inf
    """2 log L of the samples, with the likelihood averaged over all possible drifts."""

    @property
    def is_certain(self) -> bool:
        """Whether the weights of the drifts say that the offset almost certainly walks."""
        return float(self.weights[self.steps == 0].sum()) < 1 - CERTAIN

    def K(self, h: float) -> Interval:
        """Return the rate random walk K [unit of the samples per √s]; empty if the offset may be constant.

        K is the weighted median over the drifts with a walk, and its interval holds 95 % of their weight. The
        filter uses the mean of their step variances instead. As a figure of a sensor that mean is too large.
        """
        if not self.is_certain:
            return Interval()
        steps, at = np.unique(self.steps, return_inverse=True)
        walks = np.bincount(at, self.weights)[steps > 0]
        walks, steps = walks / walks.sum(), steps[steps > 0]
        log_steps = np.interp([0.5, 0.025, 0.975], np.cumsum(walks) - walks / 2, np.log(steps))
        return Interval(*(math.sqrt(q / h) for q in np.exp(log_steps).tolist()))

    def system(self, bare: System, samples: int) -> System:
        """Return the state-space model of a noise with a single drift, the weighted mean of all drifts.

        `bare`: state-space model of the noise without an offset.

        If one of several drifts is true, the best linear filter (least mean square error) is that for the
        weighted mean of their spectra. All bounded walks are replaced by one relaxation, which has the mean
        of their variances and of their step variances.
        """
        found, relaxation = bare, self.relaxation
        if relaxation is not None:
            found = found.with_relaxation(*relaxation)
        endless = float(self.weights[~self._bounded & (self.steps > 0)].sum()) > LEAST
        found = found.with_offset(self.endless, of_state=self.is_certain and endless)
        return self._with_slope(found, samples)

    def rivals(self, bare: System, samples: int) -> "Rivals":
        """Return the two models of the noise between which later samples decide.

        The offset walks in one of them, and is constant in the other. The mean of both models would give too
        small a σ if the offset walks, and would adapt too slowly if the offset is constant.
        """
        stays = self.steps == 0
        likely = 1 - float(self.weights[stays].sum())
        if not LEAST_RIVAL < likely < 1 - LEAST_RIVAL or len(bare.a) > MOST_OF_RIVALS:
            return Rivals(self.system(bare, samples))
        walking = self._replace(weights=np.where(stays, 0.0, self.weights) / likely)
        system = walking.system(bare, samples)
        n, Q, P0 = len(bare.a), system.Q.copy(), system.P0.copy()
        # The state has first the n elements of `bare`, then that of the relaxation, if there is one. The
        # offset follows at the index `still`.
        still = np.flatnonzero(system.a[n:] == 1.0)[0] + n
        Q[n:, :] = Q[:, n:] = 0.0
        P0[n:still, :] = P0[:, n:still] = 0.0
        return Rivals(system, system._replace(Q=Q, P0=P0), likely)

    @property
    def endless(self) -> float:
        """Mean step variance of the unbounded walks."""
        return float((self.weights * self.steps)[~self._bounded].sum())

    @property
    def relaxation(self) -> OffsetRelaxation | None:
        """One relaxation for all bounded walks, with mean variances; None if bounded walks are unlikely."""
        bounded = self._bounded
        powers = (self.weights * self.steps)[bounded]
        if (q := float(powers.sum())) <= 0:
            return None
        variance = float((powers / -np.expm1(-2 / self.taus[bounded])).sum())
        return OffsetRelaxation(variance, math.sqrt(1 - q / variance))

    @property
    def by_walk(self) -> tuple[Array, Array, Array, Array]:
        """Return the drifts as a table with a row for each walk and a column for each slope.

        The four arrays are: the step variances of the walks, (rows,); the correlation times of the walks,
        (rows,); the standard deviations of the slopes, (columns,); and the weights, (rows, columns).
        """
        count = int((np.diff(self.slopes) <= 0).argmax()) + 1 if len(self.slopes) > 1 else 1
        steps, taus = (one[::count] for one in (self.steps, self.taus))
        return steps, taus, self.slopes[:count], self.weights.reshape(-1, count)

    @property
    def _bounded(self) -> Mask:
        """Mask of the drifts with a bounded walk; all False if their total weight is less than `LEAST`."""
        bounded = np.isfinite(self.taus)
        return bounded if float(self.weights[bounded].sum()) >= LEAST else np.zeros_like(bounded)

    def likely(self, bare: System, samples: int, least: float) -> list[tuple[float, System]]:
        """Return weight and state-space model of each possible drift whose weight is at least `least`."""
        found = zip(self.weights, self.steps, self.taus, self.slopes, strict=True)
        return [(w, _one(bare, samples, q, tau, slope)) for w, q, tau, slope in found if w >= least]

    def _with_slope(self, found: System, samples: int) -> System:
        """Return the system with a slope of the offset, if a slope explains enough of the samples' trend.

        Let v be the error variance of the slope of a straight line that is fitted to the samples. A drift
        whose slope has the prior variance s² then explains the proportion p = s² / (s² + v) of the fitted
        slope's variance. The weight of the slope is the mean p of all drifts, weighted by their
        probabilities. The system gets one slope, whose prior variance gives this mean p.
        """
        most = float(self.slopes.max())
        if most == 0:
            return found
        wide = found.with_ramp(most, samples)
        left = min(float(rested(wide, samples)[-1, -1]) / float(wide.P0[-1, -1]), 1 - 1e-9)
        v = most**2 * left / (1 - left)
        share = min(float(self.weights @ (self.slopes**2 / (self.slopes**2 + v))), 1 - 1e-9)
        if share < LEAST:
            return found
        return found.with_ramp(min(math.sqrt(v * share / (1 - share)), most), samples)


class Rivals(NamedTuple):
    """One or two noise models of an axis; later samples decide between two.

    `likely`: probability that `system` is true; `rival` has the rest.
    """

    system: System
    rival: System | None = None
    likely: float = 1.0


CONSTANT = OffsetWalk(np.zeros(1), np.full(1, np.inf), np.zeros(1), np.ones(1))


class Followed(NamedTuple):
    """The noise model from which a tracker's filter is made, with the possible drifts of the offset."""

    system: System
    walk: OffsetWalk
    parts: Sequence[Part]
    """The parts of the noise that the fit of the spectrum has found. The slowest relaxation may be replaced
    by a random walk.
    """
    rivals: "Rivals"
    """The model with an offset that walks and that with a constant offset; or one model alone, if one of the
    two is improbable (`LEAST_RIVAL`) or the noise has too many states (`MOST_OF_RIVALS`).
    """


def system_of(
    parts: Sequence[Part], h: float, samples: int, remembered: Remembered, *, every: int = 1
) -> Followed:
    """Return the noise model for a tracker, with the drift of the offset.

    Every model has an offset that may walk, even a model with noise of fractional order. We measured what
    this costs: nothing if the offset is really constant; and if the fit of the spectrum has missed slow
    noise, the bias becomes more accurate. A slow relaxation that the fit of the spectrum has found may really
    be a random walk. Both are tried, and the likelier one is returned.

    `samples`: number of samples of the fit. `remembered`: samples from which likelihoods are computed.
    `every`: to save time, only one in `every` step variances, correlation times and slopes is tried.
    """
    found = _followed(parts, h, samples, remembered, every)
    walking = _as_walk(parts, h, samples)
    if walking is None or found.walk is CONSTANT:
        return found
    other = _followed(walking, h, samples, remembered, every)
    # `found` has a fitted relaxation, whose correlation time is the best of all. `other` has a walk instead.
    # Its likelihood is a mean over several correlation times, most of which fit badly. So it is too small, by
    # a factor of up to their number. Adding the logarithm of that number makes the comparison fair.
    ahead = other.walk.likelihood - found.walk.likelihood + 2 * math.log(len(BOUNDS_FOUND))
    return other if other.walk is not CONSTANT and ahead > 0 else found


def _followed(parts: Sequence[Part], h: float, samples: int, remembered: Remembered, every: int) -> Followed:
    bare, found = without_walk(parts, h, samples)
    bounds = () if _has_order(parts) else BOUNDS_FOUND if found else BOUNDS
    walk = offset_walk(bare, samples, remembered, found=found, bounds=bounds, every=every)
    if walk is CONSTANT and found:
        only = system(parts, h, samples, found=True)
        return Followed(only, walk, parts, Rivals(only))
    return Followed(walk.system(bare, samples), walk, parts, walk.rivals(bare, samples))


def _as_walk(parts: Sequence[Part], h: float, samples: int) -> list[Part] | None:
    """Return the parts with a random walk in place of the slowest relaxation, or None.

    The result is None if no relaxation is slow enough.
    """
    slow = [part for part in parts if isinstance(part, Relaxation) and part.tau_s > SLOW * samples * h]
    if not slow or _has_order(parts) or any(isinstance(part, Walk) for part in parts):
        return None
    slowest = max(slow, key=lambda part: part.tau_s)
    walk = Walk(slowest.sigma * math.sqrt(2 / slowest.tau_s))
    return [walk if part is slowest else part for part in parts]


def _has_order(parts: Sequence[Part]) -> bool:
    return any(part.has("ordered") for part in parts)


def without_walk(parts: Sequence[Part], h: float, samples: int) -> tuple[System, float]:
    """Return the state-space model of all parts that are no random walks, and the walks' step variance."""
    bare = system([part for part in parts if not isinstance(part, Walk)], h, samples, found=True)
    return bare, math.fsum(part.K**2 * h for part in parts if isinstance(part, Walk))


def offset_walk(
    bare: System,
    samples: int,
    remembered: Remembered,
    *,
    found: float = 0.0,
    bounds: Sequence[float] = BOUNDS,
    every: int = 1,
) -> OffsetWalk:
    """Return all drifts that the offset may have, each with its posterior probability as weight.

    `bare`: state-space model of the noise without an offset. `samples`: number of samples in the record.
    `found`: step variance of the random walk that the fit of the spectrum has found; 0 if it has found none.
    `bounds`: correlation times that a bounded walk may have, as ratios to the length of the record.
    `every`: to save time, only one in `every` step variances, correlation times and slopes is tried.
    """
    level = float(bare.spectrum(np.array([LEVEL_AT]))[0])
    steps = [share * found for share in AROUND] if found else [one * level / samples**2 for one in SHARES]
    line = math.sqrt(12 * level / samples**3)
    steps = steps[::every]
    # The filter needs three additional states: for the offset, its relaxation and its slope.
    has_room = len(bare.a) + 3 <= _native.TRACKER_COORDINATES
    slopes = [line * one for one in RISES[::every]] if has_room else []
    taus = [samples * one for one in bounds[::every]] if has_room else []
    tried = [
        (q, tau, slope, walks * slants)
        for q, tau, walks in walks_tried(steps, taus, 0.0 if found else STAYS)
        for slope, slants in _parted(0.0, slopes, 1 - RAMPS)
    ]
    power = bare.power
    likely = np.array(remembered.likelihoods(bare, [_offset(power, samples, *one) for *one, _ in tried]))
    if not np.isfinite(likely).all():
        return CONSTANT
    q, tau, slope, prior = np.array(tried).T
    weights = np.exp((likely - likely.max()) / 2) * prior
    total = float(weights.sum())
    mean = float(likely.max()) + 2 * math.log(total)
    return OffsetWalk(q, tau, slope, weights / total, found > 0, mean)


def walks_tried(
    steps: Sequence[float], taus: Sequence[float], stays: float
) -> Iterator[tuple[float, float, float]]:
    """Yield step variance, correlation time and prior weight of each possible walk of the offset."""
    if stays > 0:
        yield 0.0, math.inf, stays
    for q in steps:
        for tau, weight in _parted(math.inf, taus, ENDLESS):
            yield q, tau, (1 - stays) * weight / len(steps)


def _parted(first: float, others: Sequence[float], weight: float) -> list[tuple[float, float]]:
    """Return pairs of a value and its weight: `first` with `weight`; `others` share the rest of 1 equally."""
    if not others:
        return [(first, 1.0)]
    return [(first, weight), *((one, (1 - weight) / len(others)) for one in others)]


def _offset(power: float, samples: int, q: float, tau: float, slope: float) -> list[Coordinate]:
    """Return the states of one drift for a Kalman filter: of a relaxation, the offset and a slope.

    `power`: variance of a sample of the noise alone. `samples`: number of samples in the record. `q`: step
    variance of the walk. `tau`: its correlation time in samples; infinite for a random walk, which needs no
    relaxation. `slope`: standard deviation of the slope per sample; 0 for none.
    """
    found = []
    if math.isfinite(tau):
        a = math.exp(-1 / tau)
        variance, q = q / (1 - a * a), 0.0
        found.append(relaxation_of(variance, a))
        power += variance
    found.append(offset_of(power, q))
    return [*found, ramp_of(slope, samples)] if slope else found


def _one(bare: System, samples: int, q: float, tau: float, slope: float) -> System:
    return functools.reduce(System.with_coordinate, _offset(bare.power, samples, q, tau, slope), bare)
