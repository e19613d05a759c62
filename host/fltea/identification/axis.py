"""Collect all that `fltea identify` finds out about one axis of one recording."""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from fltea.identification.fltea_fit import FlteaAxis, FlteaFit, FlteaFits, fltea_fits
from fltea.identification.gaps import Gaps, Stretch, bridged, no_gaps
from fltea.identification.shuffled import Copies, ShuffledBand, shuffled_band
from fltea.identification.sums import Summed, examined_stretches
from fltea.records.arrays import Array
from fltea.records.fit import Interval, Level
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.drift_rate import drift_rate
from fltea.spectrum.estimated import Estimated
from fltea.spectrum.innovation_whiteness import Innovations
from fltea.spectrum.likelihood_ratio import critical_values
from fltea.spectrum.noise_figures import ModelSummary, NoiseFigures, noise_figures, summaries
from fltea.spectrum.null_constants import PROBABILITIES
from fltea.spectrum.order_fit import OrderFit
from fltea.spectrum.questions import Verdict
from fltea.spectrum.spectral import Band
from fltea.spectrum.spectral_lines import Peak
from fltea.spectrum.verdict import decide

NOT_RUN = "nobody asked for it"


class IdentifyOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The options with which an axis is identified.

    `estimator` has the settings of FLTEA. If its `bias` and `R` are numbers, they are the values for this
    axis.
    """

    estimator: EstimatorConfig = EstimatorConfig()
    from_hz: float = 0.0
    """Lowest frequency in use [Hz]; ordinates of the periodogram below it are left out."""
    notch_hz: tuple[tuple[float, float], ...] = ()
    """Frequency bands (low, high) that the fit leaves out [Hz]."""
    shuffles: int = 200
    """Number of shuffled copies of the samples over which FLTEA is run; 0 for none."""
    seed: int = 0
    """Seed of the random generator that makes the shuffled copies."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.from_hz) and self.from_hz >= 0):
            raise ValueError(f"from_hz must be a frequency in Hz, 0 or more, got {self.from_hz}")
        for low, high in self.notch_hz:
            if not 0 <= low < high < math.inf:
                raise ValueError(f"notch_hz must be bands (low, high) in Hz, got ({low}, {high})")
        if self.shuffles < 0:
            raise ValueError(f"shuffles must be 0 or more, got {self.shuffles}")


