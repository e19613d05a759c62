"""All that `fltea identify` finds out about one axis of one recording."""

import math
from collections.abc import Sequence
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from fltea.identification.fltea_fit import FlteaFit, fltea_fit
from fltea.identification.gaps import Gaps, Stretch, bridged, no_gaps
from fltea.identification.shuffled import Copies, ShuffledBand, shuffled_band
from fltea.identification.sums import examined_stretches
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.composite import Composite, composite
from fltea.spectrum.drift_rate import drift_rate
from fltea.spectrum.evidence import LEVEL
from fltea.spectrum.innovation_whiteness import Innovations
from fltea.spectrum.likelihood_ratio import critical_values
from fltea.spectrum.lines import Peak
from fltea.spectrum.null_constants import PROBABILITIES
from fltea.spectrum.profile import FractionalFit, fractional_fit
from fltea.spectrum.rivals import Contest
from fltea.spectrum.spectral import Band, Spectral
from fltea.spectrum.verdict import Verdict, decide

Variant = Literal["triple", "joint"]

OTHER: dict[Variant, Variant] = {"joint": "triple", "triple": "joint"}


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
    whittle: FractionalFit
    """Fitted to the ordinates of `band`, as the rivals are."""
    band: Band
    rivals: Contest
    composite: Composite
    """White noise, Gauss–Markov parts, random walk, quantisation, fitted to the same."""
    peaks: tuple[Peak, ...]
    fltea: FlteaFit
    """The variant of the options."""
    fltea_other: FlteaFit
    """The other variant."""
    innovations: dict[str, Innovations | None]
    """The innovations of FLTEA by variant."""


def identify_axis(
    y: ArrayLike,
    h: float,
    lsb: float | None = None,
    options: IdentifyOptions | None = None,
    gaps: Gaps | None = None,
) -> AxisResult:
    """Identify one axis y (n,) at a sampling period of h s.

    gaps: where samples are missing between those of y. The spectrum is of all stretches; FLTEA is run over
    the longest epoch, and narrow lines are searched for in the longest stretch.

    The shuffled copies are left for `with_copies`: they take most of the time, and anyone may do them.

    lsb: one count in the unit of y, if known.

    Raises:
        ValueError: y is not finite, too short or constant; settings that no filter can work with.
    """
    o = options or IdentifyOptions()
    samples = np.ascontiguousarray(y, dtype=np.float64)
    if samples.ndim != 1:
        raise ValueError(f"y is one axis, (n,), got shape {samples.shape}")
    gaps = gaps or no_gaps()
    stretches = bridged(samples, gaps)
    seen = examined_stretches(stretches, len(samples), h, o.from_hz, o.notch_hz)
    own, own_innovations = fltea_fit(samples, h, o.estimator, lsb, gaps)
    other_variant = OTHER[o.estimator.variant]
    other, other_innovations = fltea_fit(
        samples, h, msgspec.structs.replace(o.estimator, variant=other_variant), lsb, gaps
    )
    critical = dict(zip(PROBABILITIES, critical_values(seen.ordinates).tolist(), strict=True))
    return AxisResult(
        samples=len(samples),
        longest_stretch=max(len(one.y) for one in stretches),
        rate_hz=1 / h,
        duration_s=seen.evidence.duration_s,
        mean=float(samples.mean()),
        std=float(samples.std(ddof=1)),
        verdict=decide(seen.evidence),
        null=NullResult(
            p_value=seen.evidence.p_all,
            likelihood_ratio=seen.likelihood_ratio,
            critical_5_percent=critical[0.05],
            critical_1_percent=critical[0.01],
            p_without_peaks=seen.evidence.p_without_peaks,
            p_clean=seen.evidence.p_clean,
            shuffled=None,
        ),
        whittle=fractional_fit(seen.fits.data, seen.fits.full, h, white=seen.evidence.p_clean >= LEVEL),
        band=seen.band,
        rivals=seen.evidence.contest,
        composite=_composite(stretches, len(samples), h, seen),
        peaks=seen.evidence.peaks,
        fltea=own,
        fltea_other=other,
        innovations={o.estimator.variant: own_innovations, other_variant: other_innovations},
    )


def _composite(stretches: Sequence[Stretch], samples: int, h: float, seen: Spectral) -> Composite:
    found = composite(seen.fits.data, h, samples, seen.fits.sums)
    longest = max((one.y for one in stretches), key=len)
    low_pass = seen.evidence.low_pass
    return msgspec.structs.replace(
        found,
        low_pass_hz=low_pass.corner_hz if low_pass else None,
        drift_rate=drift_rate(longest, h, found.spectrum),
    )


def with_copies(result: AxisResult, parts: Sequence[Copies]) -> AxisResult:
    """Add what the shuffled copies of the axis gave, in whatever groups they were estimated."""
    found = shuffled_band(parts, result.fltea.alpha, result.fltea.f) if parts else None
    return msgspec.structs.replace(result, null=msgspec.structs.replace(result.null, shuffled=found))
