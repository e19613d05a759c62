"""Models of the noise of one axis, and Gaussian noise that has their spectrum (pure).

Every model is y = x + v with white v of variance R; what x is, is its kind. The spectra are those that
`identify` fits (`spectrum.py`), with unlimited memory.
"""

import math
from collections.abc import Iterator

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.noise import spectra as spectrum
from fltea.records.fit import VerdictKind
from fltea.spectrum.composite import Composite
from fltea.spectrum.lines import Peak
from fltea.spectrum.rivals import Contest

Array = NDArray[np.float64]

AROUND = 4
"""Noise is drawn for a circle of at least this many records, of which one is cut out."""
SHORTEST_CIRCLE = 1 << 16
LEAST_GAIN = 0.5
"""BIC that a composite model has to gain over another: one or two AR(1) are both."""


class Noise(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", kw_only=True):
    """The base of all kinds of noise."""

    R_dps2: float
    """Variance of the white part v."""

    def __post_init__(self) -> None:
        _check(self.R_dps2 >= 0, f"R_dps2 is a variance and must be 0 or more, got {self.R_dps2}")

    def state_spectrum(self, lam: Array, h: float) -> Array:
        """Return the spectrum of x at λ > 0 in rad a sample, on which white noise has its variance."""
        raise NotImplementedError

    def walk_dps2(self, h: float) -> float:
        """Return the variance of a step of the random walk within x, at h s."""
        return 0.0


class White(Noise, frozen=True, tag="white"):
    """White noise alone, without a state x."""

    def state_spectrum(self, lam: Array, h: float) -> Array:
        """Return 0, the spectrum of a state that is not there."""
        return np.zeros_like(lam)


class AR1(Noise, frozen=True, tag="ar1"):
    """x_k = φ x_{k-1} + noise of variance s2."""

    phi: float
    s2_dps2: float

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_poles(self.phi)
        _check_step(self.s2_dps2)

    def state_spectrum(self, lam: Array, h: float) -> Array:
        """Return the spectrum of AR(1)."""
        return self.s2_dps2 * spectrum.ar1(lam, self.phi)


class AR2(Noise, frozen=True, tag="ar2"):
    """x_k = φ1 x_{k-1} + φ2 x_{k-2} + noise of variance s2."""

    phi1: float
    phi2: float
    s2_dps2: float

    def __post_init__(self) -> None:
        super().__post_init__()
        _check(
            abs(self.phi2) < 1 and abs(self.phi1) < 1 - self.phi2,
            f"phi1 = {self.phi1}, phi2 = {self.phi2} is not stationary",
        )
        _check_step(self.s2_dps2)

    def state_spectrum(self, lam: Array, h: float) -> Array:
        """Return the spectrum of AR(2)."""
        return self.s2_dps2 * spectrum.ar2(lam, self.phi1, self.phi2)


class TwoAR1(Noise, frozen=True, tag="two_ar1"):
    """The sum of two AR(1)."""

    phi_slow: float
    s2_slow_dps2: float
    phi_fast: float
    s2_fast_dps2: float

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_poles(self.phi_slow, self.phi_fast)
        _check_step(self.s2_slow_dps2)
        _check_step(self.s2_fast_dps2)

    def state_spectrum(self, lam: Array, h: float) -> Array:
        """Return the sum of both."""
        slow = self.s2_slow_dps2 * spectrum.ar1(lam, self.phi_slow)
        return np.asarray(slow + self.s2_fast_dps2 * spectrum.ar1(lam, self.phi_fast))


class Fractional(Noise, frozen=True, tag="fractional"):
    """D^α x = f x + ω, as in `fltea.noise.simulation`: f in s^-α, var ω = Q in (deg/s)² s^-2α."""

    alpha: float
    f: float
    Q: float

    def __post_init__(self) -> None:
        super().__post_init__()
        _check(0 <= self.alpha < spectrum.HIGHEST_ORDER, f"alpha must be in [0, 2), got {self.alpha}")
        _check(self.Q >= 0, f"Q is a variance and must be 0 or more, got {self.Q}")

    def state_spectrum(self, lam: Array, h: float) -> Array:
        """Return the spectrum of the fractional state."""
        g = spectrum.g_of(self.alpha, self.f, h)
        return spectrum.step_variance(self.alpha, self.Q, h) * spectrum.fractional(lam, self.alpha, g)


class GaussMarkovPart(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One Gauss–Markov part, by its standard deviation and correlation time."""

    sigma_dps: float
    tau_s: float

    def __post_init__(self) -> None:
        _check(self.sigma_dps >= 0, f"sigma_dps must be 0 or more, got {self.sigma_dps}")
        _check(0 < self.tau_s < math.inf, f"tau_s is a time and must be > 0, got {self.tau_s}")


class CompositeNoise(Noise, frozen=True, tag="composite"):
    """Gauss–Markov parts, a random walk and quantisation noise, as in `fltea.spectrum.composite`."""

    gauss_markov: tuple[GaussMarkovPart, ...] = ()
    K_dps_per_sqrt_s: float = 0.0
    Q_deg: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        _check(self.K_dps_per_sqrt_s >= 0, f"K_dps_per_sqrt_s must be 0 or more, got {self.K_dps_per_sqrt_s}")
        _check(self.Q_deg >= 0, f"Q_deg must be 0 or more, got {self.Q_deg}")

    def state_spectrum(self, lam: Array, h: float) -> Array:
        """Return the sum of the spectra of all parts."""
        total = self.walk_dps2(h) * spectrum.ar1(lam, 1.0) + (2 * np.sin(lam / 2) * self.Q_deg / h) ** 2
        for part in self.gauss_markov:
            s2 = -(part.sigma_dps**2) * math.expm1(-2 * h / part.tau_s)
            total = total + s2 * spectrum.ar1(lam, math.exp(-h / part.tau_s))
        return np.asarray(total)

    def walk_dps2(self, h: float) -> float:
        """Return the variance K² h of a step of the random walk, in (deg/s)²."""
        return self.K_dps_per_sqrt_s**2 * h


NoiseKind = White | AR1 | AR2 | TwoAR1 | Fractional | CompositeNoise


class Resonance(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A line or resonance apart from the model: a Lorentzian of this power and width at half its height."""

    frequency_hz: float
    width_hz: float
    variance_dps2: float

    def __post_init__(self) -> None:
        _check(self.frequency_hz > 0 and self.width_hz > 0, "frequency_hz and width_hz must be > 0")
        _check(self.variance_dps2 >= 0, f"variance_dps2 must be 0 or more, got {self.variance_dps2}")


class AxisModel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The noise of one axis, without its offset."""

    noise: NoiseKind
    resonances: tuple[Resonance, ...] = ()


def identified(
    contest: Contest,
    verdict: VerdictKind,
    peaks: tuple[Peak, ...],
    std: float,
    h: float,
    composite: Composite | None = None,
) -> AxisModel:
    """Return the model of lowest BIC that the verdict allows, and the peaks that were left out of its fit.

    verdict: a filter, a resonance or drift is not given as a fractional model, though one may fit best, and
    what is fractional not as a composite one. std: standard deviation of the whole axis, of which the peaks'
    shares are taken. h in s.
    """
    names = [name for name in ("white", "ar1", "ar2", "two_ar1", "fractional") if name in contest.models]
    if verdict in ("line", "resonance", "low-pass", "drift", "relaxations"):
        names.remove("fractional")
    best = contest.best if contest.best in names else min(names, key=lambda name: contest.models[name].bic)
    noise = noise_of(best, contest, h)
    if composite is not None and verdict != "fractional":
        gain = contest.models[best].bic - composite.bic[composite.name]
        noise = composite_noise(composite, h) if gain > LEAST_GAIN else noise
    return AxisModel(
        noise,
        tuple(
            Resonance(peak.frequency_hz, peak.width_hz, float(max(peak.power_share, 0.0) * std**2))
            for peak in peaks
        ),
    )


def composite_noise(found: Composite, h: float) -> CompositeNoise:
    """Return the noise of a composite model of y in deg/s, at h s."""
    return CompositeNoise(
        R_dps2=found.N.value**2 / h,
        gauss_markov=tuple(
            GaussMarkovPart(part.sigma.value, part.tau_s.value) for part in found.gauss_markov
        ),
        K_dps_per_sqrt_s=found.K.value if found.K else 0.0,
        Q_deg=found.Q.value if found.Q else 0.0,
    )


def noise_of(name: str, contest: Contest, h: float) -> NoiseKind:
    """Return one of the fitted models, by its name in the contest."""
    p = contest.models[name].parameters
    R = p["R"]
    match name:
        case "white":
            return White(R_dps2=R)
        case "ar1":
            return AR1(R_dps2=R, phi=p["phi"], s2_dps2=p["s2"])
        case "ar2":
            return AR2(R_dps2=R, phi1=p["phi1"], phi2=p["phi2"], s2_dps2=p["s2"])
        case "two_ar1":
            return TwoAR1(
                R_dps2=R,
                phi_slow=p["phi_1"],
                s2_slow_dps2=p["s2_1"],
                phi_fast=p["phi_2"],
                s2_fast_dps2=p["s2_2"],
            )
        case _:
            alpha = p["alpha"]
            f, Q = spectrum.f_of(alpha, p["g"], h), spectrum.noise_variance(alpha, p["s2"], h)
            return Fractional(R_dps2=R, alpha=alpha, f=f, Q=Q)


def model_spectrum(model: AxisModel, lam: Array, h: float) -> Array:
    """Return the spectrum of y at λ > 0, normalised like `periodogram`."""
    return np.asarray(_coloured(model, lam, h) + model.noise.R_dps2)


def check_stationary(model: AxisModel, h: float) -> None:
    """Raise ValueError if the model has no finite variance at a sampling period of h s."""
    noise = model.noise
    if isinstance(noise, Fractional):
        g = spectrum.g_of(noise.alpha, noise.f, h)
        if not spectrum.stationary(noise.alpha, g):
            raise ValueError(f"α = {noise.alpha:g}, f = {noise.f:g} is not stationary at h = {h:g} s")
    for resonance in model.resonances:
        if resonance.frequency_hz >= 0.5 / h:
            raise ValueError(f"a resonance at {resonance.frequency_hz:g} Hz is above half the sample rate")


def draw(model: AxisModel, h: float, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw n samples of Gaussian noise with the model's spectrum: y and, of it, what is not white, x; (n,).

    Waves longer than AROUND records are left out, for they are offset; not those of a random walk.
    """
    return next(draws(model, h, n, rng))


def draws(
    model: AxisModel, h: float, n: int, rng: np.random.Generator, mean_of: int = 1
) -> Iterator[tuple[Array, Array]]:
    """Yield the same again and again, without end; each number is the mean of `mean_of` samples."""
    circle = 1 << (max(AROUND * n, SHORTEST_CIRCLE) - 1).bit_length()
    lam = 2 * np.pi * np.arange(1, circle // 2 + 1) / circle
    size = np.sqrt(_of_means(model, lam, h, mean_of) * (circle / 2))
    R = model.noise.R_dps2 / mean_of
    # Steps of a random walk have a mean, too, which is the one wave that a circle does not have.
    tilt = math.sqrt(model.noise.walk_dps2(h) * mean_of / circle)
    while True:
        waves = np.zeros(circle // 2 + 1, dtype=np.complex128)
        waves[1:] = rng.standard_normal(circle // 2) + 1j * rng.standard_normal(circle // 2)
        waves[-1] = math.sqrt(2) * waves[-1].real
        waves[1:] *= size
        x = np.fft.irfft(waves, circle)[:n]
        if tilt:
            x += tilt * rng.standard_normal() * np.arange(n)
        yield x + math.sqrt(R) * rng.standard_normal(n), x


def _of_means(model: AxisModel, lam: Array, h: float, count: int) -> Array:
    """Return the spectrum of means of `count` samples of what is not white, at λ in rad a mean."""
    if count == 1:
        return _coloured(model, lam, h)
    total = np.zeros_like(lam)
    for i in range(count):  # the frequencies that look alike
        fine = (lam + 2 * np.pi * i) / count
        fine = np.minimum(fine, 2 * np.pi - fine)
        total += _coloured(model, fine, h) * (np.sin(count * fine / 2) / (count * np.sin(fine / 2))) ** 2
    return total / count


def _coloured(model: AxisModel, lam: Array, h: float) -> Array:
    total = model.noise.state_spectrum(lam, h)
    frequency_hz = lam / (2 * np.pi * h)
    for r in model.resonances:
        half = r.width_hz / 2
        shape = 1 / (1 + ((frequency_hz - r.frequency_hz) / half) ** 2)
        low, high = np.arctan(np.array([-r.frequency_hz, 0.5 / h - r.frequency_hz]) / half)
        # Its mean over 0 ... Nyquist's frequency is to be the variance.
        total = total + r.variance_dps2 * shape * (0.5 / h) / (half * (high - low))
    return np.asarray(total)


def _check(holds: bool, otherwise: str) -> None:
    if not holds:
        raise ValueError(otherwise)


def _check_poles(*phi: float) -> None:
    for value in phi:
        _check(abs(value) < 1, f"phi must be between -1 and 1, got {value}")


def _check_step(s2: float) -> None:
    _check(s2 >= 0, f"s2_dps2 is a variance and must be 0 or more, got {s2}")
