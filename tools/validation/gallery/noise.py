"""One noise of the gallery: what it is made of, and a record of it."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tools.validation.gallery.additions import Drift, Line, Treatment
from tools.validation.gallery.parts import Part

Array = NDArray[np.float64]

Truth = Literal[
    "white",
    "relaxations",
    "order",
    "rising",
    "resonance",
    "walk",
    "low-pass",
    "filtered order",
    "held",
]
"""What the spectrum is, apart from lines, drift and changes."""


class Noise(NamedTuple):
    """A noise whose truth is known."""

    name: str
    words: str
    """its truth in a line"""
    truth: Truth
    parts: tuple[Part, ...]
    lines: tuple[Line, ...] = ()
    drift: Drift | None = None
    treatment: Treatment | None = None
    changes: bool = False
    """it is not the same at the end as at the beginning"""
    spread: float | None = None
    """variance that the treatment brings with it as white noise, the parts having 1; None: none"""

    def draw(self, n: int, rate_hz: float, rng: np.random.Generator) -> Array:
        """One record of n samples."""
        y = np.zeros(n)
        for part in self.parts:
            y += part.draw(n, rate_hz, rng)
        for line in self.lines:
            y += line.draw(n, rate_hz, rng)
        if self.drift is not None:
            y += self.drift.draw(n)
        return y if self.treatment is None else self.treatment.treat(y, rng)

    def spectrum(self, lam: Array, rate_hz: float) -> Array:
        """The density at λ without lines and drift; of what is changed or rounded its shape only."""
        total = np.sum([part.spectrum(lam, rate_hz) for part in self.parts], axis=0)
        if self.spread is None:
            return np.asarray(total)
        grid = np.pi * (np.arange(1 << 14) + 0.5) / (1 << 14)
        power = float(np.mean(np.sum([part.spectrum(grid, rate_hz) for part in self.parts], axis=0)))
        return np.asarray(total + self.spread * power)


def named(noises: Sequence[Noise]) -> dict[str, Noise]:
    """By name, each once."""
    found = {one.name: one for one in noises}
    if len(found) != len(noises):
        raise ValueError("two noises have the same name")
    return found
