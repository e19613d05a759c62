"""What the tracker adds to the figures of an axis, which are by its spectrum: K, drift rate, what to do.

The spectrum leaves out what is slower than ten periods of the record. The tracker does not.
"""

import math
from typing import NamedTuple

from msgspec.structs import replace

from fltea.identification.allan import scales
from fltea.identification.axis import AxisResult
from fltea.identification.tracked_system import OffsetWalkFound
from fltea.noise.distributions import chi2_tail
from fltea.records.fit import Interval
from fltea.spectrum.allan_coefficients import Coefficient
from fltea.spectrum.allan_curve import CONFIDENCE, Allan
from fltea.spectrum.wording import duration


class Band(NamedTuple):
    """How far the Allan deviation is that of the model that stands for the noise."""

    to_s: float
    """The longest averaging time up to which it is; 0 if it is not from the first one on."""
    leaves_at_s: float | None
    """The first averaging time at which it is not; None if it is at all."""
    ends_s: float
    """The longest averaging time of the curve."""
    is_more: bool = True
    """Whether the curve is above its model where it leaves it."""


def with_slow_noise(
    result: AxisResult, allan: Allan | None, walk: OffsetWalkFound, drift_rate: Interval, unit: str
) -> tuple[AxisResult, Allan | None]:
    """Return result and Allan deviation of an axis with what the tracker knows of its slow noise."""
    level = replace(result.level, K=walk.K, K_at_most=walk.at_most)
    verdict = result.verdict
    if allan is not None:
        if verdict.kind == "white":
            verdict = verdict.saying(next=next_of_white(allan, walk, unit))
        allan = replace(allan, K=_coefficient(walk, unit))
    return replace(result, level=level, drift_rate=drift_rate, verdict=verdict), allan


def band(allan: Allan) -> Band:
    """Return how far a curve is that of its model, at all its averaging times together at 95 %.

    The points of an octave have most of their samples in common, and count as one.
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
    """Return what a filter needs of an axis whose spectrum is white."""
    found, of_K = band(allan), said_of_K(walk, unit)
    if found.leaves_at_s is not None:
        what = (
            "there is slower noise, which this record is too short to name"
            if found.is_more
            else "there is less slow noise than white noise has, as behind a high-pass"
        )
        until = f" up to {duration(found.to_s)}" if found.to_s >= 1 else ""
        return (
            f"A filter needs its density N{until}. The Allan deviation is not that of "
            f"white noise at {_time(found.leaves_at_s)}: {what}. {of_K}"
        )
    if walk.said == "walks":
        return f"A filter needs its density N and the walk of its offset. {of_K}"
    return (
        "A filter needs only its density N: the Allan deviation is that of white noise up to its end, "
        f"{duration(found.ends_s)}. {of_K}"
    )


def _time(seconds: float) -> str:
    return duration(seconds) if seconds >= 1 else f"{seconds:.2g} s"


def said_of_K(walk: OffsetWalkFound, unit: str) -> str:
    """Return K of the offset's walk, or its bound, in a sentence."""
    scale = scales(unit).K
    if walk.K.value is not None:
        low, high = (f"{(end or 0.0) * scale.factor:.3g}" for end in (walk.K.low, walk.K.high))
        return f"The offset walks: K is {walk.K.value * scale.factor:.3g} ({low}…{high}) {scale.unit}."
    if walk.said == "taken out":
        return "A high-pass has taken the walk of the sensor's bias out: nothing is known of K."
    if walk.at_most is None:
        return "Whether the offset walks cannot be told, and K has no bound."
    return f"If the offset walks, K is at most {walk.at_most * scale.factor:.3g} {scale.unit} (95 %)."


def _coefficient(walk: OffsetWalkFound, unit: str) -> Coefficient:
    reason = "" if walk.K.value is not None else said_of_K(walk, unit)
    if walk.tells_s is not None:
        reason += f" A record of {duration(walk.tells_s)} would tell."
    K = walk.K
    return Coefficient(K.value, K.low, K.high, reason=reason, of="tracker", at_most=walk.at_most)
