"""Forecast the heading, and check the forecast.

For the check, the model that is fitted to the record's first half predicts the second half.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

import msgspec

from fltea.identification.forecast_judge import (
    FEWEST,
    TIMES_S,
    BiasPiece,
    FittedSystem,
    Judgement,
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
from fltea.noise.linear_system import System
from fltea.noise.parts import Walk, high_pass_of
from fltea.records.arrays import Array
from fltea.records.errors import UsageError
from fltea.records.plus_minus import NORMAL_95
from fltea.records.units import HEADING_AFTER_S, MOST_DEG
from fltea.settings.live import LiveConfig
from fltea.spectrum.wording import duration, names

P = TypeVar("P", Piece, BiasPiece)

BIAS_S = 10.0
"""Longest time T for which the text shows Bias(T) [s]."""
AS_FILTERED = (
    "The forecast is for the samples as they are, after the high-pass: the sensor itself drifts more."
)


class BiasAtEnd(NamedTuple):
    """Bias(T) after the last sample of a recording.

    `samples`: number of samples since the last step of the bias, from which the bias was computed.
    `has_stepped`: whether there was a step.
    """

    bias: float
    bias_std: float
    bias_s: float
    samples: int
    has_stepped: bool = False


class Now(msgspec.Struct, frozen=True):
    """Bias(T) at the end of a recording, and the standard deviation of the heading's error after a minute.

    Bias(T) is the expected mean of the bias over the next T seconds.
    """

    bias: float
    bias_std: float
    heading_std: float
    """Standard deviation of the error of the heading (the integrated rate) after 60 s; in deg for a rate in
    deg/s.
    """
    bias_s: float
    """T, the time during which the bias is to be subtracted [s]."""


class Goal(msgspec.Struct, frozen=True):
    """A required heading: good to ± `within` deg after `t_s` seconds, with a probability of 95 %."""

    within: float
    t_s: float


class Drive(msgspec.Struct, frozen=True):
    """The question for how long a heading is good to ± `within` deg (95 %) after `rest_s` seconds at rest."""

    within: float
    rest_s: float


Asked = bool | Goal | Drive | Sequence[Goal | Drive]
"""Whether a forecast is wanted, and which questions it has to answer."""


def asked_by(forecast: bool, rest_for: str | None, drive_for: str | None) -> Asked:
    """Return what the options ask for.

    The options are --forecast, --rest-for DEG@SECONDS and --drive-for DEG@SECONDS.

    Raises:
        UsageError: the text of an option is not DEG@SECONDS.
    """
    goals = [] if rest_for is None else [goal_of(rest_for)]
    drives = [] if drive_for is None else [drive_of(drive_for)]
    return (*goals, *drives) or forecast


def _questions(asked: Asked) -> Sequence[Goal | Drive]:
    if isinstance(asked, bool):
        return ()
    return (asked,) if isinstance(asked, Goal | Drive) else asked


def goal_of(text: str) -> Goal:
    """Return the goal of `--rest-for DEG@SECONDS`: a heading error of at most DEG, SECONDS after a rest.

    Raises:
        UsageError: the text is not a goal.
    """
    goal = Goal(*_degrees_at_seconds(text))
    if not (0 < goal.within < math.inf and 0 < goal.t_s <= TIMES_S[-1]):
        raise UsageError(
            f"--rest-for {text}: has to be degrees and seconds, up to an hour: --rest-for 0.5@60 asks how "
            "long to rest so that the heading is good to ± 0.5° (95 %) a minute later."
        )
    return goal


def drive_of(text: str) -> Drive:
    """Return the drive of `--drive-for DEG@SECONDS`: it lasts until the heading error exceeds DEG.

    SECONDS is the time at rest before the drive.

    Raises:
        UsageError: the text is not a drive.
    """
    drive = Drive(*_degrees_at_seconds(text))
    if not (0 < drive.within < math.inf and 0 < drive.rest_s <= LONGEST_REST_S):
        raise UsageError(
            f"--drive-for {text}: has to be degrees and seconds at rest, up to a day: --drive-for 1@30 asks "
            "for how long the heading is good to ± 1° (95 %) after a rest of 30 s."
        )
    return drive


def _degrees_at_seconds(text: str) -> tuple[float, float]:
    """Return the two numbers of `DEG@SECONDS`; NaN for both if the text has another form."""
    degrees, _, seconds = text.partition("@")
    try:
        return float(degrees), float(seconds)
    except ValueError:
        return math.nan, math.nan


class Forecast(msgspec.Struct, frozen=True):
    """The forecast, which is made with the model of the whole recording, and a check of the forecast.

    For the check, the model of the first half forecasts the second half.
    """

    t_s: tuple[float, ...]
    heading_std: tuple[float, ...]
    judged: tuple[Piece, ...]
    """For each length of time: how well the model of the first half predicted the heading in the second half.
    """
    bias: tuple[BiasPiece, ...]
    """For each T: how well the model of the first half predicted Bias(T), the constant to subtract during the
    next T seconds.
    """
    made_of: str
    """The parts of the noise on which the forecast is based, and the model of its offset, in words."""
    judged_made_of: str
    """The parts and the model of the offset, in words, that were fitted to the first half, for the check on
    the second half. The text is empty if the first half has no model.
    """
    text: str
    goal: Goal | None = None
    rest_s: float | None = None
    """Time at rest that the goal needs [s]; null if no goal was asked for, or if no time at rest is
    enough.
    """
    drive: Drive | None = None
    drive_s: float | None = None
    """How long the heading's 95 % error stays within `drive.within` [s], after a rest of `drive.rest_s`
    seconds.

    Null if no drive is asked for, or if the error stays within the limit for more than an hour.
    """
    after_s: float = 0.0
    """Time at rest before the forecast begins [s].

    It is the length of the recording's longest part without a gap. The check uses the second half of this
    part to judge the model of its first half.
    """


def found(
    tracked: FittedSystem,
    y: Array,
    h: float,
    unit: str,
    first: Callable[[Array], FittedSystem] | None,
    asked: Asked = (),
    at_end: BiasAtEnd | None = None,
) -> tuple[Now | None, Forecast | None]:
    """Return the bias at the end of the recording and, if `first` is given, the forecast.

    Each of the two is None if no Kalman filter can be made for the noise.

    Args:
        tracked: the state-space model of the noise in all of y.
        y: samples without a gap, (n,).
        h: sampling period [s].
        unit: unit of y.
        first: a function that fits a state-space model to the first half of y. None: no forecast.
        asked: the questions that the forecast has to answer.
        at_end: the bias after the last sample of the recording. None: the mean of y is used.
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
        ahead = forecast(tracked, first(half), y, h, unit)
    except (ValueError, ArithmeticError) as error:
        curve = tuple(heading_stds(model, rested(model, len(y)), h, TIMES_S))
        text = f"The first half has no model to judge: {error}."
        ahead = Forecast(TIMES_S, curve, (), (), made_of(tracked), "", text, after_s=len(y) * h)
    for one in _questions(asked):
        ahead = _answering(ahead, model, h, one, unit)
    return current, ahead


