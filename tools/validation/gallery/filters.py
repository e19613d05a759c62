"""What happens to noises before they are read: low-pass filters, repeated values, jitter."""

import cmath
import math
from functools import cache
from typing import NamedTuple

import numpy as np
from fltea.records.arrays import Array
from numpy.lib.stride_tricks import sliding_window_view
from scipy.signal import firwin, freqz, iirnotch

from tools.validation.gallery.parts import Relaxation
from tools.validation.recursions import Stream

AT_ONCE = 1 << 22
"""The input samples of a filter are drawn in pieces of this number of samples. This limits the memory that
long records need.
"""
OVER_CORNER = 8.0
"""Smallest ratio of the rate at which a filter runs to its corner frequency."""
MPU9250_DLPF = {250: 0.97, 184: 2.9, 92: 3.9, 41: 5.9, 20: 9.9, 10: 17.85, 5: 33.48}
"""For each bandwidth [Hz] of the MPU-9250's low-passes for the gyroscope: the delay [ms], from the register
map.
"""
CONSTANT_DELAY_MS = 1.9
"""A filter with one pole has the delay 0.159 / bandwidth. The delays in MPU9250_DLPF are longer by about this
time [ms], at all bandwidths but 250 Hz. So they are those of a filter with one pole, plus a constant.
"""


class LowPass(NamedTuple):
    """A low-pass filter such as chips have, with a gain of 1 at low frequencies.

    The filter has one pole, or the two poles of a Butterworth filter, with the corner frequency `hz`. If
    `taps` is given, these are the filter's impulse response at the rate of the output. `inner_hz`: the rate
    at which the filter runs. If it is 0, the rate is several times the corner frequency.
    """

    hz: float = 0.0
    poles: int = 1
    inner_hz: float = 0.0
    taps: tuple[float, ...] = ()

    def every(self, rate_hz: float) -> int:
        """Return the number of samples at the filter's own rate for each output sample."""
        wanted = self.inner_hz or OVER_CORNER * self.hz
        return max(1, math.ceil(wanted / rate_hz - 1e-9))

    def coefficients(self, inner_hz: float) -> tuple[list[float], list[float]]:
        """Return the coefficients b and a of the filter b(z) / a(z)."""
        if self.taps:
            return [*self.taps], [1.0]
        corner = 2 * math.pi * self.hz / inner_hz
        if self.poles == 1:
            pole = math.exp(-corner)
            return [1 - pole], [1.0, -pole]
        two = cmath.exp(corner * cmath.exp(0.75j * math.pi))
        return [abs(1 - two) ** 2], [1.0, -2 * two.real, abs(two) ** 2]

    def power(self, lam: Array, inner_hz: float) -> Array:
        """Return the squared gain at the frequencies `lam` [rad per sample at the filter's own rate]."""
        return np.asarray(np.abs(freqz(*self.coefficients(inner_hz), worN=lam)[1]) ** 2)


def moving_average(taps: int) -> LowPass:
    """Return a filter that averages the last `taps` samples."""
    return LowPass(taps=(1 / taps,) * taps)


def windowed_sinc(cut: float, taps: int = 31) -> LowPass:
    """Return a low-pass whose impulse response is a sinc in Hamming's window.

    `cut`: corner frequency divided by the sample rate.
    """
    return LowPass(taps=tuple(firwin(taps, 2 * cut).tolist()))


def mpu9250(bandwidth_hz: int) -> LowPass:
    """Return the MPU-9250's own low-pass. It runs at 1 kHz or, for a bandwidth of 250 Hz, at 8 kHz."""
    return LowPass(bandwidth_hz, 1, 8_000.0 if bandwidth_hz == 250 else 1_000.0)


class FlightFilter(LowPass):
    """A flight controller's filter: a two-pole Butterworth, and a notch of Q = 3 at four times its corner."""

    def coefficients(self, inner_hz: float) -> tuple[list[float], list[float]]:
        """Return the coefficients b and a of the filter b(z) / a(z)."""
        b, a = super().coefficients(inner_hz)
        notch_b, notch_a = iirnotch(4 * self.hz, 3.0, fs=inner_hz)
        return np.convolve(b, notch_b).tolist(), np.convolve(a, notch_a).tolist()


class Median(NamedTuple):
    """White noise after a median filter: each sample is the median of the last `samples` samples."""

    samples: int

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        windows = sliding_window_view(rng.standard_normal(n + self.samples - 1), self.samples)
        return np.asarray(np.median(windows, axis=1))

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """Return the density at the frequencies `lam` [rad per sample].

        The density is computed from the autocovariance of a long record. Medians that are `samples` or more
        apart have no input in common, so their autocovariance is 0.
        """
        found = np.full_like(lam, (covariance := _covariance(self))[0])
        for lag in range(1, self.samples):
            found += 2 * covariance[lag] * np.cos(lag * lam)
        return found


