"""Define the order and parameter with which filters continue once a fit has given their Q and R."""

import math
from typing import NamedTuple


class FilterModel(NamedTuple):
    """An order and a parameter with their standard deviations, from a maximum-likelihood fit of all samples.

    The errors of F = h^α f + α and of α are independent. F is the factor from one sample to the next, which
    the samples determine best.
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
        """Whether a filter can continue with these values."""
        deviations = self.alpha_std, self.F_std, self.f_std
        return all(map(math.isfinite, self)) and 0 <= self.alpha <= 2 and min(deviations) >= 0
