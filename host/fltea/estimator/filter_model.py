"""Define the fitted order α and parameter f. Filters get them together with the Q and R of the same fit."""

import math
from typing import NamedTuple


class FilterModel(NamedTuple):
    """An order and a parameter with their standard deviations, from a maximum-likelihood fit of all samples.

    F = h^α f + α is the factor of the previous state in the next one; h is the sampling period. The samples
    determine F best. The errors of F and α are taken as independent of each other.
    """

    alpha: float
    alpha_std: float
    F: float
    F_std: float
    f: float
    f_std: float

    def of_joint(self) -> tuple[float, float, float, float, float]:
        """Return α, β = h^α f, var α, the covariance of α and β, and var β; h is the sampling period."""
        a, F = self.alpha_std**2, self.F_std**2
        return self.alpha, self.F - self.alpha, a, -a, a + F

    def of_triple(self) -> tuple[float, float, float, float, float]:
        """Return α, f, the variance of α, a covariance of 0, and the variance of f, for separate filters."""
        return self.alpha, self.f, self.alpha_std**2, 0.0, self.f_std**2

    @property
    def is_sound(self) -> bool:
        """Whether all numbers are finite, α is in [0, 2], and no standard deviation is negative."""
        deviations = self.alpha_std, self.F_std, self.f_std
        return all(map(math.isfinite, self)) and 0 <= self.alpha <= 2 and min(deviations) >= 0
