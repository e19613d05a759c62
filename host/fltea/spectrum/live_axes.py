"""The live fit of all axes of one sensor: samples in, `AxisFit` out whenever it is asked for."""

import numpy as np
from numpy.typing import NDArray

from fltea.noise.spectra import f_of
from fltea.records.fit import AxisFit, FitSpectrum, Interval, Until
from fltea.settings.live import LiveConfig
from fltea.spectrum.models import parameters
from fltea.spectrum.periodogram import periodogram
from fltea.spectrum.profile import Parameter, fractional_fit
from fltea.spectrum.spectral import examine
from fltea.spectrum.verdict import LEVEL, decide

Array = NDArray[np.float64]


class LiveAxes:
    """Accumulates samples of `axes` and fits them.

    h: sampling period in s. unit: of the samples. saved: what `save` returned, to go on from there.

    Raises:
        ValueError: `saved` is not sound, or of other axes.
    """

    def __init__(
        self, axes: tuple[str, ...], h: float, settings: LiveConfig, unit: str, saved: bytes | None = None
    ) -> None:
        self.axes, self.h, self.unit = axes, h, unit
        self._settings = settings
        self._rows: list[Array] = []
        self.samples = 0

    def add(self, y: Array) -> None:
        """Take samples (n, axes)."""
        self._rows.append(np.array(y, dtype=np.float64))
        self.samples += len(y)

    def skip(self, count: int) -> None:
        """Take note of lost samples of all axes."""

    def fit(self, *, curves: bool) -> dict[str, AxisFit]:
        """Fit every axis; curves: with spectrum and Allan deviation."""
        y = np.concatenate(self._rows) if self._rows else np.empty((0, len(self.axes)))
        return {axis: self._fit(y[:, i], curves) for i, axis in enumerate(self.axes)}

    def save(self) -> bytes:
        """All of it, for a later run."""
        return b""

    def _fit(self, y: Array, curves: bool) -> AxisFit:
        try:
            seen = examine(periodogram(y, self.h), len(y) * self.h, len(y))
        except ValueError as error:
            return AxisFit("too few samples", f"{error}.", self.unit)
        e = seen.evidence
        verdict = decide(e)
        p = parameters(seen.fits.full.theta[0])
        found = fractional_fit(seen.fits.data, seen.fits.full, self.h, white=e.p_clean >= LEVEL)
        spectrum = None
        if curves:
            lam, to_density = seen.fits.data.lam, 2 * self.h
            model = np.sqrt(seen.fits.full.spectrum(lam)[0] * to_density)
            density = np.sqrt(seen.fits.data.power[0] * to_density)
            hz = lam / (2 * np.pi * self.h)
            spectrum = FitSpectrum(hz.tolist(), density.tolist(), model.tolist())
        return AxisFit(
            verdict.kind,
            verdict.text,
            self.unit,
            e.p_all,
            _interval(found.alpha),
            Interval(f_of(float(p.alpha), float(p.g), self.h), found.f.low, found.f.high),
            _interval(found.F),
            _interval(found.s2),
            _interval(found.R),
            [(float(a), float(b)) for a, b in seen.band.notch_hz],
            {},
            Until(self._settings.target),
            None,
            spectrum,
        )


def _interval(p: Parameter) -> Interval:
    return Interval(p.value, p.low, p.high)
