"""Simulates noises of sensors, and makes fits for any number of sensors with the daemon's own live estimator.

A few records are simulated and fitted; the other fits are scaled from these. If the samples of a noise are
multiplied by `factor`, its fit stays the same, but N, B, K and the densities are multiplied by `factor`, and
R by its square. Sensors whose noises differ only by a factor therefore share about thirty fits.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from typing import NamedTuple

import numpy as np
from fltea.noise import spectra
from fltea.records.arrays import Array
from fltea.records.fit import AxisFit, FitAllan, FitSpectrum, Interval
from fltea.records.records import GYRO_UNIT
from fltea.settings.live import LiveConfig
from fltea.spectrum.live_axes import LiveAxes
from msgspec.structs import replace
from scipy.signal import lfilter

Draw = Callable[[np.random.Generator], Array]

RATE_HZ = 100.0


class Noise(NamedTuple):
    """Noise of a gyroscope axis.

    `N`, `B`, `K`: as in IEEE Std 952, in deg/s. `fractional`: for a noise of fractional order, its order α,
    its f [s^-α] and the variance of its steps. `resonance`: frequency of the resonance [Hz], radius of its
    poles and variance of its steps.
    `low_pass_hz`: corner frequency of a two-pole low-pass filter through which all the noise passes.
    """

    N: float = 0.005
    B: float = 0.0
    K: float = 0.0
    fractional: tuple[float, float, float] | None = None
    resonance: tuple[float, float, float] | None = None
    low_pass_hz: float | None = None

    def spectrum(self, hz: Array, rate_hz: float) -> Array:
        """Return the spectral density at frequencies `hz` > 0.

        The density is normalised so that white noise of variance R has the density R.
        """
        h, turn = 1 / rate_hz, 2 * np.pi * hz
        found = (self.N**2 + self.B**2 / turn + (self.K / turn) ** 2) / h
        if self.fractional is not None:
            alpha, f, steps = self.fractional
            found = found + steps * spectra.fractional(turn * h, alpha, spectra.g_of(alpha, f, h))
        if self.resonance is not None:
            at_hz, radius, steps = self.resonance
            phi1 = 2 * radius * math.cos(2 * math.pi * at_hz * h)
            z = np.exp(-1j * turn * h)
            found = found + steps / np.abs(1 - z * (phi1 - radius**2 * z)) ** 2
        if self.low_pass_hz is not None:
            found = found / (1 + (hz / self.low_pass_hz) ** 4)
        return np.asarray(found)

    def draw(self, samples: int, rng: np.random.Generator, rate_hz: float = RATE_HZ) -> Array:
        """Return the samples of a record, an array of shape (samples,).

        A noise that repeats after 2 `samples` is drawn, and its first half returned. In a whole period, the
        last samples would be correlated with the first ones.
        """
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
    """Yield the fits that the daemon would make of an axis, one after each number of samples in `at`.

    Each fit includes its curves, such as the spectrum. The numbers in `at` rise.
    """
    live = LiveAxes(("gyro_x",), 1 / rate_hz, LiveConfig(), GYRO_UNIT)
    taken = 0
    for samples in at:
        live.add(np.ascontiguousarray(record[taken:samples, np.newaxis]))
        taken = samples
        yield live.fit(curves=True)["gyro_x"]


SAMPLES = 1 << 17
LONG = 1 << 19
"""Number of samples in a record of the fractional noise. From so many samples, α is known to ± 0.05."""
USUAL = Noise(B=0.003, K=0.0015)
"""Noise of most axes. From its records, N, B and K can all be estimated."""
USUAL_FITS, RELAXING_FITS, OTHER_FITS = 12, 4, 2
OTHERS = 0.3
"""Proportion of unusual noises among the axes of chips of the first kind; `OTHER` has these noises."""


class Changed(NamedTuple):
    """A change of the usual noise: `figure` (N, B or K) is multiplied by `times`."""

    figure: str
    times: float


def _white(rng: np.random.Generator, samples: int = SAMPLES) -> Array:
    return Noise().draw(samples, rng)


def _time_s() -> Array:
    return np.arange(SAMPLES) / RATE_HZ


def _relaxation(rng: np.random.Generator) -> Array:
    return np.asarray(_white(rng) + 0.01 * lfilter([1.0], [1.0, -0.97], rng.standard_normal(SAMPLES)))


OTHER: dict[str, Draw] = {
    "white": _white,
    "warming up": lambda rng: _white(rng) + 0.004 * _time_s() / _time_s()[-1],
    "fractional": lambda rng: Noise(fractional=(0.6, -1.0, 1e-4)).draw(LONG, rng),
    "filtered": lambda rng: Noise(low_pass_hz=20.0).draw(SAMPLES, rng),
    "loose": lambda rng: Noise(resonance=(12.0, 0.95, 5e-5)).draw(SAMPLES, rng),
    "beside a motor": lambda rng: _white(rng) + 0.01 * np.sin(2 * np.pi * 17.3 * _time_s()),
    "differentiated": lambda rng: _white(rng) + 0.02 * np.diff(rng.standard_normal(SAMPLES + 1)),
    "changed": lambda rng: _white(rng) * np.where(np.arange(SAMPLES) < SAMPLES // 2, 1.0, 1.2),
    "asleep": lambda _: np.full(SAMPLES, 0.1),
    "just begun": lambda rng: _white(rng, 30),
}
"""For the name of each unusual noise: the function that draws a record of it. The fractional noise is drawn
twice as often as each other noise.

