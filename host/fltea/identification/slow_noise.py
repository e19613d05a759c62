"""Replace K, drift rate and advice of an axis by those that include the slow noise that the tracker knows.

The figures come from the fit of the spectrum first. That fit leaves out noise so slow that the record has
fewer than ten periods of it. The tracker includes such noise.
"""

import math
from typing import NamedTuple

from msgspec.structs import replace

from fltea.identification.axis import AxisResult
from fltea.identification.tracked_system import OffsetWalkFound
from fltea.noise.distributions import chi2_tail
from fltea.records.fit import Interval
from fltea.records.quantity import coefficient_units, quantity_of, shown_units
from fltea.spectrum.allan_coefficients import Coefficient
from fltea.spectrum.allan_curve import CONFIDENCE, Allan
from fltea.spectrum.wording import duration


class Band(NamedTuple):
    """The averaging times at which the measured Allan deviation agrees with that of the chosen model."""

    to_s: float
    """Longest averaging time up to which the measured deviation agrees with the model's [s]; 0 if the two
    differ already at the shortest averaging time.
    """
    leaves_at_s: float | None
    """Shortest averaging time at which the measured Allan deviation differs from the model's [s]; None if
    they agree everywhere.
    """
    ends_s: float
    """Longest averaging time for which there is a measured deviation [s]."""
    is_more: bool = True
    """Whether the measured deviation is above the model's at the averaging time `leaves_at_s`."""


def with_slow_noise(
    result: AxisResult, allan: Allan | None, walk: OffsetWalkFound, drift_rate: Interval, unit: str
) -> tuple[AxisResult, Allan | None]:
    """Return result and Allan deviation of an axis, with new values of K, drift rate and advice.

    The new values include the slow noise that the tracker knows.
    """
    level = replace(result.level, K=walk.K, K_at_most=walk.at_most)
    verdict = result.verdict
    if allan is not None:
        if verdict.kind == "white":
            verdict = verdict.saying(next=next_of_white(allan, walk, unit))
        allan = replace(allan, K=_coefficient(walk, unit))
    return replace(result, level=level, drift_rate=drift_rate, verdict=verdict), allan


def band(allan: Allan) -> Band:
    """Return the averaging times at which an Allan deviation agrees with that of its model.

    If the model is right, 5 % of records still differ from it at one averaging time or more.

    The deviations at averaging times within an octave come from mostly the same samples, so they count as one
    test.
    """
    tau = allan.tau_s
    octaves = 1 + math.log2(tau[-1] / tau[0])
    least = (1 - CONFIDENCE) / octaves
    points = zip(tau, allan.deviation, allan.model, allan.degrees_of_freedom, strict=True)
    before = 0.0
    for tau_s, deviation, model, degrees in points:
        more = chi2_tail(degrees * (deviation / model) ** 2, degrees)
        if 2 * min(more, 1 - more) < least:
            return Band(before, tau_s, tau[-1], deviation > model)
        before = tau_s
    return Band(before, None, tau[-1])


def next_of_white(allan: Allan, walk: OffsetWalkFound, unit: str) -> str:
    """Return the advice for an axis whose spectrum is white: which figures a filter needs."""
    found, of_K = band(allan), said_of_K(walk, unit)
    if found.leaves_at_s is not None:
        what = (
            "there is slower noise, which this record is too short to name"
            if found.is_more
            else "there is less slow noise than in white noise, as behind a high-pass"
        )
        until = f" up to {duration(found.to_s)}" if found.to_s >= 1 else ""
        return (
            f"A filter needs its density N{until}. The Allan deviation is not that of "
            f"white noise at {_time(found.leaves_at_s)}: {what}. {of_K}"
        )
    if walk.said == "walks":
        return f"A filter needs its density N and the walk of its offset. {of_K}"
    return (
        "A filter needs only its density N: the Allan deviation is that of white noise at all averaging "
        f"times, up to {duration(found.ends_s)}. {of_K}"
    )


def _time(seconds: float) -> str:
    return duration(seconds) if seconds >= 1 else f"{seconds:.2g} s"


def said_of_K(walk: OffsetWalkFound, unit: str) -> str:
    """Return a sentence on K of the offset's random walk, or on its upper bound."""
    K = quantity_of(walk.K, coefficient_units(unit).K, walk.at_most).to(shown_units(unit).K)
    if K.value is not None:
        return f"The offset walks: K is {K}."
    if walk.said == "taken out":
        return "A high-pass has removed the walk of the sensor's bias: nothing is known of K."
    if K.at_most is None:
        return "Whether the offset walks cannot be told, and K has no bound."
    return f"If the offset walks, K is {K} (95 %)."


def _coefficient(walk: OffsetWalkFound, unit: str) -> Coefficient:
    reason = "" if walk.K.value is not None else said_of_K(walk, unit)
    if walk.tells_s is not None:
        reason += f" A record of {duration(walk.tells_s)} would tell."
    K = walk.K
    return Coefficient(K.value, K.low, K.high, reason=reason, of="tracker", at_most=walk.at_most)
