"""The recording as judge of a forecast: the model of its first half tells the second, piece by piece (pure).

Two things are told of the next T seconds: the heading, which is the integral of the rate less its prediction,
and Bias(T), the constant to take off meanwhile. The mean of the rate less Bias(T) spreads by σ² + N²/T, σ
that of the bias and N²/T what the noise leaves in a mean.
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
from fltea.noise.parts import Part
from fltea.noise.system import System
from fltea.records.arrays import Array
from fltea.records.plus_minus import NORMAL_95

TIMES_S = (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1200.0, 1800.0, 3600.0)
FEWEST = 5
"""Pieces without which nothing is said of a time."""
WRONG = 0.01
"""How often a right model fails, at any of the times."""
UNLIKELY = 0.005
"""What an offset does less likely than that is no doubt about a forecast."""
NODES_AT, NODES_WEIGH = np.polynomial.hermite_e.hermegauss(9)
NODES_WEIGH = NODES_WEIGH / NODES_WEIGH.sum()
"""Points that stand for a normal distribution, and their weights."""
GROWTH = 1.1
"""What is known of x is found again for a rest that is so much longer."""
LEARNT = 4
"""The first half's own pieces begin at this part of it."""
HELD = 0.95
"""The share of pieces that a band of 95 % has to hold."""
MANY = 20
"""Pieces without which their tails are those of shorter ones."""
NORMAL_TAILS = 3.0
"""Fourth moment over the square of the second."""
TINY = 1e-300


class Piece(msgspec.Struct, frozen=True):
    """What the pieces of one length say of a forecast of the heading."""

    t_s: float
    pieces: int
    """of which none overlaps another"""
    said: float
    """standard deviation"""
    seen: float
    """standard deviation"""
    within: float
    """share inside of the band of 95 %"""
    deviations: float
    """by which the mean square over that said is off, as a normal one"""
    fails: bool
    needed: float
    """how many times as wide the band has to be for 95 % to be inside"""


class BiasPiece(msgspec.Struct, frozen=True):
    """What the pieces of one length say of Bias(t_s), the constant to take off meanwhile."""

    t_s: float
    pieces: int
    """of which none overlaps another"""
    bias_std: float
    """of the mean of the bias about Bias(t_s): σ"""
    noise_std: float
    """what noise leaves in a mean of so long: N/√t_s"""
    said: float
    """standard deviation of the mean of the rate about Bias(t_s): both together"""
    seen: float
    within: float
    """share inside of the band of 95 %"""
    deviations: float
    """by which the mean square over that said is off, as a normal one"""
    fails: bool


class Judgement(NamedTuple):
    """What a recording says of forecasts, by time."""

    heading: tuple[Piece, ...]
    bias: tuple[BiasPiece, ...]


class Learned(NamedTuple):
    """The system of a noise that was found in so many samples, with what its offset may do."""

    parts: Sequence[Part]
    samples: int
    system: System
    walk: OffsetWalk
    steps_recur: bool = False
    """Whether the system has steps of the bias, which are expected to come again."""


def learned(parts: Sequence[Part], y: Array, h: float) -> Learned:
    """Return the system of a noise that was found in y."""
    tracker = Tracker([None])
    tracker.take(y)
    followed = system_of(parts, h, len(y), tracker.remembered(0))
    return Learned(followed.parts, len(y), followed.system, followed.walk)


class Forecasts(NamedTuple):
    """What is said of the next n samples, by x and its covariance at their beginning."""

    n: int
    heading: Ahead
    bias: Ahead

    def mean_std(self, system: System, P: Array, h: float) -> float:
        """Return the deviation of the mean of the samples about that of the bias, as expected.

        Of noise that is no signal Bias(T) has nothing, whatever the filter knows of it.
        """
        of_all, of_bias = self.heading.row / (self.n * h), self.bias.row
        of_noise = of_all - of_bias
        variance = float(of_bias @ P @ of_bias + 2 * of_bias @ P @ of_noise)
        variance += float(of_noise @ system.P0 @ of_noise) + self.heading.variance / (self.n * h) ** 2
        return math.sqrt(max(variance, 0.0))


class Errors(NamedTuple):
    """Errors of forecasts of the pieces of a time, and their standard deviations as said; (pieces,)."""

    seen: Array
    said: Array

    @property
    def squares(self) -> Array:
        """Over what is said."""
        return np.asarray((self.seen / self.said) ** 2)

    @property
    def within(self) -> float:
        """The share inside of the band of 95 %."""
        return float((self.squares <= NORMAL_95**2).mean())

    @property
    def needed(self) -> float:
        """How many times as wide the band of 95 % has to be, at least, for 95 % to be inside."""
        ranked = np.sort(np.sqrt(self.squares))
        return float(ranked[math.ceil(len(ranked) * HELD) - 1]) / NORMAL_95

    @property
    def rms(self) -> tuple[float, float]:
        """That said, and that seen."""
        return math.sqrt(float((self.said**2).mean())), math.sqrt(float((self.seen**2).mean()))


def judged(model: Learned, y: Array, begin: int, h: float) -> Judgement:
    """Judge the forecasts of a system from sample `begin` of y on; what is before teaches its filter.

    A filter's errors of successive pieces are independent. But all pieces are told by one model. So their
    mean square is off by chance, by how well that is known, and by tails that the first half has shown.
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
    """Return the fourth moment of errors over the square of the second, of normal ones at least."""
    squares = errors.squares
    return max(float((squares**2).mean() / squares.mean() ** 2), NORMAL_TAILS)


def _errors(
    system: System, y: Array, begin: int, m: int, h: float, told: Sequence[Forecasts]
) -> list[tuple[Errors, Errors]]:
    """Return the errors of heading and bias from sample `begin` of y on, for each forecast."""
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
    """Return origin, x and P of the tracker after `begin`, begin + m, begin + 2 m … samples of y."""
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
    """What a record leaves open of the variance of a forecast: factors of it, and how likely each is."""

    factors: Array
    weights: Array
    spread: float
    """Standard deviation of the logarithm of what is beside them."""

    def deviations(self, squares: Array, tails: float) -> float:
        """Return by how many deviations the mean of squares is off, as a normal figure; + is too much.

        With heavier tails the mean is as uncertain as that of fewer squares; so is the variance that the
        record tells, by the same factor.
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


def left_open(model: Learned, h: float, times_s: Sequence[float]) -> list[Doubt]:
    """Return what the record of a model leaves open of the heading's variance at each time.

    The figures of its parts are off as a normal figure is by the logarithm of the variance. What the offset
    does is one of several.
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
