"""Present the results on the noise of one axis, and of all axes of a recording."""

import os
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from fltea.api._html import axis_html, page
from fltea.api._tables import ByAxis, frame, row, table
from fltea.api.drawing import Drawing
from fltea.identification.allan_file import COLUMNS, rows, write_allan
from fltea.identification.axis import AxisResult
from fltea.identification.data_checks import DataCheck
from fltea.identification.event_checks import EVENT_CHECKS
from fltea.identification.forecast import Forecast, Now
from fltea.identification.navigation_filter import NavigationFilter
from fltea.identification.quantities import Quantities, quantities
from fltea.identification.sensor_events import BiasStep, MotionSpan
from fltea.identification.tracked_system import OffsetWalkFound
from fltea.records.fit import FitSpectrum, FittedAxis
from fltea.records.plus_minus import plus_minus
from fltea.records.quantity import Quantity, shown_units
from fltea.spectrum.allan_curve import Allan

if TYPE_CHECKING:
    import pandas as pd


# Why more than 12 attributes: each is one result that the user of a notebook reads.
class Identified(FittedAxis, frozen=True, kw_only=True):
    """The results for one axis. A notebook shows them with spectrum and Allan deviation.

    Intervals have 95 % confidence. An end is None if the data do not determine it.
    """

    axis: str
    """Name of the axis."""
    samples: int
    """Number of samples."""
    rate_hz: float
    """Sampling rate [Hz]."""
    mean: float
    """Mean of the samples, in `unit`."""
    std: float
    """Standard deviation of the samples, in `unit`."""
    spectrum: FitSpectrum
    """The measured noise density, and the noise density of the fitted model."""
    allan_curve: Allan | None
    """The Allan deviation with its intervals, and N, B and K with their intervals. If N, B or K is not known,
    the reason is given.

    The field `allan` has the same points without intervals. `allan_curve` is None if the record is too short.
    """
    now: Now | None
    """The bias at the end of the record, as Bias(T): its expected mean over the next T seconds. Also the
    standard deviation of the heading's error after a minute.
    """
    forecast: Forecast | None
    """The forecast of the heading's error; None if the caller did not ask for it with `forecast`."""
    walk: OffsetWalkFound | None
    """The result of the test whether the offset follows a random walk."""
    filter: NavigationFilter | None
    """Parameters of a plain Kalman filter, as in the file of `--gauss-markov`."""
    bias_steps: tuple[BiasStep, ...]
    """Steps of the bias. The spectrum is not computed across them."""
    motion: tuple[MotionSpan, ...]
    """Time spans in which the sensor moved. No figure uses their samples."""
    data_checks: tuple[DataCheck, ...]
    """Findings of the data checks: properties of the samples that can mislead the analysis."""
    withheld: str
    """The reason why `now`, `forecast`, `walk` and `filter` are None; "" if the data are good.

    The text names the fault in the data and its remedy.
    """
    details: AxisResult
    """All figures that `fltea identify` computes: the components of the noise, N, K, the models that were not
    chosen, the peaks of the spectrum, and the estimates of FLTEA.
    """

    def __repr__(self) -> str:
        return f"Identified({self.axis}: {self.verdict}, {self.samples} samples at {self.rate_hz:g} Hz)"

    @property
    def duration_s(self) -> float:
        """Length of the record [s]."""
        return self.samples / self.rate_hz

    @property
    def N(self) -> Quantity:
        """White noise (angle random walk) in deg/√h, or m/s²/√Hz for an accelerometer; `.to` converts it."""
        return self._figures.N.to(shown_units(self.unit).N)

    @property
    def B(self) -> Quantity:
        """Bias instability (Allan deviation) in deg/h, or m/s² for an accelerometer; `.to` converts it."""
        return self._figures.B.to(shown_units(self.unit).B)

    @property
    def K(self) -> Quantity:
        """Random walk of the bias in deg/h/√h, or m/s²/√s for an accelerometer; `.to` converts it."""
        return self._figures.K.to(shown_units(self.unit).K)

    @property
    def bias(self) -> Quantity:
        """Bias at the end of the record (`now.bias`) in deg/s or m/s²; `.to` converts it."""
        return self._figures.bias

    @property
    def _figures(self) -> Quantities:
        return quantities(self.unit, self.details.level, self.allan_curve, self.now)

    def plot(self) -> Drawing:
        """Return a drawing of spectrum and Allan deviation, for notebooks or for `.save("axis.svg")`."""
        return Drawing(self)

    def to_pandas(self) -> "pd.DataFrame":
        """Return a table with one row: the verdict, and each figure with both ends of its interval.

        Raises:
            UsageError: pandas is not installed.
        """
        return frame([row(self.axis, self)])

    def _repr_html_(self) -> str:
        of = f"{self.samples:,} samples at {self.rate_hz:g} Hz, σ = {self.std:.3g} {self.unit}"
        withheld = f"<p><strong>Bad data.</strong> {escape(self.withheld)}</p>" if self.withheld else ""
        return page(withheld + axis_html(self.axis, self, of, self._bias()))

    def _bias(self) -> str:
        """Return sentences on the bias at the end of the record, and on steps and motion."""
        found = []
        if self.now is not None:
            value = plus_minus(self.now.bias, self.now.bias_std)
            found.append(f"Bias({self.now.bias_s:g} s) at the end: {value} {self.unit}.")
        found += [data_check.text for data_check in self.data_checks if data_check.kind in EVENT_CHECKS]
        return " ".join(found)


class Report(ByAxis[Identified]):
    """The results of all axes: a mapping from the axis's name to its result. A notebook shows all axes."""

    def __repr__(self) -> str:
        return f"Report({', '.join(f'{name}: {found.verdict}' for name, found in self.items())})"

    def allan(self) -> "pd.DataFrame":
        """Return the Allan deviations of all axes: one row for each axis and averaging time.

        The columns are those of `write_allan_csv`.

        Raises:
            UsageError: pandas is not installed.
        """
        return table(rows(self._curves()), tuple(COLUMNS))

    def write_allan_csv(self, path: str | os.PathLike[str]) -> None:
        """Write the Allan deviations to a CSV file, as `--allan-csv` does.

        It is written completely or not at all.

        Raises:
            FlteaError: the file cannot be written.
            ValueError: the record is too short for an Allan deviation.
        """
        write_allan(Path(path), self._curves())

    def _curves(self) -> dict[str, tuple[str, Allan]]:
        found = ((name, one.unit, one.allan_curve) for name, one in self.items())
        return {name: (unit, curve) for name, unit, curve in found if curve is not None}

    def _repr_html_(self) -> str:
        return "".join(found._repr_html_() for found in self.values())
