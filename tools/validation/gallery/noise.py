"""One noise of the gallery: its parts, what is added to them, and how its samples are changed afterwards."""

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from fltea.records.arrays import Array
from fltea.records.fit import VerdictKind

from tools.validation.gallery.parts import Arfima, Flicker, Fractional, Part
from tools.validation.gallery.periodic import Glitches, WanderingLine

Treatment = Callable[[Array, np.random.Generator], Array]
"""Function that changes the samples of a finished record, for example by rounding, and returns the changed
samples.
"""

Truth = Literal[
    "white",
    "relaxations",
    "order",
    "rising",
    "resonance",
    "walk",
    "low-pass",
    "high-pass",
    "high-passed relaxations",
    "notch",
    "filtered order",
    "held",
]
"""The kinds of spectra that noises have. Spectral lines, drift and changes of the noise do not matter here.
"""


class Line(NamedTuple):
    """A sine of constant frequency, which is aliased by sampling.

    `of` says what the number `hz` means:
        "hz": the frequency [Hz];
        "rate": the frequency divided by the sample rate;
        "nyquist": half the sample rate minus the frequency [Hz].
    """

    hz: float
    amplitude: float
    of: Literal["hz", "rate", "nyquist"] = "hz"

    def at(self, rate_hz: float) -> float:
        """Return the frequency before aliasing [Hz]."""
        if self.of == "rate":
            return self.hz * rate_hz
        return rate_hz / 2 - self.hz if self.of == "nyquist" else self.hz

    def folded(self, rate_hz: float) -> float:
        """Return the aliased frequency [Hz]."""
        at = self.at(rate_hz) % rate_hz
        return min(at, rate_hz - at)

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """Return `n` samples with random phase."""
        step = 2 * math.pi * self.at(rate_hz) / rate_hz
        return np.asarray(self.amplitude * np.sin(step * np.arange(n) + rng.uniform(0, 2 * math.pi)))


class Drift(NamedTuple):
    """An offset that changes during the record by `size` standard deviations of the white noise.

    The offset follows a ramp, or a warm-up whose time constant is a fifth of the record.
    """

    size: float
    shape: Literal["ramp", "warm-up"] = "ramp"

    def draw(self, n: int) -> Array:
        """Return the offset, (n,)."""
        t = np.arange(n) / n
        return self.size * (t if self.shape == "ramp" else 1 - np.exp(-5 * t))


def rounded(sigma: float) -> Treatment:
    """Return a treatment that rounds samples to whole counts.

    Before rounding, the samples are scaled to the standard deviation `sigma`, and 0.3 is added [counts].
    """
    return lambda y, rng: np.asarray(np.rint(sigma * y / y.std() + 0.3))


def outliers(y: Array, rng: np.random.Generator) -> Array:
    """Replace one sample in 1,000, on average, by ± 20."""
    return np.where(rng.random(len(y)) < 1e-3, 20.0 * rng.choice([-1.0, 1.0], len(y)), y)


def bursts(y: Array, rng: np.random.Generator) -> Array:
    """Replace groups of 20 samples, at random times, by large random numbers.

    They are three times random numbers from Student's t distribution with two degrees of freedom.
    """
    inside = np.zeros(len(y), dtype=bool)
    for at in np.flatnonzero(rng.random(len(y)) < 1 / 2_000).tolist():
        inside[at : at + 20] = True
    y = y.copy()
    y[inside] = 3 * rng.standard_t(2, int(inside.sum()))
    return y


def wander(y: Array, rng: np.random.Generator) -> Array:
    """Let the variance rise once by a factor of 2 and fall once by a factor of 2 during the record."""
    return y * np.exp(math.log(2) / 2 * np.sin(2 * math.pi * np.arange(len(y)) / len(y)))


def step(y: Array, rng: np.random.Generator) -> Array:
    """Double the variance in the middle of the record."""
    return y * np.where(np.arange(len(y)) < len(y) // 2, 1.0, math.sqrt(2))


def swinging(half: int, ratio: float) -> Treatment:
    """Return a treatment that multiplies every other group of `half` samples by `ratio`."""

    def treatment(y: Array, rng: np.random.Generator) -> Array:
        up = (np.arange(len(y)) + rng.integers(2 * half)) // half % 2
        return y * np.where(up, ratio, 1.0)

    return treatment


def dead_band(share: float) -> Treatment:
    """Return a treatment that sets small samples to 0.

    `share`: largest size of such samples, divided by the standard deviation of the record.
    """
    return lambda y, rng: np.where(np.abs(y) <= share * y.std(), 0.0, y)


class Accepted(NamedTuple):
    """A verdict that is accepted, though not right, on records of up to `samples` samples; and why."""

    kind: VerdictKind
    reason: str
    samples: float = math.inf


class Noise(NamedTuple):
    """A noise whose true properties are known."""

    name: str
    words: str
    """Its true properties in one line of text."""
    truth: Truth
    parts: tuple[Part, ...]
    lines: tuple[Line | Glitches | WanderingLine, ...] = ()
    drift: Drift | None = None
    treatment: Treatment | None = None
    changes: bool = False
    """Whether the noise changes during the record."""
    swings: int = 0
    """Number of samples from each change of the noise's power to the next, if the power rises and falls by
    turns. 0 if the power never changes.
    """
    check: str = ""
    """Data check that must report a problem of this noise, whatever the verdict. Empty if the noise has no
    such problem.
    """
    spread: float | None = None
    """The `treatment` may add white noise, as rounding does. This is the variance of that noise, divided by
    the variance of all parts together. None if no white noise is added.
    """
    accepted: Accepted | None = None

    @property
    def has_order(self) -> bool:
        """Whether the verdict "fractional" is right on this noise."""
        return self.truth in ("order", "filtered order")

    @property
    def alpha(self) -> float | None:
        """The order of the noise's state D^α x = f x + ω, or of a part that is like it.

        None if the noise has neither such a state nor such a part.
        """
        for part in self.parts:
            match part:
                case Fractional():
                    return part.alpha
                case Flicker():
                    return 0.5
                case Arfima(ar=0, ma=0):
                    return part.d
        return None

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """Return one record of `n` samples."""
        y = np.zeros(n)
        for part in self.parts + self.lines:
            y += part.draw(n, rate_hz, rng)
        if self.drift is not None:
            y += self.drift.draw(n)
        return y if self.treatment is None else self.treatment(y, rng)

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """Return the density at λ without spectral lines and drift.

        If the samples are changed by a treatment, only the shape of the density is right.
        """
        total = np.sum([part.spectrum(lam, rate_hz) for part in self.parts], axis=0)
        if self.spread is None:
            return np.asarray(total)
        grid = np.pi * (np.arange(1 << 14) + 0.5) / (1 << 14)
        power = float(np.mean(np.sum([part.spectrum(grid, rate_hz) for part in self.parts], axis=0)))
        return np.asarray(total + self.spread * power)
