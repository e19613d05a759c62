"""The maximum-likelihood fit of one axis, a part of the record `fit` (host/docs/reference/records.md)."""

import msgspec

from fltea.records.verdict_kinds import VerdictKind as VerdictKind


class Interval(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A fitted parameter with the ends of its 95 % interval.

    `low` and `high` are null if the data do not determine the parameter; `value` is null if there is no fit.
    """

    value: float | None = None
    """Value of the parameter."""
    low: float | None = None
    """Lower end of the parameter's 95 % interval."""
    high: float | None = None
    """Upper end of the parameter's 95 % interval."""


class Level(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """White-noise density N of one axis, and random walk K of the bias of this axis.

    N is in the unit of the samples per √Hz, and K in the unit of the samples per √s. A value that is not
    known is null.
    """

    N: Interval = Interval()
    """White-noise density of the accepted noise model."""
    K: Interval = Interval()
    """Random walk of the bias, as the bias tracker estimates it. The tracker also sees drift that is too slow
    for the spectrum.
    """
    knee_hz: float | None = None
    """If N is not known: corner frequency of the fastest relaxation (first-order Gauss-Markov process) in the
    model, at most half the sampling rate [Hz].
    """
    knee_density: float | None = None
    """Noise density of the model at the frequency `knee_hz`, in the unit of N."""
    K_at_most: float | None = None
    """If K is not known: upper bound of K with 95 % probability; null if there is no bound."""

    @property
    def reason(self) -> str:
        """Text that says why N is not known, and what is known in its place; empty if N is known."""
        if self.N.value is not None:
            return ""
        if self.knee_hz is None:
            return "N is not known, since white noise is too weak compared with the other parts of the noise."
        return (
            "White noise cannot be told from other fast noise, so N is not known: the density at the knee, "
            f"{self.knee_hz:.3g} Hz, is {self.knee_density:.3g} (unit/√Hz)."
        )


class Until(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Time until α's interval is as narrow as the user wants."""

    target: float
    """Half-width of α's interval that the user wants: the setting `live.target`."""
    seconds: float | None = None
    """Time until the half-width of α's interval has fallen to `target` [s]; 0 if it already has; null if the
    time cannot be predicted.
    """


class FitAllan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Overlapping Allan deviation of the samples, and Allan deviation of the fitted model."""

    tau_s: list[float]
    """Averaging times [s]."""
    adev: list[float]
    """Overlapping Allan deviation [`unit`]."""
    low: list[float]
    """Lower ends of the 95 % intervals of `adev` [`unit`]."""
    high: list[float]
    """Upper ends of the 95 % intervals of `adev` [`unit`]."""
    model: list[float]
    """Allan deviation of the fitted model [`unit`]."""
    N: float | None = None
    """Angle random walk (ARW) of the fitted model; null if the model's white noise is not known
    [`unit`·√s].
    """
    B: float | None = None
    """Bias instability: the amplitude of 1/f noise, or the height of a flat part of the Allan deviation
    divided by 0.664; null if the samples do not determine it [`unit`].
    """
    K: float | None = None
    """Rate random walk. In a live fit it follows from the Allan deviation; for a recording the tracker gives
    it. Null if the data do not show that there is a random walk [`unit`/√s].
    """


class FitSpectrum(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Noise density of the samples, and noise density of the fitted model."""

    hz: list[float]
    """Frequencies of the noise densities [Hz]."""
    density: list[float]
    """Noise density, one-sided [`unit`/√Hz]."""
    model: list[float]
    """Noise density of the fitted model [`unit`/√Hz]."""


class FitLowPass(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A low-pass filter through which the whole noise has passed before it was sampled."""

    corner_hz: float
    """Frequency at which the filter passes half of the power; may be above half the sampling rate [Hz]."""
    poles: float
    """Number of poles: each adds a slope of 20 dB per decade."""


class FitHighPass(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A high-pass filter through which the whole noise has passed: AC coupling, or an auto-zero."""

    corner_hz: float
    """Frequency at which the filter passes half of the power [Hz]."""
    poles: float
    """Number of poles: each adds a slope of 20 dB per decade."""


class Curves(msgspec.Struct, frozen=True, kw_only=True):
    """The curves of an axis. Each curve is None if there are too few samples, or if no curves are wanted."""

    allan: FitAllan | None = None
    """The Allan deviation. It is present in the last fit, and in one fit every 10 s, or every 4 ·
    `stats.fit_period_s` if that is longer. It is null in all other fits.
    """
    spectrum: FitSpectrum | None = None
    """The noise density; present in the same fits as `allan`, otherwise null."""


class FittedAxis(Curves, frozen=True):
    """The verdict on the noise of one axis, and the fitted parameters."""

    verdict: VerdictKind
    """Kind of the noise: `white`, `drift`, `line`, `resonance`, `line or resonance`, `comb`, `low-pass`,
    `high-pass`, `notch`, `relaxations`, `fractional`, `fractional or relaxations`, `anti-persistent`,
    `undecided`, `not stationary`, `constant`, `too few samples`. The rules are those of `fltea identify`. But
    a live fit, which is repeated again and again, has to be surer before it rejects white noise."""
    text: str
    """The verdict in sentences: what the noise is, how sure that is, what to do."""
    unit: str
    """`deg/s`, or `m/s^2` for axes of the accelerometer; s2 and R are in the square of this unit."""
    null_p: float | None = None
    """p-value of the null test, which is for white noise. It is computed from all samples so far, peaks and
    drift included. The p in `text` is that of the same test without them.
    """
    alpha: Interval = Interval()
    """The order α; null if the noise has no order."""
    f: Interval = Interval()
    """The parameter f; null if the noise has no order [s^-α]."""
    F: Interval = Interval()
    """F = h^α f + α, with the sampling period h: the combination of α and f that the data determine best."""
    s2: Interval = Interval()
    """Variance of the noise that is added to the state at each sample: h^2α Q, where h is the sampling period
    and Q the variance of the model's ω [`unit` squared].
    """
    R: Interval = Interval()
    """Variance of the white noise [`unit` squared]."""
    odds: float | None = None
    """How many times likelier it is that the noise has an order (is fractional) than that it has none. Null
    if the noise cannot be told from white noise, or if no model with an order was fitted.
    """


class AxisFit(FittedAxis, frozen=True, forbid_unknown_fields=True):
    """The fit of one axis to all its samples so far."""

    rate_left_out: list[tuple[float, float]] = []
    """Frequency bands of spectral lines and resonances, which are left out of the fit [Hz]."""
    left_out: dict[str, int] = {}
    """Number of samples that the fit leaves out or changes, by cause. Left out: `lost` (nine or more for each
    restart), `knocked` (during a shock or step), `moved` (in motion). Changed: `bridged` (lost samples in
    whose place the fit uses a straight line), `limited` (samples that exceeded a limit and are set to it).
    """
    breaks: dict[str, int] = {}
    """How often the series of fitted samples is interrupted, by cause: `gaps`; `knocks` (shocks, for each of
    which 128 samples are left out); `motions`; `steps` of the bias; `changes` of the noise's power that last.
    """
    low_pass: FitLowPass | None = None
    """A low-pass filter that the noise has passed; the fitted parameters describe the noise before the
    filter.
    """
    high_pass: FitHighPass | None = None
    """A high-pass filter that the noise has passed. Such a filter removes the sensor's bias and its drift, so
    nothing is known of them. The published bias is only the mean of what the filter lets pass.
    """
    until_s: Until | None = None
    """Time until α's interval is as narrow as the user wants."""
    stable: bool = True
    """Whether the verdict is stable: either the fit used a whole recording, or an earlier fit, as a rule with
    a tenth fewer samples, had the same verdict.
    """
