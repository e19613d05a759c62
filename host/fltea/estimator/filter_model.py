"""What filters go on with once the noise is known: order and parameter that belong to their Q and R."""

import math
from typing import NamedTuple


class FilterModel(NamedTuple):
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
