"""Judge a forecast by the recording itself: the first half's model predicts the second half.

The second half is divided into pieces, which are time spans of T seconds. Two things are predicted for each
piece. The first is the heading: the integral of the rate over the piece. The second is Bias(T): the expected
mean of the bias over the piece. Take the mean of the rate over the piece, and subtract Bias(T). If the noise
consists of the bias and white noise, the difference has the variance σ² + N²/T. Here σ is the standard
deviation of the bias about Bias(T), and N²/T is the variance of the mean of the white noise.
"""

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import NamedTuple

import msgspec
import numpy as np

from fltea.estimator.offset_walk import OffsetWalk, system_of, without_walk
from fltea.estimator.tracker import Tracker
from fltea.noise.distributions import chi2_tail
from fltea.noise.heading import Ahead, aheads, heading_stds, means_ahead, rested
from fltea.noise.left_open import nearby
from fltea.noise.linear_system import System
from fltea.noise.parts import Part
from fltea.records.arrays import Array
from fltea.records.plus_minus import NORMAL_95

TIMES_S = (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1200.0, 1800.0, 3600.0)
FEWEST = 5
"""Forecasts for T seconds are judged only if there are at least this many pieces (time spans of T seconds).
"""
WRONG = 0.01
"""Probability that a right model fails the test of its forecasts for at least one T, the length of a
forecast. The forecasts of the heading and those of the bias are tested separately, each with this
probability.
"""
UNLIKELY = 0.005
"""The offset may follow one of several models, each with a probability. The uncertainty of a forecast ignores
models whose probability is below this.
"""
NODES_AT, NODES_WEIGH = np.polynomial.hermite_e.hermegauss(9)
NODES_WEIGH = NODES_WEIGH / NODES_WEIGH.sum()
"""Points and weights for averages over a normal distribution (Gauss–Hermite quadrature)."""
GROWTH = 1.1
"""The longer the sensor rests, the better the state x of the noise model is known. The covariance of x is
computed anew when the time at rest has grown by this factor.
"""
LEARNT = 4
"""Errors of forecasts in the first half of the recording show whether their distribution has heavy tails
(many large errors). Errors in the first 1 / LEARNT of that half are not used for this.
"""
HELD = 0.95
"""Proportion of the errors that has to be inside the 95 % band after `needed` has widened it."""
MANY = 20
"""The tails of the distribution of errors are estimated only from at least this many pieces (time spans of T
seconds), each with one error.

If there are fewer pieces, the tails for the next shorter T are used.
"""
NORMAL_TAILS = 3.0
"""Ratio of a normal distribution's fourth moment to its squared second moment."""
TINY = 1e-300


class Piece(msgspec.Struct, frozen=True):
    """How well the heading was predicted, over pieces (time spans) of `t_s` seconds."""

    t_s: float
    pieces: int
    """Number of pieces; none overlaps another."""
    said: float
    """Predicted standard deviation of the heading after `t_s` seconds."""
    seen: float
    """Observed standard deviation of the heading after `t_s` seconds."""
    within: float
    """Proportion of the pieces (time spans) whose errors are inside the predicted 95 % band."""
    deviations: float
    """Distance of the errors' mean square from the predicted mean square, in standard deviations.

    It is positive if the errors are larger than predicted, and negative if they are smaller.
    """
    fails: bool
    needed: float
    """Factor by which the predicted 95 % band has to be widened to contain the errors of 95 % of the pieces.
    """


class BiasPiece(msgspec.Struct, frozen=True):
    """How well Bias(t_s) was predicted, over pieces (time spans) of `t_s` seconds.

    Bias(t_s) is the constant to subtract during these seconds.
    """

    t_s: float
    pieces: int
    """Number of pieces; none overlaps another."""
    bias_std: float
    """Predicted standard deviation σ of the difference between Bias(t_s) and the bias's mean over the next
    `t_s`.
    """
    noise_std: float
    """N/√t_s: standard deviation that white noise leaves in a mean over `t_s`."""
    said: float
    """Predicted standard deviation of the difference between the rate's mean and Bias(t_s): `bias_std` and
    `noise_std` together.
    """
    seen: float
    within: float
    """Proportion of the pieces (time spans) whose errors are inside the predicted 95 % band."""
    deviations: float
    """Distance of the errors' mean square from the predicted mean square, in standard deviations.

    It is positive if the errors are larger than predicted, and negative if they are smaller.
    """
    fails: bool


class Judgement(NamedTuple):
    """How well heading and bias were predicted: one entry for each T, the length of a forecast."""

    heading: tuple[Piece, ...]
    bias: tuple[BiasPiece, ...]


class FittedSystem(NamedTuple):
    """A state-space model of the noise, with its offset, that was fitted to `samples` samples."""

    parts: Sequence[Part]
    samples: int
    system: System
    walk: OffsetWalk
    steps_recur: bool = False
    """Whether so many steps of the bias were found that the model expects further steps."""


