"""What in an axis that was looked at can mislead."""

from fltea.identification.axis import AxisResult, Looked
from fltea.identification.load import Series
from fltea.identification.traps import Trap, axis_traps
from fltea.spectrum.wording import duration


def traps_of(looked: Looked, series: Series, result: AxisResult) -> tuple[Trap, ...]:
    """Return what in an axis that was looked at can mislead."""
    return axis_traps(
        looked.y,
        looked.h,
        series.lsb,
        result.peaks,
        series.unit,
        series.gaps,
        longer=_longer(result),
    )


def _longer(result: AxisResult) -> str:
    """Return how long a record should be, as the verdict has it."""
    if not result.verdict.has_order:
        return "ten minutes or more"
    longest_s = None if result.to_tell is None else result.to_tell.longest_s
    return "as long as can be" if longest_s is None else f"about {duration(longest_s)}"
