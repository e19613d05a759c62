"""The newest fits of a device's axes, this computer's and the device's own."""

from typing import NamedTuple

from fltea.records.device_fit import DeviceAxisFit, DeviceSpectrum
from fltea.records.fit import AxisFit, FitAllan, FitSpectrum
from fltea.records.records import DeviceFits, Fit


class Curves(NamedTuple):
    """The newest curves of an axis."""

    spectrum: FitSpectrum | None = None
    allan: FitAllan | None = None


class Fits:
    """Takes records of fits; what it has goes on through epochs of the same sensor.

    newest: the last record. axes, curves: by axis, the last fit and the last curves. device, device_spectra:
    by axis, the device's own last fit of the epoch, and its last bins.
    """

    def __init__(self) -> None:
        self.newest: Fit | None = None
        self.axes: dict[str, AxisFit] = {}
        self.curves: dict[str, Curves] = {}
        self.device: dict[str, DeviceAxisFit] = {}
        self.device_spectra: dict[str, DeviceSpectrum] = {}

    def begin(self) -> None:
        """Begin an epoch: the device's own fits are of one epoch."""
        self.device, self.device_spectra = {}, {}

    def take(self, record: Fit) -> None:
        """Take a fit of this computer; one of fewer samples is of another sensor."""
        if self.newest is not None and record.samples < self.newest.samples:
            self.axes, self.curves = {}, {}
        self.newest = record
        self.axes |= record.axes
        for axis, found in record.axes.items():
            if found.spectrum is not None or found.allan is not None:
                before = self.curves.get(axis, Curves())
                self.curves[axis] = Curves(found.spectrum or before.spectrum, found.allan or before.allan)

    def take_device(self, record: DeviceFits) -> None:
        """Take a fit of the device."""
        self.device |= record.axes
        for axis, found in record.axes.items():
            if found.spectrum is not None:
                self.device_spectra[axis] = found.spectrum
