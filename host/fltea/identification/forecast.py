"""A forecast of the heading, and the recording as its judge: the model of its first half tells the second."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

import msgspec

from fltea.identification.forecast_judge import (
    FEWEST,
    TIMES_S,
    BiasPiece,
    Judgement,
    Learned,
    Piece,
    judged,
)
from fltea.identification.navigation_filter import slope_of
from fltea.noise.heading import (
    LONGEST_REST_S,
    bias_std,
    drive_for,
    heading_std,
    heading_stds,
    rest_for,
    rested,
)
from fltea.noise.parts import Walk, high_pass_of
from fltea.noise.system import System
from fltea.records.arrays import Array
from fltea.records.errors import UsageError
from fltea.records.plus_minus import NORMAL_95
from fltea.records.units import MOST_DEG
from fltea.settings.live import LiveConfig
from fltea.spectrum.wording import duration, names

P = TypeVar("P", Piece, BiasPiece)

SAID_S = 60.0
BIAS_S = 10.0
"""The time of the bias that a sentence is about."""
AS_FILTERED = "It holds for the samples as they are, behind the high-pass: the sensor itself drifts more."


class BiasAtEnd(NamedTuple):
    """Bias(T) after the last sample of a recording.

    samples: from how many it is known, those since the last step. has_stepped: whether there was one.
    """

    bias: float
    bias_std: float
    bias_s: float
    samples: int
    has_stepped: bool = False


class Now(msgspec.Struct, frozen=True):
    """Bias(T) at the end of a recording, and the heading's deviation after a minute."""

    bias: float
    bias_std: float
    heading_std: float
    """in deg after 60 s, for a rate in deg/s"""
    bias_s: float
    """T: for so many seconds the bias is meant."""


class Goal(msgspec.Struct, frozen=True):
    """A heading that shall be good to ± `within` deg after t_s, with a probability of 95 %."""

    within: float
    t_s: float


class Drive(msgspec.Struct, frozen=True):
    """The inverse of a goal: how long a heading is good to ± `within` deg (95 %) after a rest of rest_s."""

    within: float
    rest_s: float


Asked = bool | Goal | Drive | Sequence[Goal | Drive]
"""Whether a forecast is wanted, and what it has to answer."""


def asked_by(forecast: bool, rest_for: str | None, drive_for: str | None) -> Asked:
    """Return what the options ask for: --forecast, and DEG@SECONDS of --rest-for and --drive-for.

    Raises:
        UsageError: one of them is none.
    """
    goals = [] if rest_for is None else [goal_of(rest_for)]
    drives = [] if drive_for is None else [drive_of(drive_for)]
    return (*goals, *drives) or forecast


def _questions(asked: Asked) -> Sequence[Goal | Drive]:
    if isinstance(asked, bool):
        return ()
    return (asked,) if isinstance(asked, Goal | Drive) else asked


def goal_of(text: str) -> Goal:
    """Return the goal of `DEG@SECONDS`.

    Raises:
        UsageError: it is none.
    """
    goal = Goal(*_degrees_at_seconds(text))
    if not (0 < goal.within < math.inf and 0 < goal.t_s <= TIMES_S[-1]):
        raise UsageError(
            f"--rest-for {text}: has to be degrees and seconds, up to an hour: --rest-for 0.5@60 asks how "
            "long to rest so that the heading is good to ± 0.5° (95 %) a minute later."
        )
    return goal


def drive_of(text: str) -> Drive:
    """Return the drive of `DEG@SECONDS`, the seconds at rest.

    Raises:
        UsageError: it is none.
    """
    drive = Drive(*_degrees_at_seconds(text))
    if not (0 < drive.within < math.inf and 0 < drive.rest_s <= LONGEST_REST_S):
        raise UsageError(
            f"--drive-for {text}: has to be degrees and seconds at rest, up to a day: --drive-for 1@30 asks "
            "for how long the heading is good to ± 1° (95 %) after a rest of 30 s."
        )
    return drive


def _degrees_at_seconds(text: str) -> tuple[float, float]:
    """Return the numbers of `DEG@SECONDS`; NaN for both if there are none."""
    degrees, _, seconds = text.partition("@")
    try:
        return float(degrees), float(seconds)
    except ValueError:
        return math.nan, math.nan


