"""What the periodogram of one axis says: null tests, peaks, and the contest of the models.

There are three sets of ordinates: all that the user left in; these without lines and resonances; and of these
those above what is called drift. The last are the clean ones, to which the models are fitted.
"""

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.spectrum.likelihood_ratio import null_fits, p_value
from fltea.spectrum.lines import find_peaks
from fltea.spectrum.periodogram import FEWEST, Periodogram, binned, periodogram, used_ordinates
from fltea.spectrum.rivals import Fits, contest, fit_all
from fltea.spectrum.verdict import DRIFT_HZ, Evidence

Array = NDArray[np.float64]
Bands = tuple[tuple[float, float], ...]


class Band(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The clean ordinates."""

    from_hz: float
    notch_hz: Bands
    ordinates: int


class Spectral(msgspec.Struct, frozen=True):
    """The evidence, and what it was drawn from."""

    evidence: Evidence
    likelihood_ratio: float
    """null test of all ordinates"""
    ordinates: int
    """all of them"""
    fits: Fits
    """to the clean ones"""
    band: Band


def examine(y: Array, h: float, from_hz: float = 0.0, notch: Bands = ()) -> Spectral:
    """Examine one axis y (n,) at a sampling period of h s; from_hz and notch as in `periodogram`.

    Raises:
        ValueError: y is not finite, constant, or too short.
    """
    whole = periodogram(y, h, from_hz=from_hz, notch=notch)
    ratio = float(null_fits(binned(whole)).likelihood_ratio[0])
    p_all = p_value(ratio, len(whole.lam))
    clean_from_hz = max(from_hz, DRIFT_HZ)
    peaks = find_peaks(whole)
    # Some of them only, should they fill the spectrum.
    least = max(FEWEST, len(whole.lam) // 2)
    while True:
        without = notch + tuple(peak.notch_hz for peak in peaks)
        if not peaks or len(used_ordinates(whole.n, h, from_hz=clean_from_hz, notch=without)) >= least:
            break
        peaks = peaks[:-1]
    p_without_peaks = _null_p(whole.without(from_hz, without)) if peaks else p_all
    clean = whole.without(clean_from_hz, without)
    ordinates = len(whole.lam)
    del whole  # of a day 70 MB
    fits = fit_all(clean)
    rivals = contest(clean, fits)
    evidence = Evidence(
        duration_s=len(y) * h,
        samples=len(y),
        p_all=p_all,
        p_without_peaks=p_without_peaks,
        p_clean=p_value(rivals.ratio_white, len(clean.lam)),
        peaks=peaks,
        contest=rivals,
    )
    return Spectral(evidence, ratio, ordinates, fits, Band(clean_from_hz, without, len(clean.lam)))


def _null_p(p: Periodogram) -> float:
    return p_value(float(null_fits(binned(p)).likelihood_ratio[0]), len(p.lam))
