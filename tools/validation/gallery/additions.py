"""What is added to a noise or done to its samples: lines, drift, rounding, outliers, a changing size."""

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tools.validation.gallery.recursions import Relaxing

Array = NDArray[np.float64]


class Line(NamedTuple):
    """A sine of constant frequency, which folds at half the sample rate as samples do."""

    hz: float
    amplitude: float
    of: str = "hz"
    """hz; "rate": hz is a share of the sample rate; "nyquist": hz below half the rate"""

    def at(self, rate_hz: float) -> float:
        """Before it folds, in Hz."""
        if self.of == "rate":
            return self.hz * rate_hz
        return rate_hz / 2 - self.hz if self.of == "nyquist" else self.hz

    def folded(self, rate_hz: float) -> float:
        """Where it is seen, in Hz."""
        at = self.at(rate_hz) % rate_hz
        return min(at, rate_hz - at)

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """So many samples, of any phase."""
        phase = rng.uniform(0, 2 * math.pi)
        step = 2 * math.pi * self.at(rate_hz) / rate_hz
        return np.asarray(self.amplitude * np.sin(step * np.arange(n) + phase))


class Drift(NamedTuple):
    """An offset that moves over the record: a ramp, or a warm-up with a fifth of it as time constant."""

    size: float
    """in standard deviations of the white noise, over the record"""
    shape: str = "ramp"

    def draw(self, n: int) -> Array:
        """The offset."""
        t = np.arange(n) / n
        return self.size * (t if self.shape == "ramp" else 1 - np.exp(-5 * t))


class Treatment(Protocol):
    """Something done to the samples."""

    def treat(self, y: Array, rng: np.random.Generator) -> Array:
        """What comes out."""
        ...


class Rounded(NamedTuple):
    """To whole counts, of an offset of 0.3 counts."""

    sigma: float
    """in counts"""

    def treat(self, y: Array, rng: np.random.Generator) -> Array:
        """See `Treatment`."""
        return np.asarray(np.rint(self.sigma * y / y.std() + 0.3))


class Outliers(NamedTuple):
    """Some samples are replaced: one in `every` by ± `size`."""

    every: int = 1_000
    size: float = 20.0

    def treat(self, y: Array, rng: np.random.Generator) -> Array:
        """See `Treatment`."""
        hit = rng.random(len(y)) < 1 / self.every
        return np.where(hit, self.size * rng.choice([-1.0, 1.0], len(y)), y)


class Bursts(NamedTuple):
    """Now and then 20 samples are three times as large, of Student's t with two degrees."""

    every: int = 2_000
    length: int = 20

    def treat(self, y: Array, rng: np.random.Generator) -> Array:
        """See `Treatment`."""
        inside = np.zeros(len(y), dtype=bool)
        for at in np.flatnonzero(rng.random(len(y)) < 1 / self.every).tolist():
            inside[at : at + self.length] = True
        y = y.copy()
        y[inside] = 3 * rng.standard_t(2, int(inside.sum()))
        return y


class Wander(NamedTuple):
    """The variance goes up and down once over the record, by e^±swing."""

    swing: float = math.log(2)

    def treat(self, y: Array, rng: np.random.Generator) -> Array:
        """See `Treatment`."""
        return y * np.exp(self.swing / 2 * np.sin(2 * math.pi * np.arange(len(y)) / len(y)))


class Step(NamedTuple):
    """The variance changes in the middle of the record."""

    ratio: float = 2.0

    def treat(self, y: Array, rng: np.random.Generator) -> Array:
        """See `Treatment`."""
        y = y.copy()
        y[len(y) // 2 :] *= math.sqrt(self.ratio)
        return y


class Repeated(NamedTuple):
    """White noise whose every tenth sample is that before it again."""

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """See `Part`."""
        k = np.arange(n)
        fresh = rng.standard_normal(n)
        return np.asarray(fresh[k - (k % 10 == 9)])

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """See `Part`; the mean over the ten."""
        return np.asarray(1 + 0.2 * np.cos(lam))


class Held(NamedTuple):
    """White noise of a chip that has two new values for five readings."""

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """See `Part`."""
        return np.asarray(rng.standard_normal(2 * (n // 5 + 1))[(2 * np.arange(n)) // 5])

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """See `Part`; the mean over the five."""
        return np.asarray(1 + 1.2 * np.cos(lam) + 0.4 * np.cos(2 * lam))


class Jittered(NamedTuple):
    """A relaxation read up to half a period late, each time another time, in white noise of the reader."""

    hz: float
    height: float
    steps: int = 16
    """of time in a period"""

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """See `Part`."""
        source = Relaxing(self.hz, self.steps * rate_hz, rng)
        size = math.sqrt(self.height * self._scale(rate_hz))
        y, piece = rng.standard_normal(n), 1 << 18
        for at in range(0, n, piece):
            count = min(piece, n - at)
            fine = source.next(count * self.steps)
            late = rng.integers(0, self.steps // 2, count)
            y[at : at + count] += size * fine[np.arange(count) * self.steps + late]
        return y

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """See `Part`; from the autocorrelation, whose lags are spread by the jitter."""
        a = 2 * math.pi * self.hz / rate_hz
        late = np.arange(self.steps // 2) / self.steps
        spread = float(np.exp(-a * late).mean() * np.exp(a * late).mean())
        pole = math.exp(-a)
        ar1 = (1 - pole**2) / ((1 - pole) ** 2 + 4 * pole * np.sin(lam / 2) ** 2)
        fine = math.exp(-a / self.steps)
        variance = self.height * self._scale(rate_hz) * (1 - fine) / (1 + fine)
        return np.asarray(1 + variance * (1 - spread + spread * ar1))

    def _scale(self, rate_hz: float) -> float:
        """So that the density is `height` at low frequencies, as sampled without jitter."""
        pole = math.exp(-2 * math.pi * self.hz / rate_hz)
        fine = math.exp(-2 * math.pi * self.hz / (self.steps * rate_hz))
        return (1 - pole) / (1 + pole) * (1 + fine) / (1 - fine)
