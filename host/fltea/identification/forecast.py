"""A forecast of the heading, and the recording as its judge: the model of its first half tells the second."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from fltea.estimator.offset_walk import OffsetWalk, system_of
from fltea.estimator.tracker import Tracker
from fltea.noise.distributions import NORMAL_95
from fltea.noise.heading import ahead, bias_std, heading_std, heading_stds, rest_for, rested
from fltea.noise.left_open import nearby
from fltea.noise.parts import Part
from fltea.noise.system import System, system
from fltea.records.arrays import Array
from fltea.records.errors import UsageError
from fltea.records.units import MOST_DEG
from fltea.spectrum.wording import duration

SentenceParts = tuple[Sequence[Part], str]

SAID_S = 60.0
TIMES_S = (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1200.0, 1800.0, 3600.0)
FEWEST = 5
"""Pieces without which nothing is said of a time."""
SURE = 2.5758
"""Deviations that fail a model, of all times together as likely as 1 %: more where there are more times."""
GROWTH = 1.1
"""What is known of x is found again for a rest that is so much longer."""


class Now(msgspec.Struct, frozen=True):
    """The bias at the end of a recording, and the heading's deviation after a minute."""

    bias: float
    bias_std: float
    heading_std: float
    """in deg after 60 s, for a rate in deg/s"""


class Piece(msgspec.Struct, frozen=True):
    """What the pieces of one length say of a forecast; standard deviations are of the heading."""

    t_s: float
    pieces: int
    """of which none overlaps another"""
    said: float
    seen: float
    within: float
    """share inside of the band of 95 %"""
    deviations: float
    """by which the mean square over that said is off, as a normal one"""
    fails: bool


class Goal(msgspec.Struct, frozen=True):
    """A heading that shall be good to ± `within` deg after t_s."""

    within: float
    t_s: float


def goal_of(text: str) -> Goal:
    """Return the goal of `DEG@SECONDS`.

    Raises:
        UsageError: it is none.
    """
    within, _, t_s = text.partition("@")
    try:
        goal = Goal(float(within), float(t_s))
    except ValueError:
        goal = Goal(math.nan, math.nan)
    if not (0 < goal.within < math.inf and 0 < goal.t_s <= TIMES_S[-1]):
        raise UsageError(
            f"--rest-for {text}: has to be degrees and seconds, up to an hour: --rest-for 0.5@60 asks how "
            "long to rest so that the heading is good to ± 0.5° a minute later."
        )
    return goal


class Forecast(msgspec.Struct, frozen=True):
    """The curve of the whole recording's model, and what the second half says of the first half's."""

    t_s: tuple[float, ...]
    heading_std: tuple[float, ...]
    judged: tuple[Piece, ...]
    made_of: str
    """the first half's noise"""
    text: str
    goal: Goal | None = None
    rest_s: float | None = None
    """How long to rest for the goal; null if there is none, or no rest is enough."""


class Learned(NamedTuple):
    """The system of a noise that was found in so many samples, with the offset that it leaves open."""

    parts: Sequence[Part]
    samples: int
    system: System
    walk: OffsetWalk


def learned(parts: Sequence[Part], y: Array, h: float) -> Learned:
    """Return the system of a noise that was found in y."""
    tracker = Tracker([None])
    tracker.run(y[:, None])
    return Learned(parts, len(y), *system_of(parts, h, len(y), tracker.remembered(0)))


