"""Noises of made-up sensors, and what a daemon says of them: its own live estimator, on simulated samples."""

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from fltea.noise import spectra
from fltea.records.fit import AxisFit
from fltea.records.records import GYRO_UNIT
from fltea.settings.live import LiveConfig
from fltea.spectrum.live_axes import LiveAxes
from numpy.typing import NDArray

Array = NDArray[np.float64]

RATE_HZ = 100.0


class Noise(NamedTuple):
    """N, B and K as in IEEE Std 952, in deg/s; to these may come a fractional state or a resonance.

    fractional: α, f in s^-α, and the variance of its steps. resonance: its frequency in Hz, the radius of
    its poles, and the variance of its steps. low_pass_hz: corner of two poles that all of it goes through.
    """

    N: float = 0.005
    B: float = 0.0
    K: float = 0.0
    fractional: tuple[float, float, float] | None = None
    resonance: tuple[float, float, float] | None = None
    low_pass_hz: float | None = None

    def spectrum(self, hz: Array, rate_hz: float) -> Array:
        """At frequencies > 0, so normalised that white noise of variance R has R."""
        h, turn = 1 / rate_hz, 2 * np.pi * hz
        found = (self.N**2 + self.B**2 / turn + (self.K / turn) ** 2) / h
        if self.fractional is not None:
            alpha, f, steps = self.fractional
            found = found + steps * spectra.fractional(turn * h, alpha, spectra.g_of(alpha, f, h))
        if self.resonance is not None:
            at_hz, radius, steps = self.resonance
            phi1 = 2 * radius * math.cos(2 * math.pi * at_hz * h)
            found = found + steps * spectra.ar2(turn * h, phi1, -(radius**2))
        if self.low_pass_hz is not None:
            found = found / (1 + (hz / self.low_pass_hz) ** 4)
        return np.asarray(found)

    def draw(self, samples: int, rng: np.random.Generator, rate_hz: float = RATE_HZ) -> Array:
        """A record (samples,): half a period of periodic noise, so that its ends do not know each other."""
        whole = np.fft.rfft(rng.standard_normal(2 * samples))
        hz = np.asarray(np.fft.rfftfreq(2 * samples, 1 / rate_hz), dtype=np.float64)
        whole[0] = 0.0
        whole[1:] *= np.sqrt(self.spectrum(hz[1:], rate_hz))
        return np.asarray(np.fft.irfft(whole, 2 * samples)[:samples])


NOISES = {
    "white": Noise(),
    "white and drift": Noise(K=1e-4),
    "white, flicker, random walk": Noise(B=0.0035, K=0.001),
    "fractional": Noise(fractional=(0.6, -1.0, 1e-4)),
    "low-pass": Noise(low_pass_hz=20.0),
    "resonance": Noise(resonance=(12.0, 0.95, 1e-4)),
}


def fits(record: Array, at: Iterable[int], rate_hz: float = RATE_HZ) -> Iterator[AxisFit]:
    """What a daemon says of an axis, with curves, after so many samples of its record, rising."""
    live = LiveAxes(("gyro_x",), 1 / rate_hz, LiveConfig(), GYRO_UNIT)
    taken = 0
    for samples in at:
        live.add(np.ascontiguousarray(record[taken:samples, np.newaxis]))
        taken = samples
        yield live.fit(curves=True)["gyro_x"]