@cache
def _covariance(median: Median) -> list[float]:
    y = median.draw(1 << 20, 1.0, np.random.default_rng(0))
    return [float(y[lag:] @ y[: len(y) - lag]) / len(y) for lag in range(median.samples)]


class Through(NamedTuple):
    """White noise and relaxations that pass a filter.

    Of the filter's output, only every m-th sample is kept (decimation).
    """

    low_pass: LowPass
    inner: tuple[Relaxation, ...] = ()

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        m = self.low_pass.every(rate_hz)
        stream = Stream(*self.low_pass.coefficients(m * rate_hz))
        stream.run(rng.standard_normal(1 << 14))  # run the filter until it has forgotten its initial state
        slow = [(part.size, part.stream(rng)) for part in (one.sampled(m * rate_hz) for one in self.inner)]
        out, piece = np.empty(n), max(1, AT_ONCE // m)
        for at in range(0, n, piece):
            count = min(piece, n - at) * m
            e = rng.standard_normal(count)
            for size, one in slow:
                e += one.run(size * rng.standard_normal(count))
            # To keep only every m-th sample divides the density by m, at frequencies that the filter passes.
            # The input is therefore drawn with m times the variance.
            out[at : at + count // m] = stream.run(math.sqrt(m) * e)[::m]
        return out

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """Return the density at the frequencies `lam` [rad per sample].

        The spectrum is folded at half the output's rate, because decimation by m aliases higher frequencies.
        """
        m = self.low_pass.every(rate_hz)
        found = np.zeros_like(lam)
        for k in range(m):
            inside = (lam + 2 * np.pi * k) / m
            before = 1.0 + sum(one.spectrum(inside, m * rate_hz) for one in self.inner)
            found += before * self.low_pass.power(inside, m * rate_hz)
        return found


class Held(NamedTuple):
    """White noise of a chip that is read more often than it measures, so that some readings repeat a value.

    `fresh`: number of new values in a cycle of readings. `pattern`: the index of the value that each reading
    of the cycle gets.
    """

    pattern: tuple[int, ...]
    fresh: int

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        turn, reading = np.divmod(np.arange(n), len(self.pattern))
        values = rng.standard_normal((n // len(self.pattern) + 1) * self.fresh)
        return np.asarray(values[turn * self.fresh + np.array(self.pattern)[reading]])

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """Return the density at the frequencies `lam` [rad per sample].

        It is 1 + 2 Σ p(lag) cos(lag λ), where λ is the frequency. p(lag) is the proportion of readings whose
        value is read again `lag` readings later. It is counted over one cycle (`pattern`).
        """
        count = len(self.pattern)
        at = np.concatenate([self.pattern, np.array(self.pattern) + self.fresh])
        found = np.ones_like(lam)
        for lag in range(1, count):
            found += 2 * float((at[:count] == at[lag : lag + count]).mean()) * np.cos(lag * lam)
        return found


class Jittered(NamedTuple):
    """White noise plus a relaxation (a first-order Gauss-Markov process).

    The relaxation is read with a random delay of up to half a sampling period.

    `steps`: number of values of the relaxation that are computed in each sampling period.
    """

    hz: float
    height: float
    steps: int = 16

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        source = Relaxation(self.hz, self.height * self._scale(rate_hz)).sampled(self.steps * rate_hz)
        stream = source.stream(rng)
        y, piece = rng.standard_normal(n), 1 << 18
        for at in range(0, n, piece):
            count = min(piece, n - at)
            fine = stream.run(source.size * rng.standard_normal(count * self.steps))
            late = rng.integers(0, self.steps // 2, count)
            y[at : at + count] += fine[np.arange(count) * self.steps + late]
        return y

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """Return the density at the frequencies `lam` [rad per sample].

        The density is computed from the autocorrelation. This is averaged over the random delays with which
        the samples are read.
        """
        a = 2 * math.pi * self.hz / rate_hz
        late = np.arange(self.steps // 2) / self.steps
        spread = float(np.exp(-a * late).mean() * np.exp(a * late).mean())
        pole, fine = math.exp(-a), math.exp(-a / self.steps)
        ar1 = (1 - pole**2) / ((1 - pole) ** 2 + 4 * pole * np.sin(lam / 2) ** 2)
        variance = self.height * self._scale(rate_hz) * (1 - fine) / (1 + fine)
        return np.asarray(1 + variance * (1 - spread + spread * ar1))

    def _scale(self, rate_hz: float) -> float:
        """Return the factor by which `height` is multiplied to draw the relaxation in `steps` fine steps.

        Read once in each sampling period, without jitter, the relaxation then has the density `height` at low
        frequencies.
        """
        pole = math.exp(-2 * math.pi * self.hz / rate_hz)
        fine = math.exp(-2 * math.pi * self.hz / (self.steps * rate_hz))
        return (1 - pole) / (1 + pole) * (1 + fine) / (1 - fine)
