"""The maximum-likelihood fit of one axis, a part of the record `fit` (host/docs/reference/records.md)."""

from typing import Literal

import msgspec

VerdictKind = Literal[
    "white",
    "drift",
    "line",
    "resonance",
    "line or resonance",
    "low-pass",
    "notch",
    "relaxations",
    "fractional",
    "fractional or relaxations",
    "anti-persistent",
    "undecided",
    "not stationary",
    "constant",
    "too few samples",
]
"""What the noise is, in a word or two."""


class Interval(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A fitted parameter with the ends of its 95 % interval.

    low and high are null where the data do not define the parameter; value is null where there is no fit.
    """

    value: float | None = None
    low: float | None = None
    high: float | None = None


class Level(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """N, in the unit of the samples over √Hz, and K, in that unit over √s; null where there is none."""

    N: Interval = Interval()
    K: Interval = Interval()
    knee_hz: float | None = None
    """Where N is not known: the corner of the fastest relaxation, at half the rate at most."""
    knee_density: float | None = None
    """The density there, as N."""

    @property
    def reason(self) -> str:
        """Why N is not known, and what is; nothing where it is known."""
        if self.N.value is not None:
            return ""
        if self.knee_hz is None:
            return "White noise is too weak beside the other parts for N to be known."
        return (
            "White noise cannot be told from what else is fast, so N is not known: the density at the knee, "
            f"{self.knee_hz:.3g} Hz, is {self.knee_density:.3g} (unit/√Hz)."
        )


class Until(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How many seconds of samples more until α is known to ± `target`; 0 if it is, null if nobody knows."""

    target: float
    seconds: float | None = None


class FitAllan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Overlapping Allan deviation with 95 % intervals, in the axis's unit, and that of the fitted model.

    N: per √s (random walk of the angle); B: floor over 0.664 (bias instability); K: per s and √s (random
    walk of the rate); null where the curve does not show it.
    """

    tau_s: list[float]
    adev: list[float]
    low: list[float]
    high: list[float]
    model: list[float]
    N: float | None = None
    B: float | None = None
    K: float | None = None


class FitSpectrum(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Noise density and that of the fitted model, one-sided, in the axis's unit over √Hz."""

    hz: list[float]
    density: list[float]
    model: list[float]


class FitLowPass(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A low-pass that all of the noise has gone through; its corner may be above half the sample rate."""

    corner_hz: float
    poles: float


class Curves(msgspec.Struct, frozen=True, kw_only=True):
    """The curves of an axis; None where the record is too short for them, or they are not asked for."""

    allan: FitAllan | None = None
    spectrum: FitSpectrum | None = None


class FittedAxis(Curves, frozen=True):
    """What the noise of one axis is, and what it was fitted with."""

    verdict: VerdictKind
    """What the noise is, in a word or two."""
    text: str
    """The verdict in sentences: what the noise is, how sure that is, what to do."""
    unit: str
    """The unit of the samples; s2 and R are in its square."""
    null_p: float | None = None
    """The p-value of the test whether the noise is white."""
    alpha: Interval = Interval()
    """The order α."""
    f: Interval = Interval()
    """The parameter f, in s^-α."""
    F: Interval = Interval()
    """F = h^α f + α, which the data say most about."""
    s2: Interval = Interval()
    """Variance of the state's innovations, h^2α Q."""
    R: Interval = Interval()
    """Variance of the white noise."""


class AxisFit(FittedAxis, frozen=True, forbid_unknown_fields=True):
    """The fit of one axis to all its samples so far.

    null_p: at the time. rate_left_out: bands in Hz of lines and
    resonances, which are not fitted. left_out: samples that are not used, and bridged ones, by cause.
    breaks: how often the stretch of samples was broken, by cause: gaps, knocks (of 128 samples), motions,
    steps of the offset, lasting changes of the noise's power.
    low_pass: a filter that was found; the parameters are then those of the noise that went into it.
    allan, spectrum: null between times (at most every 10 s).
    stable: the verdict is one that two fits in a row have agreed on, of which the later one has a tenth more
    samples, or is that of a whole recording.
    """

    rate_left_out: list[tuple[float, float]] = []
    left_out: dict[str, int] = {}
    breaks: dict[str, int] = {}
    low_pass: FitLowPass | None = None
    until_s: Until | None = None
    stable: bool = True
