"""What is found out about the noise of one axis, and of all axes of a recording."""

import os
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from fltea.api._html import axis_html, page
from fltea.api._tables import ByAxis, frame, row, table
from fltea.api.drawing import Drawing
from fltea.identification.allan import scales
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
from fltea.records.quantity import Quantity
from fltea.spectrum.allan_curve import Allan

if TYPE_CHECKING:
    import pandas as pd


class Identified(FittedAxis, frozen=True, kw_only=True):
    """What was found out about one axis. A notebook shows it with its spectrum and Allan deviation.

    Intervals are of 95 %; their ends are None where the data do not define the parameter.
    """

    axis: str
    """Its name."""
    samples: int
    """How many there are."""
    rate_hz: float
    """How many there are in a second."""
    mean: float
    """Of the samples, in `unit`."""
    std: float
    """Standard deviation."""
    spectrum: FitSpectrum
    """The noise density, and that of the fitted model."""
    allan_curve: Allan | None
    """The Allan deviation with degrees of freedom, and with N, B and K, their intervals, sources and reasons;
    `allan` has the same points and values without these. None where the record is too short for it."""
    now: Now | None
    """Bias(T) at the end of the record, and how far the heading is off after a minute."""
    forecast: Forecast | None
    """With `forecast=True`."""
    walk: OffsetWalkFound | None
    """Whether the offset walks."""
    filter: NavigationFilter | None
    """What a plain Kalman filter is built from: the same as in the file of `--gauss-markov`."""
    bias_steps: tuple[BiasStep, ...]
    """Steps of the bias. The spectrum does not go across them."""
    motion: tuple[MotionSpan, ...]
    """When the sensor moved. Samples in motion are in no figure."""
    data_checks: tuple[DataCheck, ...]
    """What in the data can mislead."""
    withheld: str
    """Why `now`, `forecast`, `walk` and `filter` are None: what is bad in the data, and what to do; "" where
    nothing is."""
    details: AxisResult
    """All figures of `fltea identify`: parts, N, K, sentences that did not win, peaks, FLTEA."""

    def __repr__(self) -> str:
        return f"Identified({self.axis}: {self.verdict}, {self.samples} samples at {self.rate_hz:g} Hz)"

    @property
    def duration_s(self) -> float:
        """The length of the record in seconds."""
        return self.samples / self.rate_hz

    @property
    def N(self) -> Quantity:
        """White noise (angle random walk) in deg/√h, of an accelerometer in m/s²/√Hz; `.to` has others."""
        return self._figures.N.to(scales(self.unit).N.unit)

    @property
    def B(self) -> Quantity:
        """Bias instability by the Allan deviation in deg/h, of an accelerometer in m/s²; `.to` has others."""
        return self._figures.B.to(scales(self.unit).B.unit)

    @property
    def K(self) -> Quantity:
        """Random walk of the bias in deg/h/√h, of an accelerometer in m/s²/√s; `.to` has others."""
        return self._figures.K.to(scales(self.unit).K.unit)

    @property
    def bias(self) -> Quantity:
        """The bias at the end of the record (`now.bias`) in deg/s or m/s²; `.to` has others."""
        return self._figures.bias

    @property
    def _figures(self) -> Quantities:
        return quantities(self.unit, self.details.level, self.allan_curve, self.now)

    def plot(self) -> Drawing:
        """Return spectrum and Allan deviation, which a notebook shows and `.save("axis.svg")` writes."""
        return Drawing(self)

    def to_pandas(self) -> "pd.DataFrame":
        """Return a table of one row: verdict, and every figure with the ends of its interval.

        Raises:
            UsageError: pandas is not installed.
        """
        return frame([row(self.axis, self)])

    def _repr_html_(self) -> str:
        of = f"{self.samples:,} samples at {self.rate_hz:g} Hz, σ = {self.std:.3g} {self.unit}"
        withheld = f"<p><strong>Bad data.</strong> {escape(self.withheld)}</p>" if self.withheld else ""
        return page(withheld + axis_html(self.axis, self, of, self._bias()))

    def _bias(self) -> str:
        """Return the bias at the end, and what happened to it, as sentences."""
        found = []
        if self.now is not None:
            value = plus_minus(self.now.bias, self.now.bias_std)
            found.append(f"Bias({self.now.bias_s:g} s) at the end: {value} {self.unit}.")
        found += [data_check.text for data_check in self.data_checks if data_check.kind in EVENT_CHECKS]
        return " ".join(found)


class Report(ByAxis[Identified]):
    """What was found out about each axis, by its name. A notebook shows all axes."""

    def __repr__(self) -> str:
        return f"Report({', '.join(f'{name}: {found.verdict}' for name, found in self.items())})"

    def allan(self) -> "pd.DataFrame":
        """Return the Allan deviations of all axes: a row an axis and averaging time, columns as in the file.

        Raises:
            UsageError: pandas is not installed.
        """
        return table(rows(self._curves()), tuple(COLUMNS))

    def write_allan_csv(self, path: str | os.PathLike[str]) -> None:
        """Write the same to a CSV file, as `--allan-csv` does: it appears whole or not at all.

        Raises:
            FlteaError: the file cannot be written.
            ValueError: there is no curve: the record is too short for one.
        """
        write_allan(Path(path), self._curves())

    def _curves(self) -> dict[str, tuple[str, Allan]]:
        found = ((name, one.unit, one.allan_curve) for name, one in self.items())
        return {name: (unit, curve) for name, unit, curve in found if curve is not None}

    def _repr_html_(self) -> str:
        return "".join(found._repr_html_() for found in self.values())
