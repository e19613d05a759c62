"""What is found out about the noise of one axis, and of all axes of a recording."""

from html import escape
from typing import TYPE_CHECKING

from fltea.api._html import axis_html, page
from fltea.api._tables import ByAxis, frame, row
from fltea.identification.axis import AxisResult
from fltea.identification.forecast import Forecast, Now
from fltea.identification.traps import Trap
from fltea.records.fit import FitSpectrum, FittedAxis

if TYPE_CHECKING:
    import pandas as pd


class Identified(FittedAxis, frozen=True, kw_only=True):
    """What was found out about one axis. A notebook shows it with its spectrum and Allan deviation.

    Intervals are of 95 %; their ends are None where the data do not define the parameter.
    """

    axis: str
    samples: int
    rate_hz: float
    mean: float
    std: float
    """Standard deviation."""
    spectrum: FitSpectrum
    now: Now | None
    """The bias at the end of the record, and how far the heading is off after a minute."""
    forecast: Forecast | None
    """With `forecast=True`."""
    traps: tuple[Trap, ...]
    """What in the data can mislead."""
    withheld: str
    """Why `now` and `forecast` are None: what is bad in the data, and what to do; "" where nothing is."""
    details: AxisResult
    """All figures of `fltea identify`: parts, N, K, sentences that did not win, peaks, FLTEA."""

    def __repr__(self) -> str:
        return f"Identified({self.axis}: {self.verdict}, {self.samples} samples at {self.rate_hz:g} Hz)"

    @property
    def duration_s(self) -> float:
        """The length of the record in seconds."""
        return self.samples / self.rate_hz

    def to_pandas(self) -> "pd.DataFrame":
        """Return a table of one row: verdict, and every figure with the ends of its interval.

        Raises:
            UsageError: pandas is not installed.
        """
        return frame([row(self.axis, self)])

    def _repr_html_(self) -> str:
        of = f"{self.samples:,} samples at {self.rate_hz:g} Hz, σ = {self.std:.3g} {self.unit}"
        withheld = f"<p><strong>Bad data.</strong> {escape(self.withheld)}</p>" if self.withheld else ""
        return page(withheld + axis_html(self.axis, self, of))


class Report(ByAxis[Identified]):
    """What was found out about each axis, by its name. A notebook shows all axes."""

    def __repr__(self) -> str:
        return f"Report({', '.join(f'{name}: {found.verdict}' for name, found in self.items())})"

    def _repr_html_(self) -> str:
        return "".join(found._repr_html_() for found in self.values())
