"""A forecast of the heading, and the recording as its judge: the model of its first half tells the second."""

import math
from collections.abc import Callable, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.estimator.offset_walk import offset_walk
from fltea.estimator.tracker import Tracker
from fltea.noise.heading import ahead, bias_std, heading_std, heading_stds, rest_for, rested
from fltea.noise.parts import Part
from fltea.noise.system import System, system
from fltea.records.errors import UsageError
from fltea.spectrum.wording import duration

Array = NDArray[np.float64]

SentenceParts = tuple[Sequence[Part], str]

SAID_S = 60.0
TIMES_S = (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1200.0, 1800.0, 3600.0)
FEWEST = 5
"""Pieces without which nothing is said of a time."""
WITHIN = 1.96
"""Deviations, of a band of 95 %."""
SURE = 2.5758
"""Deviations that fail a model, of all times together as likely as 1 %: more where there are more times."""
EXACT, GROWTH = 512, 1.1
"""The gain is exact for so many samples, and then found again when the record is so much longer."""


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


def tracked_system(parts: Sequence[Part], y: Array, h: float) -> System:
    """Return the system of a noise with the offset that it leaves open, which walks as y has it."""
    found = system(parts, h, len(y))
    if found.walks:
        return found
    tracker = Tracker([None])
    tracker.run(y[:, None])
    walk = offset_walk(found, len(y), lambda one: tracker.likelihood(0, one))
    return found.with_offset(walk.q, of_state=walk.is_certain)


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
        model = tracked_system(parts, y, h)
        current = now(model, y, h)
    except (ValueError, ArithmeticError):
        return None, None
    if first is None:
        return current, None
    half = y[: len(y) // 2]
    try:
        its, name = first(half)
        ahead_of_it = forecast(model, tracked_system(its, half, h), name, y, h, unit)
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


def judged(model: System, y: Array, begin: int, h: float) -> tuple[Piece, ...]:
    """Judge the forecasts of a system from sample `begin` of y on; what is before teaches its filter."""
    m = max(round(1 / h), 1)
    origin = float(y[:begin].mean())
    begin -= begin % m
    x, P = _estimates(model, y - origin, m)
    sums = np.append(0.0, np.cumsum(y - origin))
    lengths = [(t, round(t) * m) for t in TIMES_S if (len(y) - begin) // (round(t) * m) >= FEWEST]
    found = []
    for t_s, n in lengths:
        at = ahead(model, h, n * h)
        starts = np.arange(begin, len(y) - n + 1, n)
        seen = h * (sums[starts + n] - sums[starts]) - x[starts // m] @ at.row
        said = np.array([at.std(P[k]) for k in starts // m])
        z2 = (seen / said) ** 2
        k = len(starts)
        # Wilson & Hilferty (1931): the cube root of χ² over its degrees of freedom is nearly normal.
        off = (float(z2.mean()) ** (1 / 3) - (1 - 2 / (9 * k))) / math.sqrt(2 / (9 * k))
        most = math.sqrt(SURE**2 + 2 * math.log(len(lengths)))
        rms = math.sqrt(float((seen**2).mean())), math.sqrt(float((said**2).mean()))
        share = float((z2 <= WITHIN**2).mean())
        found.append(Piece(t_s, k, rms[1], rms[0], share, off, abs(off) > most))
    return tuple(found)


def _estimates(model: System, y: Array, m: int) -> tuple[Array, Array]:
    """Return the filter's x and P after 0, m, 2 m … samples of y: (k, n), (k, n, n)."""
    n, count = len(model.a), len(y) // m
    xs, Ps = np.zeros((count + 1, n)), np.zeros((count + 1, n, n))
    A, c, x, P = model.A, model.c, np.zeros(n), model.P0
    Ps[0] = P
    exact = min(-(-EXACT // m), count)
    for k in range(exact * m):
        K = P @ c / (float(c @ P @ c) + model.R)
        x = x + K * (y[k] - c @ x)
        if (k + 1) % m == 0:
            xs[(k + 1) // m], Ps[(k + 1) // m] = x, P - np.outer(K, c @ P)
        x, P = A @ x, A @ (P - np.outer(K, c @ P)) @ A.T + model.Q
    block = exact
    while block < count:
        end = min(max(block + 1, int(GROWTH * block)), count)
        after = rested(model, round((block + end) / 2 * m))
        before = A @ after @ A.T + model.Q
        K = before @ c / (float(c @ before @ c) + model.R)
        M = A - np.outer(K, c @ A)
        weights, power = np.zeros((m, n)), K
        for i in range(m - 1, -1, -1):
            weights[i], power = power, M @ power
        whole = np.linalg.matrix_power(M, m)
        for k, driven in enumerate(y[block * m : end * m].reshape(-1, m) @ weights, block + 1):
            xs[k] = whole @ xs[k - 1] + driven
            Ps[k] = after
        block = end
    return xs, Ps


def forecast(whole: System, first: System, made_of: str, y: Array, h: float, unit: str) -> Forecast:
    """Return the forecast of a recording y; first: the system of its first half, made of this."""
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


def integral(unit: str) -> str:
    """Return the unit of a heading, or of what else a rate of this unit sums up to, behind a number."""
    return "°" if unit == "deg/s" else f" {unit.removesuffix('²') if unit == 'm/s²' else unit + '·s'}"


def said(pieces: Sequence[Piece], unit: str) -> str:
    """Return what the judge says, in a sentence; of several times that fail, the one that fails most."""
    if not pieces:
        return f"The second half is too short to judge a forecast: it takes {FEWEST} pieces of a second."
    its = integral(unit)
    failed = max((one for one in pieces if one.fails), key=lambda one: abs(one.deviations), default=None)
    if failed is None:
        longest = pieces[-1]
        return (
            f"The second half does not contradict the first half's model up to {longest.t_s:g} s: "
            f"{longest.seen:.2g}{its} seen then, {longest.said:.2g}{its} said ({longest.pieces} pieces)."
        )
    how = "It drifts faster" if failed.deviations > 0 else "It drifts less"
    return (
        f"{how} than its model: {failed.seen:.2g}{its} seen after {failed.t_s:g} s, "
        f"{failed.said:.2g}{its} said ({failed.pieces} pieces)."
    )