def _answering(found: Forecast, model: System, h: float, asked: Goal | Drive, unit: str) -> Forecast:
    """Return the forecast with the answer to the question `asked`.

    If there is no answer, the forecast's text says why.
    """
    try:
        if isinstance(asked, Goal):
            return with_goal(found, model, h, asked, unit)
        return with_drive(found, model, h, asked, unit)
    except (ValueError, ArithmeticError) as error:
        what = "how long to rest" if isinstance(asked, Goal) else "how long the heading is good"
        return msgspec.structs.replace(found, text=f"{found.text} It cannot be told {what}: {error}.")


def now(model: System, y: Array, h: float, at_end: BiasAtEnd | None) -> Now:
    """Return the bias after the last sample of a recording. `y`: its longest part at rest."""
    if at_end is None:
        P = rested(model, len(y))
        at_end = BiasAtEnd(float(y.mean()), bias_std(model, P), LiveConfig().bias_s, len(y))
    P = rested(model, at_end.samples)
    return Now(at_end.bias, at_end.bias_std, heading_std(model, P, h, HEADING_AFTER_S), at_end.bias_s)


def forecast(whole: FittedSystem, first: FittedSystem, y: Array, h: float, unit: str) -> Forecast:
    """Return the forecast for the time after a recording y, with a check of the first half's model.

    `whole`: model of the whole recording. `first`: model of its first half, which predicts the second half
    for the check. `h`: sampling period [s].
    """
    P = rested(whole.system, len(y))
    judgement = judged(first, y, len(y) // 2, h)
    curve = tuple(heading_stds(whole.system, P, h, TIMES_S))
    text = said(judgement, unit)
    if high_pass_of(first.parts) is not None:
        text += f" {AS_FILTERED}"
    return Forecast(TIMES_S, curve, *judgement, made_of(whole), made_of(first), text, after_s=len(y) * h)


def made_of(tracked: FittedSystem) -> str:
    """Return the parts of a noise model and the model of its offset in a few words."""
    walk = tracked.walk
    # If the fit of the spectrum found a walk (`is_found`), the offset's walk named below stands in its place.
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
    """Return the forecast with the time at rest that the goal needs."""
    rest = rest_for(model, h, goal.t_s, goal.within / NORMAL_95, integral(unit))
    if rest.rest_s is None:
        text = rest.reason
    else:
        time = "less than 1 s" if rest.rest_s < 1 else duration(rest.rest_s)
        text = f"Rest for {time}: the heading is good to {_good(goal.within, unit)} {goal.t_s:g} s later."
    return msgspec.structs.replace(found, text=f"{found.text} {text}", goal=goal, rest_s=rest.rest_s)


def with_drive(found: Forecast, model: System, h: float, drive: Drive, unit: str) -> Forecast:
    """Return the forecast with the time until the heading's 95 % error exceeds `drive.within`."""
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
    """Format the required accuracy of a heading with its probability."""
    return f"± {within:g}{integral(unit)} (95 %, {NORMAL_95:g} σ)"


def is_any_heading(std: float, unit: str) -> bool:
    """Whether a heading's standard deviation is so large that any heading is possible.

    This is False unless the rate is in deg/s.
    """
    return unit == "deg/s" and std > MOST_DEG


def angle(std: float, unit: str) -> str:
    """Format the standard deviation of a heading, or of the integral of another rate."""
    return "over half a turn" if is_any_heading(std, unit) else f"{std:.2g}{integral(unit)}"


def integral(unit: str) -> str:
    """Return the unit of a heading, or of the integral of another rate, as it is written after a number."""
    return "°" if unit == "deg/s" else f" {unit.removesuffix('²') if unit == 'm/s²' else unit + '·s'}"


def said(found: Judgement, unit: str) -> str:
    """Return how well the first half's model predicted heading and bias in the second half, in sentences."""
    if not found.heading:
        return f"The second half is too short to check a forecast: a check needs {FEWEST} pieces of a second."
    return f"{_of_heading(found.heading, unit)} {_of_bias(found.bias, unit)}"


def _of_heading(pieces: Sequence[Piece], unit: str) -> str:
    """Return a sentence on the forecast of the heading.

    If the forecast fails at several times, the sentence is on the time with the largest deviation.
    """
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
    """Return a sentence on the forecast of the bias.

    If the predicted Bias(T) fails the test for some T, the sentence is on the T with the largest deviation.
    Otherwise it is on the longest T up to `BIAS_S`.
    """
    failed = _worst(pieces)
    one = failed or max((one for one in pieces if one.t_s <= BIAS_S), key=lambda one: one.t_s)
    figures = (
        f"the σ of the rate's mean about it is {one.said:.2g} {unit} as predicted, {one.seen:.2g} {unit} as "
        f"seen ({one.pieces} pieces)"
    )
    return f"Bias({one.t_s:g} s) {'holds' if failed is None else 'fails'}: {figures}."


def _worst(pieces: Sequence[P]) -> P | None:
    """Return the failed judgement with the largest deviation; None if no judgement failed."""
    return max((one for one in pieces if one.fails), key=lambda one: abs(one.deviations), default=None)