These noises have about the same N as the usual noise, so that no sensor is an outlier in N.
"""

RELAXING = "relaxing"
"""Name of the noise of the second kind of chip in a simulated fleet: white noise and a relaxation."""


def axis_fit(rng: np.random.Generator, factor: float, *, second: bool, changed: Changed | None) -> AxisFit:
    """Return the fit of an axis whose noise is `factor` times as strong as usual.

    `rng` draws the kind of noise.

    `second`: whether the axis belongs to the second kind of chip. `changed`: if given, no kind is drawn: the
    axis has the usual noise, but with this figure changed.
    """
    if changed is not None:
        return scaled(_fit("usual", 0, changed), factor)
    kind, count = "usual", USUAL_FITS
    if second:
        kind, count = RELAXING, RELAXING_FITS
    elif rng.random() < OTHERS:
        kind, count = str(rng.choice([*OTHER, "fractional"])), OTHER_FITS
    return scaled(_fit(kind, int(rng.integers(count)), None), factor)


@cache
def _fit(kind: str, number: int, changed: Changed | None) -> AxisFit:
    rng = np.random.default_rng((number, *kind.encode()))
    if kind == "usual":
        noise = USUAL
        if changed is not None:
            usual = getattr(USUAL, changed.figure)
            noise = USUAL._replace(**{changed.figure: usual * changed.times})
        record = noise.draw(SAMPLES, rng)
    else:
        record = (_relaxation if kind == RELAXING else OTHER[kind])(rng)
    return next(fits(record, [len(record)]))


def scaled(fit: AxisFit, factor: float) -> AxisFit:
    """Return the fit that the same samples multiplied by `factor` would have."""
    allan, spectrum = fit.allan, fit.spectrum
    if allan is not None:
        adev, low, high, model = (
            _times(one, factor) for one in (allan.adev, allan.low, allan.high, allan.model)
        )
        N, B, K = (None if one is None else one * factor for one in (allan.N, allan.B, allan.K))
        allan = FitAllan(allan.tau_s, adev, low, high, model, N, B, K)
    if spectrum is not None:
        curves = (_times(one, factor) for one in (spectrum.density, spectrum.model))
        spectrum = FitSpectrum(spectrum.hz, *curves)
    variances = {"s2": _interval(fit.s2, factor**2), "R": _interval(fit.R, factor**2)}
    return replace(fit, allan=allan, spectrum=spectrum, **variances)


def _times(curve: list[float], factor: float) -> list[float]:
    return [one * factor for one in curve]


def _interval(one: Interval, factor: float) -> Interval:
    return Interval(*(None if end is None else end * factor for end in (one.value, one.low, one.high)))
