"""The live fit without a daemon: arrays in as they come, fits out whenever they are wanted."""

from collections.abc import Mapping, Sequence

from numpy.typing import ArrayLike

from fltea.api._check import finite, period_s
from fltea.api._html import axis_html, page
from fltea.api._tables import ByAxis
from fltea.records.fit import AxisFit
from fltea.records.records import AXES
from fltea.settings.live import LiveConfig
from fltea.spectrum.live_axes import LiveAxes


class LiveReport(ByAxis[AxisFit]):
    """The fits of all axes by name, of as many samples. A notebook shows all axes."""

    def __init__(self, axes: Mapping[str, AxisFit], samples: int, rate_hz: float) -> None:
        super().__init__(axes)
        self.samples, self.rate_hz = samples, rate_hz

    def __repr__(self) -> str:
        axes = ", ".join(f"{name}: {fit.verdict}" for name, fit in self.items())
        return f"LiveReport({self.samples} samples, {axes})"

    def _repr_html_(self) -> str:
        heading = f"{self.samples:,} samples at {self.rate_hz:g} Hz"
        return "".join(page(axis_html(name, fit, heading)) for name, fit in self.items())


class Live:
    """Accumulates samples of some axes, in constant memory, and fits them when asked.

    Args:
        rate_hz: sample rate in Hz.
        axes: their names.
        unit: of the samples.
        memory: time constant with which older samples are forgotten, such as "10min"; None: nothing is.

    Raises:
        ValueError: an impossible rate or memory; no axes, or two of one name.
    """

    def __init__(
        self, rate_hz: float, axes: Sequence[str] = AXES, *, unit: str = "deg/s", memory: str | None = None
    ) -> None:
        names = (axes,) if isinstance(axes, str) else tuple(axes)
        if not names or len(set(names)) != len(names):
            raise ValueError(f"axes are one or more names, each of them once, got {names}")
        self.rate_hz, self.axes = rate_hz, names
        self._live = LiveAxes(names, period_s(rate_hz), LiveConfig(memory=memory), unit)

    @property
    def samples(self) -> int:
        """The number of samples of an axis that were taken."""
        return self._live.samples

    def add(self, y: ArrayLike) -> None:
        """Take the next samples, (n, axes), or (n,) where there is one axis.

        Raises:
            ValueError: another shape, or values that are not finite; then nothing is taken.
        """
        found = finite(y, "y", "report lost samples by skip(count).")
        if found.ndim == 1 and len(self.axes) == 1:
            found = found[:, None]
        if found.ndim != 2 or found.shape[1] != len(self.axes):
            raise ValueError(
                f"y has a column an axis, (n, {len(self.axes)}) for {', '.join(self.axes)}, "
                f"got shape {found.shape}"
            )
        if len(found):
            self._live.add(found)

    def skip(self, count: int) -> None:
        """Take note of so many lost samples of all axes: nothing is computed across a longer gap.

        Raises:
            ValueError: count is below 1.
        """
        if count < 1:
            raise ValueError(f"count is how many samples are lost, 1 or more, got {count}")
        self._live.skip(count)

    def fit(self, *, curves: bool = True, last: bool = False) -> LiveReport:
        """Return what the noise is, by all samples so far.

        Args:
            curves: with spectrum and Allan deviation.
            last: the record is at its end and this is the only look at it. Looks while it grows are judged
                more strictly, so that all of them together give few false alarms.
        """
        return LiveReport(self._live.fit(curves=curves, last=last), self.samples, self.rate_hz)
