"""All that `fltea identify` finds out about one axis of one recording."""

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
from fltea.spectrum.innovation_whiteness import Innovations
from fltea.spectrum.intervals import Estimated, OrderFit
from fltea.spectrum.likelihood_ratio import critical_values
from fltea.spectrum.noise_figures import NoiseFigures, SentenceSummary, noise_figures, summaries
from fltea.spectrum.null_constants import PROBABILITIES
from fltea.spectrum.spectral import Band
from fltea.spectrum.spectral_lines import Peak
from fltea.spectrum.verdict import Verdict, decide

NOT_RUN = "nobody asked for it"


class IdentifyOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How to identify. bias and R of `estimator`, where they are numbers, are those of the one axis."""

    estimator: EstimatorConfig = EstimatorConfig()
    from_hz: float = 0.0
    """Ordinates of the periodogram below are left out."""
    notch_hz: tuple[tuple[float, float], ...] = ()
    """Bands that are left out."""
    shuffles: int = 200
    """Shuffled copies; 0 for none."""
    seed: int = 0
    """The seed of the shuffles."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.from_hz) and self.from_hz >= 0):
            raise ValueError(f"from_hz is a frequency in Hz, 0 or more, got {self.from_hz}")
        for low, high in self.notch_hz:
            if not 0 <= low < high < math.inf:
                raise ValueError(f"notch_hz are bands (low, high) in Hz, got ({low}, {high})")
        if self.shuffles < 0:
            raise ValueError(f"shuffles must be 0 or more, got {self.shuffles}")


class NullResult(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The null test on all ordinates that the user left in, and the shuffled copies."""

    p_value: float
    likelihood_ratio: float
    critical_5_percent: float
    critical_1_percent: float
    p_without_peaks: float
    """The p-value without the lines and resonances that were found."""
    p_clean: float
    """The p-value of the ordinates of `band` without them."""
    level: float
    """The level at which it rejects."""
    shuffled: ShuffledBand | None
    """The shuffled copies by the variant of `AxisResult.fltea`."""


class AxisResult(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One axis, identified. Variances and standard deviations are in the unit of y, deg/s for a gyroscope."""

    samples: int
    longest_stretch: int
    """Samples without a break but for bridged gaps, in which narrow lines and the drift rate are sought."""
    rate_hz: float
    duration_s: float
    mean: float
    std: float
    verdict: Verdict
    null: NullResult
    order: OrderFit
    """All null where the verdict has no order."""
    parts: tuple[Estimated, ...]
    """What the noise is made of: the sentence that stands for it, fitted to the ordinates of `band`."""
    level: Level
    """Its N and K."""
    drift_rate: Interval
    """Slope of the straight line through the longest stretch, a second."""
    band: Band
    sentences: dict[str, SentenceSummary]
    """All sentences that were compared (`fltea.spectrum.candidate_models`), those that did not win, too."""
    stands: Literal["plain", "order"]
    """Which of them has `parts`."""
    peaks: tuple[Peak, ...]
    fltea: FlteaFit | None
    """The variant of the options; None for `fltea_reason`."""
    fltea_other: FlteaFit | None
    """The other variant."""
    innovations: dict[str, Innovations | None]
    """The innovations of FLTEA by variant."""
    fltea_reason: str = ""

    @property
    def made_of(self) -> str:
        """What the noise is made of, in a few words."""
        return self.sentences[self.stands].name


class Looked(NamedTuple):
    """One axis, and what its spectrum says."""

    y: Array
    h: float
    gaps: Gaps
    stretches: Sequence[Stretch]
    """Without a comb, if there is one."""
    summed: Summed
    verdict: Verdict
    figures: NoiseFigures


def look(y: ArrayLike, h: float, options: IdentifyOptions | None = None, gaps: Gaps | None = None) -> Looked:
    """Look at the spectrum of one axis y (n,) at a sampling period of h s.

    gaps: where samples are missing between those of y. The spectrum is of all stretches; narrow lines are
    searched for in the longest one.

    Raises:
        ValueError: y is not finite, too short or constant.
    """
    o, gaps = options or IdentifyOptions(), gaps or no_gaps()
    samples = np.ascontiguousarray(y, dtype=np.float64)
    if samples.ndim != 1:
        raise ValueError(f"y is one axis, (n,), got shape {samples.shape}")
    stretches = bridged(samples, gaps)
    summed = examined_stretches(stretches, len(samples), h, o.from_hz, o.notch_hz)
    evidence = summed.seen.evidence
    verdict = decide(evidence)
    return Looked(samples, h, gaps, summed.stretches, summed, verdict, noise_figures(evidence, verdict))


def described(looked: Looked) -> AxisResult:
    """Return what is found out about an axis that was looked at, without FLTEA."""
    y, h, seen = looked.y, looked.h, looked.summed.seen
    e = seen.evidence
    longest = max((one.y for one in looked.stretches), key=len)
    critical = dict(zip(PROBABILITIES, critical_values(seen.ordinates).tolist(), strict=True))
    return AxisResult(
        samples=len(y),
        longest_stretch=len(longest),
        rate_hz=1 / h,
        duration_s=e.duration_s,
        mean=float(y.mean()),
        std=float(y.std(ddof=1)),
        verdict=looked.verdict,
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
        order=looked.verdict.order,
        parts=looked.figures.parts,
        level=looked.figures.level,
        drift_rate=drift_rate(longest, h, looked.figures.spectrum(h)),
        band=seen.band,
        sentences=summaries(e.candidates),
        stands="plain" if looked.figures.sentence is e.candidates.plain else "order",
        peaks=e.peaks,
        fltea=None,
        fltea_other=None,
        innovations={},
        fltea_reason=NOT_RUN,
    )


def fltea_axis(looked: Looked, lsb: float | None, options: IdentifyOptions) -> FlteaAxis:
    """Return what FLTEA is run over. lsb: one count in the unit of y, if known."""
    return FlteaAxis(looked.y, looked.gaps, options.estimator, lsb, looked.verdict.order.alpha)


def identified(looked: Looked, lsb: float | None, options: IdentifyOptions | None = None) -> AxisResult:
    """Identify an axis that was looked at, with these options; FLTEA is run over the longest epoch.

    lsb: one count in the unit of y, if known. The shuffled copies are left for `with_copies`: they take most
    of the time, and anyone may do them.

    Raises:
        ValueError: settings that no filter can work with.
    """
    (fits,) = fltea_fits([fltea_axis(looked, lsb, options or IdentifyOptions())], looked.h)
    return with_fltea(described(looked), fits)


def with_fltea(result: AxisResult, found: FlteaFits) -> AxisResult:
    """Add what FLTEA gave for the axis."""
    return msgspec.structs.replace(
        result,
        fltea=found.own,
        fltea_other=found.other,
        innovations=found.innovations,
        fltea_reason=found.reason,
    )


def with_copies(result: AxisResult, parts: Sequence[Copies]) -> AxisResult:
    """Add what the shuffled copies of the axis gave, in whatever groups they were estimated."""
    own = result.fltea
    alpha, f = (None, None) if own is None else (own.alpha, own.f)
    found = shuffled_band(parts, alpha, f) if parts else None
    return msgspec.structs.replace(result, null=msgspec.structs.replace(result.null, shuffled=found))
