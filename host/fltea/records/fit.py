"""The maximum-likelihood fit of one axis, a part of the record `fit` (host/docs/reference/records.md)."""

from typing import Literal

import msgspec

VerdictKind = Literal[
    "white",
    "drift",
    "line",
    "resonance",
    "line or resonance",
    "comb",
    "low-pass",
    "high-pass",
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
    """The parameter."""
    low: float | None = None
    """Lower end of its interval."""
    high: float | None = None
    """Upper end of its interval."""


class Level(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """N, in the unit of the samples over √Hz, and K, in that unit over √s; null where they are not known."""

    N: Interval = Interval()
    """Of the model that stands for the noise."""
    K: Interval = Interval()
    """As the tracker has it, which knows also what is too slow for the spectrum."""
    knee_hz: float | None = None
    """Where N is not known: the corner of the fastest relaxation, at half the rate at most."""
    knee_density: float | None = None
    """The density there, as N."""
    K_at_most: float | None = None
    """Where K is not known: it is smaller with 95 % probability; null where there is no bound."""

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
    """How long yet."""

    target: float
    """Half the width of α's interval that is asked for, `live.target`."""
    seconds: float | None = None
    """Seconds of samples until then; 0 if it is so; null if nobody knows."""


class FitAllan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Overlapping Allan deviation, and that of the fitted model."""

    tau_s: list[float]
    """Averaging times [s]."""
    adev: list[float]
    """Overlapping Allan deviation [`unit`]."""
    low: list[float]
    """Lower ends of its 95 % intervals [`unit`]."""
    high: list[float]
    """Upper ends of its 95 % intervals [`unit`]."""
    model: list[float]
    """Allan deviation of the fitted model [`unit`]."""
    N: float | None = None
    """Random walk of the angle, of the fitted model; null where its white noise is not known [`unit`·√s]."""
    B: float | None = None
    """Bias instability: the amplitude of 1/f noise, or a flat stretch of the curve over 0.664; null where the
    record cannot tell [`unit`]."""
    K: float | None = None
    """Random walk of the rate: live as the curve has it, of a recording as the tracker has it; null where
    there may be none [`unit`/√s]."""


class FitSpectrum(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Noise density, and that of the fitted model."""

    hz: list[float]
    """Frequencies [Hz]."""
    density: list[float]
    """Noise density, one-sided [`unit`/√Hz]."""
    model: list[float]
    """Noise density of the fitted model [`unit`/√Hz]."""


class FitLowPass(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A low-pass that all of the noise has gone through."""

    corner_hz: float
    """Where it lets half of the power through; may be above half the sample rate [Hz]."""
    poles: float
    """How steep it is: 20 dB a decade each."""


class FitHighPass(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A high-pass that all of the noise has gone through: AC coupling, or an auto-zero."""

    corner_hz: float
    """Where it lets half of the power through [Hz]."""
    poles: float
    """How steep it is: 20 dB a decade each."""


class Curves(msgspec.Struct, frozen=True, kw_only=True):
    """The curves of an axis; None where the record is too short for them, or they are not asked for."""

    allan: FitAllan | None = None
    """The Allan deviation; null between times (every 10 s, or four `stats.fit_period_s` if that is longer,
    and in the last fit)."""
    spectrum: FitSpectrum | None = None
    """The noise density; null between times."""


class FittedAxis(Curves, frozen=True):
    """What the noise of one axis is, and what it was fitted with."""

    verdict: VerdictKind
    """What the noise is: `white`, `drift`, `line`, `resonance`, `line or resonance`, `comb`, `low-pass`,
    `high-pass`, `notch`, `relaxations`, `fractional`, `fractional or relaxations`, `anti-persistent`,
    `undecided`, `not stationary`, `constant`, `too few samples`; by the rules of `fltea identify`, at a level
    that holds for all looks."""
    text: str
    """The verdict in sentences: what the noise is, how sure that is, what to do."""
    unit: str
    """`deg/s`, or `m/s^2` for axes of the accelerometer; s2 and R are in its square."""
    null_p: float | None = None
    """How often white noise would look at least as unlike white, at this moment."""
    alpha: Interval = Interval()
    """The order α; null where undefined."""
    f: Interval = Interval()
    """The parameter f; null where undefined [s^-α]."""
    F: Interval = Interval()
    """F = h^α f + α, which the data say most about."""
    s2: Interval = Interval()
    """Variance of the state's innovations, h^2α Q [`unit` squared]."""
    R: Interval = Interval()
    """Variance of the white noise [`unit` squared]."""
    odds: float | None = None
    """The odds that the noise has an order, against none; null where it is as good as white, or nothing looks
    like an order."""


class AxisFit(FittedAxis, frozen=True, forbid_unknown_fields=True):
    """The fit of one axis to all its samples so far."""

    rate_left_out: list[tuple[float, float]] = []
    """Bands of lines and resonances, which are not fitted [Hz]."""
    left_out: dict[str, int] = {}
    """Samples that are not used (`lost`, `knocked`, `moved`, …), and `bridged` and `limited` ones; a restart
    counts as nine lost."""
    breaks: dict[str, int] = {}
    """How often the stretch of samples was broken: `gaps`, `knocks` (each 128 samples), `motions`, `steps` of
    the offset, lasting `changes` of the power."""
    low_pass: FitLowPass | None = None
    """A low-pass filter that the noise has gone through; the parameters are those of the noise before it."""
    high_pass: FitHighPass | None = None
    """A high-pass that it has gone through: nothing is known of drift, and the bias is the filter's."""
    until_s: Until | None = None
    """How long it takes until α is known well enough."""
    stable: bool = True
    """Whether two fits agreed on the verdict, the later one with a tenth more samples, or it is that of a
    whole recording."""
