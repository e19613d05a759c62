"""What is found out about the noise of one axis, and of all axes of a recording."""

from typing import TYPE_CHECKING

import msgspec

from fltea.api._html import axis_html, page
from fltea.api._tables import ByAxis, frame, row
from fltea.identification.axis import AxisResult
from fltea.records.fit import FitAllan, FitSpectrum, Interval, VerdictKind

if TYPE_CHECKING:
    import pandas as pd


class Identified(msgspec.Struct, frozen=True):
    """What was found out about one axis. A notebook shows it with its spectrum and Allan deviation.

    Intervals are of 95 %; their ends are None where the data do not define the parameter.
    """

    axis: str
    unit: str
    """The unit of the samples; s2 and R are in its square."""
    samples: int
    rate_hz: float
    mean: float
    std: float
    """Standard deviation."""
    verdict: VerdictKind
    """What the noise is, in a word or two."""
    text: str
    """The verdict in sentences: what the noise is, how sure that is, what to do."""
    null_p: float
    """The p-value of the test whether the noise is white."""
    alpha: Interval
    """The order α."""
    f: Interval
    """The parameter f, in s^-α."""
    F: Interval
    """F = h^α f + α, which the data say most about."""
    s2: Interval
    """Variance of the state's innovations, h^2α Q."""
    R: Interval
    """Variance of the white noise."""
    allan: FitAllan | None
    """The Allan deviation, or None for a record that is too short for it."""
    spectrum: FitSpectrum
    details: AxisResult
    """All figures of `fltea identify`: rivals, composite model (N, K, Gauss–Markov parts), peaks, FLTEA."""

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
        return page(axis_html(self.axis, self, of))


class Report(ByAxis[Identified]):
    """What was found out about each axis, by its name. A notebook shows all axes."""

    def __repr__(self) -> str:
        return f"Report({', '.join(f'{name}: {found.verdict}' for name, found in self.items())})"

    def _repr_html_(self) -> str:
        return "".join(found._repr_html_() for found in self.values())