def fitted_system(parts: Sequence[Part], y: Array, h: float) -> FittedSystem:
    """Return the state-space system for samples y whose noise has these parts. `h`: sampling period [s]."""
    tracker = Tracker([None])
    tracker.take(y)
    followed = system_of(parts, h, len(y), tracker.remembered(0))
    return FittedSystem(followed.parts, len(y), followed.system, followed.walk)


class Forecasts(NamedTuple):
    """How heading and mean bias of the next n samples follow from the state x of the noise model.

    x is the state before these samples.
    """

    n: int
    heading: Ahead
    bias: Ahead

    def mean_std(self, system: System, P: Array, h: float) -> float:
        """Return the predicted standard deviation of the difference between the samples' mean and Bias(T).

        The state x also predicts some of the noise that is not bias, such as a resonance. Bias(T) leaves that
        out, so all of that noise is part of the difference.

        `P`: covariance of x. `h`: sampling period [s].
        """
        of_all, of_bias = self.heading.row / (self.n * h), self.bias.row
        of_noise = of_all - of_bias
        variance = float(of_bias @ P @ of_bias + 2 * of_bias @ P @ of_noise)
        variance += float(of_noise @ system.P0 @ of_noise) + self.heading.variance / (self.n * h) ** 2
        return math.sqrt(max(variance, 0.0))


class Errors(NamedTuple):
    """Errors of the forecasts for pieces (time spans) of one length, and their predicted standard deviations.

    Both arrays have one entry for each piece.
    """

    seen: Array
    said: Array

    @property
    def squares(self) -> Array:
        """Squares of the errors, divided by their predicted variances."""
        return np.asarray((self.seen / self.said) ** 2)

    @property
    def within(self) -> float:
        """Proportion of the pieces (time spans) whose errors are inside the predicted 95 % band."""
        return float((self.squares <= NORMAL_95**2).mean())

    @property
    def needed(self) -> float:
        """Least factor by which the predicted 95 % band has to be widened to contain 95 % of the errors."""
        ranked = np.sort(np.sqrt(self.squares))
        return float(ranked[math.ceil(len(ranked) * HELD) - 1]) / NORMAL_95

    @property
    def rms(self) -> tuple[float, float]:
        """Root mean square of the predicted standard deviations, and root mean square of the errors."""
        return math.sqrt(float((self.said**2).mean())), math.sqrt(float((self.seen**2).mean()))


