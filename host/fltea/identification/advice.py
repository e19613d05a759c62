"""Replace the advice in a verdict where bad data or steps of the bias make the usual advice wrong."""

from collections.abc import Sequence

from msgspec.structs import replace

from fltea.identification.axis import AxisResult
from fltea.identification.sensor_events import BiasStep

CURE_FIRST = "The data are bad. Correct that first: until then no figure is valid."

EXPECT_STEPS = "A filter needs its density N, and has to expect further steps of the bias like those found."


def doubted(result: AxisResult) -> AxisResult:
    """Return the result of an axis with bad data, with advice that does not rely on its figures."""
    return replace(result, verdict=result.verdict.saying(next=CURE_FIRST))


def expecting_steps(result: AxisResult, steps: Sequence[BiasStep]) -> AxisResult:
    """Return the result with advice to expect further steps of the bias, if steps were found in white noise.

    The usual advice for white noise is a filter with N alone, which would not follow further steps.
    """
    if not steps or result.verdict.kind != "white":
        return result
    return replace(result, verdict=result.verdict.saying(next=EXPECT_STEPS))
