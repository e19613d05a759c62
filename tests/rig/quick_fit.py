"""Replace the live fit by one that takes no time, to test its inputs and the moments of its calls."""

import hashlib
from collections.abc import Callable
from functools import partial

import numpy as np
from fltea.noise.parts import Relaxation, White
from fltea.records.fit import AxisFit, FitSpectrum, Interval
from fltea.settings.live import LiveConfig
from fltea.spectrum.live_axes import AxisRefit, Noise
from fltea.spectrum.octaves import Octaves
from numpy.typing import NDArray


class QuickAxes:
    """A replacement of `fltea.spectrum.live_axes.LiveAxes`.

    The invented figures depend on all samples and lost samples that the fit received, and on their order. So
    a wrong input shows in the figures.
    """

    longest_motion = 60_000

    def __init__(
        self, axes: tuple[str, ...], h: float, settings: LiveConfig, unit: str, saved: bytes | None = None
    ) -> None:
        self.axes, self.unit = axes, unit
        self.noticed = 0
        self.octaves = Octaves(len(axes))
        if saved is not None:
            if not saved.startswith(b"quick"):
                raise ValueError("these bytes are no sums of a live fit")
            self.octaves = Octaves.restore(len(axes), 0.0, saved.removeprefix(b"quick"))

    @property
    def samples(self) -> int:
        return self.octaves.samples

    def add(self, y: NDArray[np.float64], moving: NDArray[np.bool_]) -> None:
        assert y.shape[1] == len(self.axes)
        self.octaves.add(y, moving, self.longest_motion)

    def skip(self, count: int) -> None:
        self.octaves.skip(count)

    def fit(self, *, curves: bool, last: bool = False) -> dict[str, AxisFit]:
        return {axis: refit().fit for axis, refit in self.refits(curves=curves, last=last).items()}

    def refits(
        self, *, curves: bool, last: bool = False, fresh: bool = False
    ) -> dict[str, Callable[[], AxisRefit]]:
        spectrum = FitSpectrum([1.0], [2.0], [3.0]) if curves else None
        seen, end = self.octaves.save(), " at the end" if last else ""
        refitted = {axis: self._refit(axis, seen, spectrum, end) for axis in self.axes}
        return {axis: partial(dict.__getitem__, refitted, axis) for axis in self.axes}

    def save(self) -> bytes:
        return b"quick" + self.octaves.save()

    def _refit(self, axis: str, seen: bytes, spectrum: FitSpectrum | None, end: str) -> AxisRefit:
        digest = hashlib.sha256(seen + axis.encode()).digest()
        p, alpha = max(0.0, digest[0] / 127 - 1), digest[1] / 200
        noise = Noise((White(0.2), Relaxation(0.1, 0.1 + alpha)), p < 0.01, self.samples)
        s2, R = 1e-3 + digest[2] * 1e-5, 1e-2 + digest[3] * 1e-4
        fit = AxisFit(
            "white" if p >= 0.05 else "fractional",
            digest.hex() + end,
            self.unit,
            p,
            Interval(alpha, alpha - 0.1, alpha + 0.1),
            Interval(-1.0, -1.5, -0.5),
            F=Interval(0.5, 0.4, 0.6),
            s2=Interval(s2, 0.8 * s2, 1.2 * s2),
            R=Interval(R, 0.9 * R, 1.1 * R),
            left_out={"lost": self.octaves.counts(0).lost},
            spectrum=spectrum,
        )
        return AxisRefit(fit, noise)
