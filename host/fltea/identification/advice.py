"""The advice of a verdict, where more is known than the spectrum says (pure)."""

from msgspec.structs import replace

from fltea.identification.axis import AxisResult
from fltea.spectrum.verdict import Verdict

CURE_FIRST = "The data are bad: cure that first; no figure counts before."


def with_next(verdict: Verdict, then: str) -> Verdict:
    """Return a verdict that says what to do next in other words."""
    return replace(verdict, text=f"{verdict.what} {verdict.why} {then}", next=then)


def doubted(result: AxisResult) -> AxisResult:
    """Return the result of bad data, whose verdict advises nothing that is built on its figures."""
    return replace(result, verdict=with_next(result.verdict, CURE_FIRST))