def judged(model: FittedSystem, y: Array, begin: int, h: float) -> Judgement:
    """Judge the forecasts of a state-space model for the samples of y from index `begin` on.

    The model's Kalman filter first runs over all earlier samples.

    The samples from `begin` on are forecast in pieces. The mean square of the pieces' errors may differ from
    the predicted mean square for three reasons. The first is chance: the errors in different pieces are
    independent. The second is the uncertainty of the model, which is the same for all pieces. The third is
    that the errors may have heavy tails, which are estimated from the samples before `begin`.
    """
    m = max(round(1 / h), 1)
    begin -= begin % m
    times = [t for t in TIMES_S if (len(y) - begin) // (round(t) * m) >= FEWEST]
    counts = [round(t) * m for t in times]
    means = means_ahead(model.system, counts) if counts else []
    angles = aheads(model.system, h, [n * h for n in counts]) if counts else []
    told = [Forecasts(*one) for one in zip(counts, angles, means, strict=True)]
    doubts = left_open(model, h, times)
    first = begin // LEARNT // m * m
    tails = NORMAL_TAILS, NORMAL_TAILS
    before = _errors(model.system, y[:begin], first, m, h, told) if first else []
    most = -NormalDist().inv_cdf(WRONG / 2 / max(len(times), 1))
    headings, biases = [], []
    now = rested(model.system, begin)
    for k, (one, doubt, errors) in enumerate(
        zip(told, doubts, _errors(model.system, y, begin, m, h, told), strict=True)
    ):
        if before and len(before[k][0].seen) >= MANY:
            tails = _tails(before[k][0]), _tails(before[k][1])
        figures = []
        for its, tail in zip(errors, tails, strict=True):
            deviations = doubt.deviations(its.squares, tail)
            figures.append((*its.rms, its.within, deviations, abs(deviations) > most))
        std, pieces = one.bias.std(now), len(errors[0].seen)
        noise = math.sqrt(max(one.mean_std(model.system, now, h) ** 2 - std**2, 0.0))
        headings.append(Piece(times[k], pieces, *figures[0], errors[0].needed))
        biases.append(BiasPiece(times[k], pieces, std, noise, *figures[1]))
    return Judgement(tuple(headings), tuple(biases))


def _tails(errors: Errors) -> float:
    """Return how heavy the tails of the errors are: their fourth moment over their squared second moment.

    The result is at least 3, the value for normal errors.
    """
    squares = errors.squares
    return max(float((squares**2).mean() / squares.mean() ** 2), NORMAL_TAILS)


def _errors(
    system: System, y: Array, begin: int, m: int, h: float, told: Sequence[Forecasts]
) -> list[tuple[Errors, Errors]]:
    """Return the errors of heading and bias for each length of forecast in `told`.

    The samples of y from index `begin` on are divided into pieces of this length, each of which gives one
    error. `m`: number of samples in a second.
    """
    off = y - y[:begin].mean()
    sums = np.append(0.0, np.cumsum(off))
    origins, xs, Ps = _estimates(system, off, begin, m)
    found = []
    for one in told:
        n = one.n
        starts = np.arange(begin, len(y) - n + 1, n)
        rests = (starts - begin) // m
        total = sums[starts + n] - sums[starts] - n * origins[rests]
        heading = Errors(
            h * total - xs[rests] @ one.heading.row, np.array([one.heading.std(Ps[k]) for k in rests])
        )
        bias = Errors(
            total / n - xs[rests] @ one.bias.row, np.array([one.mean_std(system, Ps[k], h) for k in rests])
        )
        found.append((heading, bias))
    return found


def _estimates(model: System, y: Array, begin: int, m: int) -> tuple[Array, Array, list[Array]]:
    """Return what a tracker has estimated after `begin`, begin + m, begin + 2 m … samples of y.

    The result has three arrays, each with one entry for each of these numbers of samples:
        - the constant that the tracker has subtracted from the samples;
        - the state x of the noise model;
        - the covariance P of x.
    """
    tracker = Tracker([None])
    tracker.set(0, model)
    tracker.take(y[:begin])
    known = [tracker.x(0)]
    Ps, until = [rested(model, begin)], GROWTH * begin
    for at in range(begin, len(y) - m + 1, m):
        tracker.run(y[at : at + m, None])
        known.append(tracker.x(0))
        if at + m > until:
            until *= GROWTH
            Ps.append(rested(model, at + m))
        else:
            Ps.append(Ps[-1])
    return np.array([origin for origin, _ in known]), np.array([x for _, x in known]), Ps


class Doubt(NamedTuple):
    """The uncertainty of the predicted variance of an error (of heading or bias).

    The variance may be wrong by each of `factors`, with the probabilities `weights`.
    """

    factors: Array
    weights: Array
    spread: float
    """Standard deviation of the logarithm of the predicted variance. It is a further uncertainty, in addition
    to `factors`.
    """

    def deviations(self, squares: Array, tails: float) -> float:
        """Return the distance of the errors' mean square from the predicted one, in standard deviations.

        `squares`: squared errors, divided by their predicted variances. `tails`: the errors' fourth moment
        divided by their squared second moment. The result is positive if the errors are larger than
        predicted.

        The probability of such a mean square follows from a χ² distribution. It is converted to standard
        deviations of a normal distribution. Let k (`heavy`) be the variance of squared errors with these
        tails, relative to that of normal errors. Then the mean of n squares varies as much as the mean of n /
        k squares of normal errors. The model's variance was fitted to samples with the same tails, so the
        variance of its logarithm is k times larger, too.
        """
        heavy = (tails - 1) / (NORMAL_TAILS - 1)
        count = len(squares) / heavy
        sum_ = float(squares.mean()) * count
        factors = self.factors[:, None] * np.exp(math.sqrt(heavy) * self.spread * NODES_AT)
        weights = np.outer(self.weights, NODES_WEIGH)
        more = sum(
            w * chi2_tail(sum_ / f, count)
            for f, w in zip(factors.ravel().tolist(), weights.ravel().tolist(), strict=True)
        )
        one = NormalDist()
        if more < 0.5:
            return -one.inv_cdf(max(more, TINY))
        return one.inv_cdf(max(1 - more, TINY))


def left_open(model: FittedSystem, h: float, times_s: Sequence[float]) -> list[Doubt]:
    """Return the uncertainty of the heading's predicted variance at each time.

    The variance is uncertain because the model was fitted to a record of limited length. There are two
    causes. The first is errors in the parameters of the model's parts; they make the logarithm of the
    variance normally distributed. The second is that the offset may follow one of several models, each with
    its probability.
    """
    n = model.samples

    def variances(one: System) -> Array:
        return np.array(heading_stds(one, rested(one, n), h, times_s)) ** 2

    def of_parts(parts: Sequence[Part]) -> Array:
        return variances(model.walk.system(without_walk(parts, h, n)[0], n))

    squares = np.zeros(len(times_s))
    for less, more in nearby(model.parts, h, n):
        squares += (np.log(of_parts(more) / of_parts(less)) / 2) ** 2
    of_offset = model.walk.likely(without_walk(model.parts, h, n)[0], n, UNLIKELY)
    weights = np.array([weight for weight, _ in of_offset])
    factors = np.array([variances(one) for _, one in of_offset]) / variances(model.system)
    return [
        Doubt(one, weights / weights.sum(), spread)
        for spread, one in zip(np.sqrt(squares).tolist(), factors.T, strict=True)
    ]
