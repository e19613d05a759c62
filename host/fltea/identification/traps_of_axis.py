"""What in an axis that was looked at can mislead."""

from fltea.identification.axis import AxisResult, Looked
from fltea.identification.load import Series
from fltea.identification.traps import Trap, axis_traps


def traps_of(looked: Looked, series: Series, result: AxisResult) -> tuple[Trap, ...]:
    """Return what in an axis that was looked at can mislead."""
    return axis_traps(
        looked.y,
        looked.h,
        series.lsb,
        result.peaks,
        series.unit,
        series.gaps,
        longer="as long as can be" if result.verdict.has_order else "ten minutes or more",
    )
