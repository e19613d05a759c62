"""The advice of a verdict, where more is known than the spectrum says (pure)."""

from collections.abc import Sequence

from msgspec.structs import replace

from fltea.identification.axis import AxisResult
from fltea.identification.sensor_events import BiasStep

CURE_FIRST = "The data are bad: cure that first; no figure counts before."

EXPECT_STEPS = "A filter needs its density N, and has to expect steps of the bias such as were found."


def doubted(result: AxisResult) -> AxisResult:
    """Return the result of bad data, whose verdict advises nothing that is built on its figures."""
    return replace(result, verdict=result.verdict.saying(next=CURE_FIRST))


def expecting_steps(result: AxisResult, steps: Sequence[BiasStep]) -> AxisResult:
    """Return the result of an axis whose bias has stepped, for which N alone is not enough."""
    if not steps or result.verdict.kind != "white":
        return result
    return replace(result, verdict=result.verdict.saying(next=EXPECT_STEPS))
