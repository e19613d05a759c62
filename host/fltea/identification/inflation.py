"""Compute a factor for the noise figures of an axis if its heading drifts further than the figures predict.

The model of the recording's first half predicts how far the heading drifts in the second half
(`forecast_judge`). The second half is divided into pieces (time spans) of one length, and this is done for
several lengths. Each piece has one error of the heading. If the errors are larger than predicted, by more
than chance, the noise figures of the whole recording are multiplied by a factor. It is the smallest factor
with which 95 % of the errors are inside the predicted 95 % band. One factor is enough: if the figures of
white noise and random walk are both multiplied by it, so is the heading's standard deviation. Lengths with
too few pieces are left out.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Protocol

from fltea.documents.imu_yaml import Inflation
from fltea.identification.forecast import Forecast
from fltea.identification.forecast_judge import MANY, TIMES_S, Piece
from fltea.identification.load import GYRO_UNIT
from fltea.records.errors import UsageError
from fltea.spectrum.wording import duration

LEAST_S = 10.0
"""The longest time span that is used must be at least this long [s]. Over shorter time spans, white noise
causes nearly all of the heading's error.
"""


class Foretold(Protocol):
    """An axis with its forecast, which includes the check of the first half's model on the second half."""

    @property
    def unit(self) -> str:
        """Unit of the samples."""

    @property
    def forecast(self) -> Forecast | None:
        """The forecast; None if none could be made."""


def own_inflation(axes: Mapping[str, Foretold], up_to_s: float) -> Inflation:
    """Return by which factor each axis's noise figures are multiplied, and sentences that say why.

    Args:
        axes: axes with their forecasts.
        up_to_s: longest time [s] after which the drift of the heading is checked. A time is checked only if
            the second half of the record can be divided into at least `MANY` pieces of this length.

    Raises:
        UsageError: the second half of an axis is too short to judge, or there is no forecast for it.
    """
    factors: dict[str, float] = {}
    said: dict[str, list[str]] = {}
    for name, axis in axes.items():
        found = _forecast(name, axis)
        counted, others = _counted(name, found, up_to_s)
        exceeded = [one for one in counted if _is_exceeded(one)]
        factors[name] = _two_digits(max((1.0, *(_factor(one, found) for one in exceeded))))
        text = _why(axis.unit, factors[name], counted[-1].t_s, is_exceeded=bool(exceeded))
        text += _of_longer(factors[name], counted[-1].t_s, up_to_s, others, found)
        said.setdefault(text, []).append(name)
    return Inflation(1.0, 1.0, factors, tuple(f"{', '.join(names)}: {text}" for text, names in said.items()))


def _forecast(name: str, axis: Foretold) -> Forecast:
    if axis.forecast is None or not axis.forecast.judged_made_of:
        raise UsageError(
            f"--inflate auto: {name}: no filter works with its noise, or with that of its first half, so "
            "nothing is predicted. Give a factor, such as 10."
        )
    return axis.forecast


def _counted(name: str, found: Forecast, up_to_s: float) -> tuple[list[Piece], list[Piece]]:
    """Return two lists of checks of the heading, each check with pieces (time spans) of another length.

    The first list has the checks with at least `MANY` pieces. The second has those with longer and fewer
    pieces.
    """
    asked = [one for one in found.judged if one.t_s <= max(up_to_s, LEAST_S)]
    counted = [one for one in asked if one.pieces >= MANY]
    if not counted or counted[-1].t_s < LEAST_S:
        raise UsageError(
            f"--inflate auto: {name}: this needs {MANY} pieces of {LEAST_S:g} s in the second half of the "
            f"longest rest without a break. Record for {duration(_takes_s(LEAST_S))} or longer, or give a "
            "factor, such as 10."
        )
    return counted, asked[len(counted) :]


def _takes_s(t_s: float) -> float:
    """Return how long a recording must be [s] so that its second half has `MANY` pieces of `t_s` seconds."""
    return 2 * MANY * t_s


def _is_exceeded(one: Piece) -> bool:
    """Whether the heading drifts further than chance and the model's uncertainty explain."""
    return one.fails and one.deviations > 0


def _factor(one: Piece, found: Forecast) -> float:
    """Return the factor by which the noise figures of the whole recording have to be multiplied.

    For the figures of the first half, this factor is `one.needed`: it widens the predicted 95 % band so that
    95 % of the errors are inside. If the whole recording's model already predicts larger errors than the
    first half's, its factor is smaller in proportion.
    """
    return one.needed * one.said / found.heading_std[found.t_s.index(one.t_s)]


def _two_digits(factor: float) -> float:
    """Round a factor up to two digits."""
    step = 10.0 ** (math.floor(math.log10(factor)) - 1)
    return float(f"{math.ceil(factor / step - 1e-9) * step:.2g}")


def _why(unit: str, factor: float, held_s: float, *, is_exceeded: bool) -> str:
    of = "heading" if unit == GYRO_UNIT else "velocity"
    if not is_exceeded:
        return f"times 1: the first half's 95 % band of the {of} held in the second, for up to {held_s:g} s."
    if factor == 1:
        return (
            f"times 1: the {of} of the second half went beyond the first half's 95 % band, but not beyond "
            f"that of the whole recording, for up to {held_s:g} s."
        )
    return (
        f"times {factor:g}: the {of} of the second half went beyond the first half's 95 % band. With this "
        f"factor the band holds, for up to {held_s:g} s: the factor covers what the model does not describe."
    )


def _of_longer(factor: float, held_s: float, up_to_s: float, others: Sequence[Piece], found: Forecast) -> str:
    """Return a sentence that says how long a recording must be to check the heading up to `up_to_s`.

    If all these times were checked, the sentence is empty.
    """
    longest = max(one for one in TIMES_S if one <= max(up_to_s, LEAST_S))
    if held_s >= longest:
        return ""
    said = f" A check up to {longest:g} s needs a recording of {duration(_takes_s(longest))}"
    wanted = {one.t_s: _factor(one, found) for one in others if _is_exceeded(one)}
    worst = max(wanted, key=lambda t_s: wanted[t_s], default=None)
    if worst is None or wanted[worst] <= factor:
        return f"{said}."
    few = next(one.pieces for one in others if one.t_s == worst)
    return f"{said}; the {few} pieces of {worst:g} s want {wanted[worst]:.2g}, but are too few to count."