class NullResult(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The test whether the samples may be white noise, and FLTEA's estimates for shuffled copies.

    The test uses all ordinates of the periodogram that the user did not leave out.
    """

    p_value: float
    likelihood_ratio: float
    critical_5_percent: float
    critical_1_percent: float
    p_without_peaks: float
    """The p-value of the test if the spectral lines and resonances that were found are left out."""
    p_clean: float
    """The p-value of the test on the frequency band of the fit, without spectral lines and resonances."""
    level: float
    """The p-value below which white noise is rejected."""
    shuffled: ShuffledBand | None
    """FLTEA's estimates for the shuffled copies, by the same variant of FLTEA as in `AxisResult.fltea`."""


# Why more than 12 attributes: each is one finding about an axis, and they are made together.
class AxisResult(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The identification of one axis.

    Standard deviations are in the unit of the samples (deg/s for a gyroscope), variances in its square.
    """

    samples: int
    longest_stretch: int
    """Number of samples of the longest stretch, in which narrow lines and the drift rate are searched for.

    A stretch is a run of samples without a break; its short gaps are filled.
    """
    rate_hz: float
    duration_s: float
    mean: float
    std: float
    verdict: Verdict
    null: NullResult
    order: OrderFit
    """The estimated order; all its values are null if the noise has no order by the verdict."""
    parts: tuple[Estimated, ...]
    """The parts (components) of the chosen noise model, fitted to the spectrum in `band`."""
    level: Level
    """N and K of the chosen model."""
    drift_rate: Interval
    """Slope of the line fitted to the longest stretch without a break, in the samples' unit per second."""
    band: Band
    models: dict[str, ModelSummary]
    """All candidate models (`fltea.spectrum.candidate_models`): the chosen model and the others."""
    stands: Literal["plain", "order"]
    """The chosen model's key in `models`: "plain" is the best without an order, "order" the best with one."""
    peaks: tuple[Peak, ...]
    fltea: FlteaFit | None
    """FLTEA's estimates by the variant ("triple" or "joint" filters) that the options ask for.

    None if FLTEA cannot be run; `fltea_reason` then says why.
    """
    fltea_other: FlteaFit | None
    """FLTEA's estimates by the other variant, which the options do not ask for."""
    innovations: dict[str, Innovations | None]
    """For each variant of FLTEA, the test whether its innovations are white."""
    fltea_reason: str = ""

    @property
    def made_of(self) -> str:
        """The name of the chosen model."""
        return self.models[self.stands].name


class AxisAnalysis(NamedTuple):
    """The samples of one axis, and the analysis of their spectrum."""

    y: Array
    h: float
    gaps: Gaps
    stretches: Sequence[Stretch]
    """The stretches of samples between breaks.

    If the spectrum showed a comb of lines, the pattern that makes the comb was removed from the stretches.
    """
    summed: Summed
    verdict: Verdict
    figures: NoiseFigures


def analyse(
    y: ArrayLike, h: float, options: IdentifyOptions | None = None, gaps: Gaps | None = None
) -> AxisAnalysis:
    """Analyse the spectrum of one axis.

    The spectrum is averaged over all stretches. Narrow lines are searched for in the longest stretch.

    Args:
        y: samples, (n,).
        h: sampling period [s].
        options: how to identify.
        gaps: places in y where samples are missing.

    Raises:
        ValueError: y is not finite, too short or constant.
    """
    o, gaps = options or IdentifyOptions(), gaps or no_gaps()
    samples = np.ascontiguousarray(y, dtype=np.float64)
    if samples.ndim != 1:
        raise ValueError(f"y must be one axis, (n,), got shape {samples.shape}")
    stretches = bridged(samples, gaps)
    summed = examined_stretches(stretches, len(samples), h, o.from_hz, o.notch_hz)
    evidence = summed.seen.evidence
    verdict = decide(evidence)
    return AxisAnalysis(samples, h, gaps, summed.stretches, summed, verdict, noise_figures(evidence, verdict))


def described(analysis: AxisAnalysis) -> AxisResult:
    """Return the result for an analysed axis, still without FLTEA's estimates."""
    y, h, seen = analysis.y, analysis.h, analysis.summed.seen
    e = seen.evidence
    longest = max((one.y for one in analysis.stretches), key=len)
    critical = dict(zip(PROBABILITIES, critical_values(seen.ordinates).tolist(), strict=True))
    return AxisResult(
        samples=len(y),
        longest_stretch=len(longest),
        rate_hz=1 / h,
        duration_s=e.duration_s,
        mean=float(y.mean()),
        std=float(y.std(ddof=1)),
        verdict=analysis.verdict,
        null=NullResult(
            p_value=e.p_all,
            likelihood_ratio=seen.likelihood_ratio,
            critical_5_percent=critical[0.05],
            critical_1_percent=critical[0.01],
            p_without_peaks=e.p_without_peaks,
            p_clean=e.p_clean,
            level=e.level,
            shuffled=None,
        ),
        order=analysis.verdict.order,
        parts=analysis.figures.parts,
        level=analysis.figures.level,
        drift_rate=drift_rate(longest, h, analysis.figures.spectrum(h)),
        band=seen.band,
        models=summaries(e.candidates),
        stands="plain" if analysis.figures.model is e.candidates.plain else "order",
        peaks=e.peaks,
        fltea=None,
        fltea_other=None,
        innovations={},
        fltea_reason=NOT_RUN,
    )


def fltea_axis(analysis: AxisAnalysis, lsb: float | None, options: IdentifyOptions) -> FlteaAxis:
    """Return what FLTEA needs to run over this axis.

    `lsb`: one count in the unit of the samples, if known.
    """
    return FlteaAxis(analysis.y, analysis.gaps, options.estimator, lsb, analysis.verdict.order.alpha)


def identified(
    analysis: AxisAnalysis, lsb: float | None, options: IdentifyOptions | None = None
) -> AxisResult:
    """Identify an analysed axis, and run FLTEA over its longest part without a restart.

    `with_copies` adds later what FLTEA estimates for shuffled copies of the samples, which are white noise.
    The copies take most of the time, so other processes may compute them.

    Args:
        analysis: the analysed axis.
        lsb: one count in the unit of y, if known.
        options: how to identify.

    Raises:
        ValueError: the settings give no filter that works.
    """
    (fits,) = fltea_fits([fltea_axis(analysis, lsb, options or IdentifyOptions())], analysis.h)
    return with_fltea(described(analysis), fits)


def with_fltea(result: AxisResult, found: FlteaFits) -> AxisResult:
    """Add FLTEA's estimates to the result of an axis."""
    return msgspec.structs.replace(
        result,
        fltea=found.own,
        fltea_other=found.other,
        innovations=found.innovations,
        fltea_reason=found.reason,
    )


def with_copies(result: AxisResult, parts: Sequence[Copies]) -> AxisResult:
    """Add FLTEA's estimates for the shuffled copies to the result.

    `parts`: the estimates for some of the copies each; several processes may have computed them.
    """
    own = result.fltea
    alpha, f = (None, None) if own is None else (own.alpha, own.f)
    found = shuffled_band(parts, alpha, f) if parts else None
    return msgspec.structs.replace(result, null=msgspec.structs.replace(result.null, shuffled=found))
