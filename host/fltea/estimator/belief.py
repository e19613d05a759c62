"""What filters go on with once the noise is known: order and parameter that belong to their Q and R."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fltea.records.arrays import Array


class Belief(NamedTuple):
    """An order and a parameter of known deviations, as a maximum-likelihood fit of all samples has them.

    F = h^α f + α goes about its own way, whatever α is, and is what a sample's step says most about.
    """

    alpha: float
    alpha_std: float
    F: float
    F_std: float
    f: float
    f_std: float

    def of_joint(self) -> tuple[float, float, float, float, float]:
        """Return α, β = F - α, the variance of α, their covariance and the variance of β."""
        a, F = self.alpha_std**2, self.F_std**2
        return self.alpha, self.F - self.alpha, a, -a, a + F

    def of_triple(self) -> tuple[float, float, float, float, float]:
        """Return the same of α and f, each of which has a filter of its own."""
        return self.alpha, self.f, self.alpha_std**2, 0.0, self.f_std**2

    @property
    def is_sound(self) -> bool:
        """Whether a filter can go on with it."""
        deviations = self.alpha_std, self.F_std, self.f_std
        return all(map(math.isfinite, self)) and 0 <= self.alpha <= 2 and min(deviations) >= 0


class Known(NamedTuple):
    """What is believed of α and of f in each lane, (2, 1, lanes) each; zeros in lanes without a belief.

    A filter takes its Q and R for certain, and the slope of what it predicts for that of its past too: its
    own deviation shrinks round a value that may be off. No filter can know more than the fit of the same
    samples does, and it may be as far off as it has gone from there.
    """

    value: Array
    std: Array
    counts: Array
    """1 where there is a belief"""

    @classmethod
    def of(cls, beliefs: Sequence[Belief | None]) -> "Known":
        """Return that of lanes, of which some have a belief."""
        figures = [(b.alpha, b.f, b.alpha_std, b.f_std, 1.0, 1.0) if b else (0.0,) * 6 for b in beliefs]
        return cls(*np.array(figures).T.reshape(3, 2, 1, len(beliefs)))

    @property
    def numbers(self) -> list[float]:
        """All of it in a row; nothing where there is no belief."""
        return [x for part in self for x in part.ravel().tolist()] if self.counts.any() else []

    def widen(self, values: Array, deviations: Array) -> None:
        """Make deviations of what is known of those that are the filters' own; both (2, rows, lanes)."""
        least = np.maximum(deviations, self.std)
        gone = (values - self.value) * self.counts
        np.sqrt(least * least + gone * gone, out=deviations)  # of lanes without a belief to the bit their own