def found(
    parts: Sequence[Part],
    y: Array,
    h: float,
    unit: str,
    first: Callable[[Array], SentenceParts] | None,
    goal: Goal | None = None,
) -> tuple[Now | None, Forecast | None]:
    """Return the bias now and, if `first` is given, the forecast; y: samples (n,) without a gap.

    parts: what all of y is made of. first: tells the same of samples, and its name.

    None where no filter can work with the noise.
    """
    try:
        model = learned(parts, y, h).system
        current = now(model, y, h)
    except (ValueError, ArithmeticError):
        return None, None
    if first is None:
        return current, None
    half = y[: len(y) // 2]
    try:
        its, name = first(half)
        ahead_of_it = forecast(model, learned(its, half, h), name, y, h, unit)
        return current, ahead_of_it if goal is None else with_goal(ahead_of_it, model, h, goal, unit)
    except (ValueError, ArithmeticError) as error:
        curve = tuple(heading_stds(model, rested(model, len(y)), h, TIMES_S))
        return current, Forecast(TIMES_S, curve, (), "", f"The first half has no model to judge: {error}.")


def now(model: System, y: Array, h: float) -> Now:
    """Return the bias after the last sample of y."""
    tracker = Tracker([None])
    tracker.run(y[:-1, None])
    tracker.set(0, model)
    last = tracker.run(y[-1:, None])
    P = rested(model, len(y))
    bias, std = float(last.bias[-1, 0]), float(last.bias_std[-1, 0])
    if not (math.isfinite(bias) and math.isfinite(std)):
        bias, std = float(y.mean()), bias_std(model, P)
    return Now(bias, std, heading_std(model, P, h, SAID_S))


def judged(model: Learned, y: Array, begin: int, h: float) -> tuple[Piece, ...]:
    """Judge the forecasts of a system from sample `begin` of y on; what is before teaches its filter.

    All pieces are told by one model. So their mean square is off by chance, and by how well that is known.
    """
    m = max(round(1 / h), 1)
    begin -= begin % m
    lengths = [(t, round(t) * m) for t in TIMES_S if (len(y) - begin) // (round(t) * m) >= FEWEST]
    off = y - y[:begin].mean()
    sums = np.append(0.0, np.cumsum(off))
    origins, xs, Ps = _estimates(model.system, off, begin, m)
    found = []
    for (t_s, n), spread in zip(lengths, spreads(model, h, [t for t, _ in lengths]), strict=True):
        at = ahead(model.system, h, n * h)
        starts = np.arange(begin, len(y) - n + 1, n)
        rests = (starts - begin) // m
        seen = h * (sums[starts + n] - sums[starts] - n * origins[rests]) - xs[rests] @ at.row
        said = np.array([at.std(Ps[k]) for k in rests])
        z2 = (seen / said) ** 2
        k = len(starts)
        # Wilson & Hilferty (1931): the cube root of χ² over its degrees of freedom is nearly normal.
        off_by = float(z2.mean()) ** (1 / 3) - (1 - 2 / (9 * k))
        deviations = off_by / math.sqrt(2 / (9 * k) + spread**2 / 9)
        most = math.sqrt(SURE**2 + 2 * math.log(len(lengths)))
        rms = math.sqrt(float((seen**2).mean())), math.sqrt(float((said**2).mean()))
        share = float((z2 <= NORMAL_95**2).mean())
        found.append(Piece(t_s, k, rms[1], rms[0], share, deviations, abs(deviations) > most))
    return tuple(found)


def _estimates(model: System, y: Array, begin: int, m: int) -> tuple[Array, Array, list[Array]]:
    """Return origin, x and P of the tracker after `begin`, begin + m, begin + 2 m … samples of y."""
    tracker = Tracker([None])
    tracker.set(0, model)
    tracker.run(y[:begin, None])
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


def spreads(model: Learned, h: float, times_s: Sequence[float]) -> Array:
    """Return the deviations of the heading's variance, over itself, by what its record leaves open."""

    def variances(parts: Sequence[Part], q: float) -> Array:
        bare = system(parts, h, model.samples)
        one = bare if bare.walks else bare.with_offset(q)
        return np.array(heading_stds(one, rested(one, model.samples), h, times_s)) ** 2

    parts, (steps, weights) = model.parts, model.walk
    by_walk = np.array([variances(parts, q) for q in steps])
    squares = weights @ by_walk**2 / (weights @ by_walk) ** 2 - 1
    for less, more in nearby(parts, h, model.samples):
        squares += (np.log(variances(more, model.walk.q) / variances(less, model.walk.q)) / 2) ** 2
    return np.asarray(np.sqrt(squares))


def forecast(whole: System, first: Learned, made_of: str, y: Array, h: float, unit: str) -> Forecast:
    """Return the forecast of a recording y; first: what is known of its first half, made of this."""
    P = rested(whole, len(y))
    pieces = judged(first, y, len(y) // 2, h)
    curve = tuple(heading_stds(whole, P, h, TIMES_S))
    return Forecast(TIMES_S, curve, pieces, made_of, said(pieces, unit))


def with_goal(found: Forecast, model: System, h: float, goal: Goal, unit: str) -> Forecast:
    """Return the same forecast with how long to rest for the goal."""
    rest, its = rest_for(model, h, goal.t_s, goal.within), integral(unit)
    if rest.rest_s is None:
        text = rest.reason
    else:
        good = f"± {goal.within:g}{its} {goal.t_s:g} s later"
        text = f"Rest for {duration(rest.rest_s)}: the heading is good to {good}."
    return msgspec.structs.replace(found, text=f"{found.text} {text}", goal=goal, rest_s=rest.rest_s)


def is_any_heading(std: float, unit: str) -> bool:
    """Whether a heading, of a rate in this unit, can be any."""
    return unit == "deg/s" and std > MOST_DEG


def angle(std: float, unit: str) -> str:
    """Return the deviation of a heading, or of what else a rate of this unit sums up to."""
    return "over half a turn" if is_any_heading(std, unit) else f"{std:.2g}{integral(unit)}"


def integral(unit: str) -> str:
    """Return the unit of a heading, or of what else a rate of this unit sums up to, behind a number."""
    return "°" if unit == "deg/s" else f" {unit.removesuffix('²') if unit == 'm/s²' else unit + '·s'}"


def said(pieces: Sequence[Piece], unit: str) -> str:
    """Return what the judge says, in a sentence; of several times that fail, the one that fails most."""
    if not pieces:
        return f"The second half is too short to check a forecast: it takes {FEWEST} pieces of a second."
    failed = max((one for one in pieces if one.fails), key=lambda one: abs(one.deviations), default=None)
    if failed is None:
        longest = pieces[-1]
        return (
            f"The first half's forecast holds in the second half up to {longest.t_s:g} s: "
            f"{angle(longest.said, unit)} predicted, {angle(longest.seen, unit)} seen "
            f"({longest.pieces} pieces)."
        )
    how = "faster" if failed.deviations > 0 else "less"
    return (
        f"The heading drifts {how} than predicted: after {failed.t_s:g} s "
        f"{angle(failed.seen, unit)} seen, "
        f"{angle(failed.said, unit)} predicted ({failed.pieces} pieces)."
    )
