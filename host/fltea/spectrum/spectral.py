"""What the spectrum of one axis says: null tests, peaks, stationarity, and the contest of the models.

There are three sets of ordinates: all that the user left in; these without lines and resonances; and of these
those above what is called drift. The last are the clean ones, to which the models are fitted.

The same for a recording and for a sensor that is looked at every second; only the level differs.
"""

from collections.abc import Iterable

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.spectrum.likelihood_ratio import NullFits, null_fits, p_value
from fltea.spectrum.lines import FALSE_ALARM, Peak, find_peaks
from fltea.spectrum.octave_lines import around, find_octave_peaks
from fltea.spectrum.octaves import BandCells, Drift
from fltea.spectrum.periodogram import FEWEST, Periodogram, binned
from fltea.spectrum.rivals import Fits, contest, fit_all
from fltea.spectrum.stationarity import find_change
from fltea.spectrum.verdict import DRIFT_HZ, LEVEL, Evidence
from fltea.spectrum.warm import Warm

Array = NDArray[np.float64]
Bands = tuple[tuple[float, float], ...]


LARGEST_SHARE = 0.3
"""Of a band's power in peaks: of bands with more it is not asked whether they changed."""
LEVEL_ORDINATES = 100
"""The lowest ones give the level that drift is compared with."""


class Band(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The clean ordinates."""

    from_hz: float
    notch_hz: Bands
    ordinates: int
    """effective ones"""


class Spectral(msgspec.Struct, frozen=True):
    """The evidence, and what it was drawn from."""

    evidence: Evidence
    likelihood_ratio: float
    """null test of all ordinates"""
    ordinates: int
    """all of them, effective ones"""
    fits: Fits
    """to the clean ones"""
    band: Band


def examine(
    whole: Periodogram,
    duration_s: float,
    samples: int,
    *,
    cells: Iterable[BandCells] = (),
    drift: Drift | None = None,
    peaks: tuple[Peak, ...] | None = None,
    level: float = LEVEL,
    warm: Warm | None = None,
    from_hz: float = 0.0,
    notch: Bands = (),
) -> Spectral:
    """Examine one axis.

    whole: all ordinates that the user left in, which are those above from_hz and outside the bands (low,
    high) of `notch`, in Hz. duration_s, samples: what they are of. cells: for the test of stationarity;
    none: no test. drift: what was taken out of `whole`. peaks: those found elsewhere, with a finer
    resolution; None: they are searched for in `whole`. level: of each test. warm: the last answers, where
    the searches begin; they are replaced.

    Raises:
        ValueError: too few ordinates are left.
    """
    warm = warm or Warm()
    data = binned(whole)
    null = null_fits(data, warm.of("all"))
    ratio = float(null.likelihood_ratio[0])
    ordinates = whole.ordinates
    p_all = p_value(ratio, ordinates)
    if peaks is None:
        # Of peaks and of changes there are as few false alarms as they are looked for all over the spectrum.
        false_alarm = FALSE_ALARM * level / LEVEL
        peaks = (find_peaks if whole.weight is None else find_octave_peaks)(whole, false_alarm)
        found = tuple(peak.notch_hz for peak in peaks)
    else:
        found = around(whole, tuple(peak.notch_hz for peak in peaks))
    clean_from_hz = max(from_hz, DRIFT_HZ)
    clean, kept = _clean(whole, clean_from_hz, found)
    peaks, found = peaks[:kept], found[:kept]
    p_without_peaks = _null_p(whole.without(from_hz, found), warm) if peaks else p_all
    if len(clean.lam) == len(whole.lam):
        fits = fit_all(clean, warm.of("all"), data, null)
    else:
        fits = fit_all(clean, warm.of("clean"))
    rivals = contest(clean, fits)
    # Where a sharp resonance rules, neighbouring blocks are alike, and parts of the record differ for that.
    compared = [one for one in cells if _share_of_peaks(whole, one, found) < LARGEST_SHARE]
    evidence = Evidence(
        duration_s=duration_s,
        samples=samples,
        p_all=p_all,
        p_without_peaks=p_without_peaks,
        p_clean=p_value(rivals.ratio_white, clean.ordinates),
        peaks=peaks,
        contest=rivals,
        drift_ratio=_drift_ratio(clean, drift),
        change=find_change(compared, clean.h, FALSE_ALARM * level / LEVEL, from_hz, notch),
        level=level,
    )
    return Spectral(
        evidence, ratio, round(ordinates), fits, Band(clean_from_hz, notch + found, round(clean.ordinates))
    )


def _share_of_peaks(whole: Periodogram, band: BandCells, peaks: Bands) -> float:
    """The share of a band's power that is in peaks."""
    if not peaks:
        return 0.0
    hz = whole.lam / (2 * np.pi * whole.h)
    inside = (hz >= band.low_hz) & (hz < band.high_hz)
    total = float(whole.power[inside].sum())
    if not total > 0:
        return 0.0
    for low, high in peaks:
        inside &= (hz < low) | (hz > high)
    return 1 - float(whole.power[inside].sum()) / total


def _drift_ratio(clean: Periodogram, drift: Drift | None) -> float:
    """Power of the drift that was taken out over that of the noise at the lowest clean frequencies."""
    if drift is None:
        return 0.0
    weight = np.ones_like(clean.lam) if clean.weight is None else clean.weight
    last = int(np.searchsorted(weight.cumsum(), LEVEL_ORDINATES)) + 1
    return drift.power / float(np.average(clean.power[:last], weights=weight[:last]))


def _clean(whole: Periodogram, from_hz: float, found: Bands) -> tuple[Periodogram, int]:
    """The clean ordinates, and how many of the bands `found` are left out: some only, should they fill all.

    Raises:
        ValueError: too few ordinates are left even so.
    """
    least = max(FEWEST, whole.ordinates / 2)
    for kept in range(len(found), 0, -1):
        try:
            clean = whole.without(from_hz, found[:kept])
        except ValueError:
            continue
        if clean.ordinates >= least:
            return clean, kept
    return whole.without(from_hz, ()), 0


def _null_p(p: Periodogram, warm: Warm) -> float:
    fits: NullFits = null_fits(binned(p), warm.of("without peaks"))
    return p_value(float(fits.likelihood_ratio[0]), p.ordinates)
