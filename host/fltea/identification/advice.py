"""Replace the advice of a verdict where more is known than the spectrum shows."""

from collections.abc import Sequence

from msgspec.structs import replace

from fltea.identification.axis import AxisResult
from fltea.identification.sensor_events import BiasStep

CURE_FIRST = "The data are bad: mend that first; no figure holds before."

EXPECT_STEPS = "A filter needs its density N, and has to expect further steps of the bias like those found."


def doubted(result: AxisResult) -> AxisResult:
    """Return the result with a verdict whose advice does not rely on the figures, since the data are bad."""
    return replace(result, verdict=result.verdict.saying(next=CURE_FIRST))


def expecting_steps(result: AxisResult, steps: Sequence[BiasStep]) -> AxisResult:
    """Return the result for an axis whose bias has stepped, since N alone is then not enough for a filter."""
    if not steps or result.verdict.kind != "white":
        return result
    return replace(result, verdict=result.verdict.saying(next=EXPECT_STEPS))
