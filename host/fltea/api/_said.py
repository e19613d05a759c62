"""What is shown of an axis, whoever fitted it: `Identified` and the live `AxisFit` both have it."""

from typing import Protocol

from fltea.records.fit import FitAllan, FitSpectrum, Interval

PARAMETERS = ("alpha", "f", "F", "s2", "R")


class Said(Protocol):
    """One axis."""

    @property
    def verdict(self) -> str:
        """In a word or two."""

    @property
    def text(self) -> str:
        """In sentences."""

    @property
    def unit(self) -> str:
        """Of the samples."""

    @property
    def null_p(self) -> float | None:
        """Of the null test."""

    @property
    def alpha(self) -> Interval:
        """Order."""

    @property
    def f(self) -> Interval:
        """Parameter."""

    @property
    def F(self) -> Interval:
        """Weight of the last state."""

    @property
    def s2(self) -> Interval:
        """Variance of the innovations."""

    @property
    def R(self) -> Interval:
        """Variance of the white noise."""

    @property
    def allan(self) -> FitAllan | None:
        """Curve of the Allan deviation."""

    @property
    def spectrum(self) -> FitSpectrum | None:
        """Curve of the spectrum."""
