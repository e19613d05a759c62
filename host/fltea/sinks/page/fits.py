"""Keep the newest fits of a device's axes: those of this computer and those of the device itself."""

from typing import NamedTuple

from fltea.documents import curves as charts
from fltea.documents.chart import SMALL
from fltea.records.device_fit import DeviceAxisFit, DeviceSpectrum
from fltea.records.fit import AxisFit, FitAllan, FitSpectrum, VerdictKind
from fltea.records.records import DeviceFits, Fit

AGREE, GROWTH, APART = 4, 1.1, 1.5
"""Each fit predicts when the order of the axis will be known. The page shows this time if `AGREE` fits agree:
the longest predicted time is at most `APART` times the shortest. Each of these fits has at least `GROWTH`
times as many samples as the one before it.
"""


class Curves(NamedTuple):
    """The newest spectrum and Allan deviation of an axis."""

    spectrum: FitSpectrum | None = None
    allan: FitAllan | None = None


class Drawn:
    """The small diagram of an axis's spectrum.

    The spectrum comes from a fit of `samples` samples, which gave the verdict `verdict`.
    """

    def __init__(self, spectrum: FitSpectrum, samples: int, verdict: VerdictKind) -> None:
        self.samples, self.verdict = samples, verdict
        self._spectrum, self._svg = spectrum, ""

    def svg(self, unit: str) -> str:
        """Return the diagram as SVG, and make it at the first call. `unit`: unit of the samples."""
        self._svg = self._svg or charts.spectrum(self._spectrum, unit, height=SMALL)
        return self._svg


class TimeToTell:
    """Predicts when the order of an axis will be known, but only while the last fits agree on the time."""

    def __init__(self) -> None:
        self._newest_s = self._taken_s = 0.0
        self._totals: list[float] = []
        """Total duration of samples after which the order is known, as each of the last fits predicts it [s].
        """
        self._steady_s: float | None = None

    def take(self, samples: int, rate_hz: float, fit: AxisFit) -> None:
        """Note the time at which the order will be known, as a fit of `samples` samples predicts it."""
        seconds = fit.until_s.seconds if fit.until_s and fit.stable else None
        self._newest_s = samples / rate_hz
        if not seconds:
            self._totals, self._steady_s = [], None
        if not seconds or self._newest_s < GROWTH * self._taken_s:
            return
        self._taken_s = self._newest_s
        self._totals = [*self._totals[1 - AGREE :], self._newest_s + seconds]
        low, high = min(self._totals), max(self._totals)
        if len(self._totals) < AGREE or high > APART * low:
            self._steady_s = None
        elif self._steady_s is None or not low / APART < self._steady_s < high * APART:
            self._steady_s = sorted(self._totals)[AGREE // 2]

    @property
    def left_s(self) -> float | None:
        """Time from the newest fit until the order is known [s]; None as long as no `AGREE` fits agree."""
        return None if self._steady_s is None else max(self._steady_s - self._newest_s, 1.0)


class Fits:
    """Keeps the newest fits. They are kept from one epoch to the next if the sensor is the same.

    `newest`: the last record of the type `fit`. `axes`: for each axis its last fit. `curves`: for each axis
    its last spectrum and Allan deviation. `time_to_tell`: for each axis the prediction when its order will be
    known. `drawn`: for each axis the small diagram of its spectrum. All visitors get the same diagram. It is
    made again only if the verdict changes, or once a fit has `GROWTH` times as many samples.
    `device`: for each axis the device's own last fit in this epoch. `device_spectra`: for each axis the bins
    of the device's last spectrum.
    """

    def __init__(self) -> None:
        self.newest: Fit | None = None
        self.axes: dict[str, AxisFit] = {}
        self.curves: dict[str, Curves] = {}
        self.time_to_tell: dict[str, TimeToTell] = {}
        self.drawn: dict[str, Drawn] = {}
        self.device: dict[str, DeviceAxisFit] = {}
        self.device_spectra: dict[str, DeviceSpectrum] = {}

    def begin(self) -> None:
        """Begin an epoch, and forget the device's own fits of the previous epoch."""
        self.device, self.device_spectra = {}, {}

    def take(self, record: Fit, rate_hz: float) -> None:
        """Keep a fit that this computer has made.

        A fit with fewer samples than the previous fit belongs to another sensor. Then this computer's
        previous fits and their diagrams are forgotten.
        """
        if self.newest is not None and record.samples < self.newest.samples:
            self.axes, self.curves, self.time_to_tell, self.drawn = {}, {}, {}, {}
        self.newest = record
        self.axes |= record.axes
        for axis, found in record.axes.items():
            self.time_to_tell.setdefault(axis, TimeToTell()).take(record.samples, rate_hz, found)
            if found.spectrum is not None or found.allan is not None:
                before = self.curves.get(axis, Curves())
                self.curves[axis] = Curves(found.spectrum or before.spectrum, found.allan or before.allan)
            drawn, spectrum = self.drawn.get(axis), self.curves.get(axis, Curves()).spectrum
            if spectrum is not None and (
                drawn is None or drawn.verdict != found.verdict or record.samples >= GROWTH * drawn.samples
            ):
                self.drawn[axis] = Drawn(spectrum, record.samples, found.verdict)

    def take_device(self, record: DeviceFits) -> None:
        """Keep the fits that the device has made itself."""
        self.device |= record.axes
        for axis, found in record.axes.items():
            if found.spectrum is not None:
                self.device_spectra[axis] = found.spectrum