class Forecast(msgspec.Struct, frozen=True):
    """The curve of the whole recording's model, and what the second half says of the first half's."""

    t_s: tuple[float, ...]
    heading_std: tuple[float, ...]
    judged: tuple[Piece, ...]
    """of the heading"""
    bias: tuple[BiasPiece, ...]
    """of Bias(T), the constant to take off during the next T seconds"""
    made_of: str
    """What the curve is made of: the parts of the whole recording's noise, and what its offset does."""
    judged_made_of: str
    """The same of the first half's model, which the second half judges; empty if there is none."""
    text: str
    goal: Goal | None = None
    rest_s: float | None = None
    """How long to rest for the goal; null if there is none, or no rest is enough."""
    drive: Drive | None = None
    drive_s: float | None = None
    """For how long the heading is good after the drive's rest; null if no drive is asked for, or for more
    than an hour."""
    after_s: float = 0.0
    """How long the sensor had rested where the curve begins: the longest part of the recording without a gap,
    of which the first half is judged by the second [s]."""


def found(
    tracked: Learned,
    y: Array,
    h: float,
    unit: str,
    first: Callable[[Array], Learned] | None,
    asked: Asked = (),
    at_end: BiasAtEnd | None = None,
) -> tuple[Now | None, Forecast | None]:
    """Return the bias now and, if `first` is given, the forecast; y: samples (n,) without a gap.

    tracked: of all of y. first: returns what is known of samples alone. asked: what the forecast has to
    answer. at_end: the bias after the last sample of the recording; None: the mean of y.

    None where no filter can work with the noise.
    """
    model = tracked.system
    try:
        current = now(model, y, h, at_end)
    except (ValueError, ArithmeticError):
        return None, None
    if first is None:
        return current, None
    half = y[: len(y) // 2]
    try:
        ahead_of_it = forecast(tracked, first(half), y, h, unit)
    except (ValueError, ArithmeticError) as error:
        curve = tuple(heading_stds(model, rested(model, len(y)), h, TIMES_S))
        text = f"The first half has no model to judge: {error}."
        ahead_of_it = Forecast(TIMES_S, curve, (), (), made_of(tracked), "", text, after_s=len(y) * h)
    for one in _questions(asked):
        ahead_of_it = _answering(ahead_of_it, model, h, one, unit)
    return current, ahead_of_it


def _answering(found: Forecast, model: System, h: float, asked: Goal | Drive, unit: str) -> Forecast:
    """Return the same forecast with what was asked for, or why nobody knows."""
    try:
        if isinstance(asked, Goal):
            return with_goal(found, model, h, asked, unit)
        return with_drive(found, model, h, asked, unit)
    except (ValueError, ArithmeticError) as error:
        what = "how long to rest" if isinstance(asked, Goal) else "how long the heading is good"
        return msgspec.structs.replace(found, text=f"{found.text} It cannot be told {what}: {error}.")


def now(model: System, y: Array, h: float, at_end: BiasAtEnd | None) -> Now:
    """Return the bias after the last sample of a recording, of which y is the longest part at rest."""
    if at_end is None:
        P = rested(model, len(y))
        at_end = BiasAtEnd(float(y.mean()), bias_std(model, P), LiveConfig().bias_s, len(y))
    P = rested(model, at_end.samples)
    return Now(at_end.bias, at_end.bias_std, heading_std(model, P, h, SAID_S), at_end.bias_s)


def forecast(whole: Learned, first: Learned, y: Array, h: float, unit: str) -> Forecast:
    """Return the forecast of a recording y; first: what is known of its first half."""
    P = rested(whole.system, len(y))
    judgement = judged(first, y, len(y) // 2, h)
    curve = tuple(heading_stds(whole.system, P, h, TIMES_S))
    text = said(judgement, unit)
    if high_pass_of(first.parts) is not None:
        text += f" {AS_FILTERED}"
    return Forecast(TIMES_S, curve, *judgement, made_of(whole), made_of(first), text, after_s=len(y) * h)


def made_of(tracked: Learned) -> str:
    """Return what a tracked system is made of, in a few words: parts, and what its offset does."""
    walk = tracked.walk
    # The tracker's walk stands for that of the parts, if it has any.
    own = [part for part in tracked.parts if not (walk.is_found and isinstance(part, Walk))]
    found = [names(map(type, own))]
    if walk.endless > 0:
        found.append("walk of the offset")
    if walk.relaxation is not None:
        found.append("relaxation of the offset")
    if slope_of(tracked.system).any():
        found.append("slope of the offset")
    if tracked.steps_recur:
        found.append("steps of the bias")
    return " + ".join(filter(None, found))


def with_goal(found: Forecast, model: System, h: float, goal: Goal, unit: str) -> Forecast:
    """Return the same forecast with how long to rest for the goal."""
    rest = rest_for(model, h, goal.t_s, goal.within / NORMAL_95, integral(unit))
    if rest.rest_s is None:
        text = rest.reason
    else:
        time = "less than 1 s" if rest.rest_s < 1 else duration(rest.rest_s)
        text = f"Rest for {time}: the heading is good to {_good(goal.within, unit)} {goal.t_s:g} s later."
    return msgspec.structs.replace(found, text=f"{found.text} {text}", goal=goal, rest_s=rest.rest_s)


def with_drive(found: Forecast, model: System, h: float, drive: Drive, unit: str) -> Forecast:
    """Return the same forecast with for how long the heading is good after the drive's rest."""
    drive_s = drive_for(model, h, drive.rest_s, drive.within / NORMAL_95)
    if drive_s is None:
        time = "for more than an hour"
    elif drive_s == 0:
        time = "for less than a sample"
    else:
        time = f"for {drive_s:.3g} s" if drive_s < 1000 else f"for {drive_s:.0f} s"
    good = _good(drive.within, unit)
    text = f"{found.text} After a rest of {drive.rest_s:g} s the heading is good to {good} {time}."
    return msgspec.structs.replace(found, text=text, drive=drive, drive_s=drive_s)


def _good(within: float, unit: str) -> str:
    """Return within what a heading shall be, and what that means."""
    return f"± {within:g}{integral(unit)} (95 %, {NORMAL_95:g} σ)"


def is_any_heading(std: float, unit: str) -> bool:
    """Whether a heading, of a rate in this unit, can be any."""
    return unit == "deg/s" and std > MOST_DEG


def angle(std: float, unit: str) -> str:
    """Return the deviation of a heading, or of what else a rate of this unit sums up to."""
    return "over half a turn" if is_any_heading(std, unit) else f"{std:.2g}{integral(unit)}"


def integral(unit: str) -> str:
    """Return the unit of a heading, or of what else a rate of this unit sums up to, behind a number."""
    return "°" if unit == "deg/s" else f" {unit.removesuffix('²') if unit == 'm/s²' else unit + '·s'}"


def said(found: Judgement, unit: str) -> str:
    """Return what the judge says, in sentences."""
    if not found.heading:
        return f"The second half is too short to check a forecast: it takes {FEWEST} pieces of a second."
    return f"{_of_heading(found.heading, unit)} {_of_bias(found.bias, unit)}"


def _of_heading(pieces: Sequence[Piece], unit: str) -> str:
    """Return what is said of the heading; of several times that fail, of the one that fails most."""
    failed = _worst(pieces)
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


def _of_bias(pieces: Sequence[BiasPiece], unit: str) -> str:
    """Return the same of the bias; if none fails, of the longest time up to `BIAS_S`."""
    failed = _worst(pieces)
    one = failed or max((one for one in pieces if one.t_s <= BIAS_S), key=lambda one: one.t_s)
    figures = (
        f"the mean of the rate is {one.said:.2g} {unit} about it as predicted, {one.seen:.2g} {unit} as seen "
        f"({one.pieces} pieces)"
    )
    return f"Bias({one.t_s:g} s) {'holds' if failed is None else 'fails'}: {figures}."


def _worst(pieces: Sequence[P]) -> P | None:
    """Return the piece that fails by the most deviations."""
    return max((one for one in pieces if one.fails), key=lambda one: abs(one.deviations), default=None)
