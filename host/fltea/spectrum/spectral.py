"""What the spectrum of one axis says: null tests, peaks, stationarity, drift, and the candidate models.

There are three sets of ordinates (powers at single frequencies). The first has all that the user did not
exclude. The second is the first without spectral lines and resonances. The third is the second without the
lowest frequencies, where the noise may only be drift. It is called the clean ordinates. The models are fitted
to these.

A recording and a live sensor are examined in the same way, except for the significance level of the tests.
"""

from collections.abc import Callable, Iterable
from functools import partial
from typing import NamedTuple

import msgspec
import numpy as np

from fltea.noise.filters import HighPass
from fltea.noise.parts import Resonance
from fltea.records.arrays import Array
from fltea.spectrum.candidate_models import CandidateModels
from fltea.spectrum.cubic_drift import Drift
from fltea.spectrum.drift import drift_hz, slow_power
from fltea.spectrum.evidence import APART, LEVEL, Evidence, apart
from fltea.spectrum.high_pass import LEAKS_AT_MOST, end_leak
from fltea.spectrum.last_refit import LastRefit
from fltea.spectrum.likelihood_ratio import p_value
from fltea.spectrum.median_filter import MedianFilter
from fltea.spectrum.octave_comb import find_octave_comb
from fltea.spectrum.octaves import BandCells
from fltea.spectrum.ordinates import around
from fltea.spectrum.periodogram import FEWEST, Periodogram
from fltea.spectrum.reading import read
from fltea.spectrum.spectral_lines import Peak, find_peaks
from fltea.spectrum.stationarity import Change, find_change

Bands = tuple[tuple[float, float], ...]

FALSE_PEAK = 0.01
"""Probability of finding a peak where there is none, at the significance level `LEVEL`. If it were smaller,
spectral lines of real sensors would be missed in the running spectrum of a live sensor. That spectrum is
coarse at high frequencies, and shows lines less clearly than the spectrum of a file.
"""
FALSE_COMB = 1e-3
"""Probability of finding a comb where there is none, at the significance level `LEVEL`."""
FALSE_CHANGE = 1e-3
"""Probability of finding a change of the noise where there is none, at the significance level `LEVEL`."""
LEAKS = 3.0
"""A spectral line leaks over this many times the width of the band that is left out around the line."""
SLOW_LINES = 4.0
"""A spectral line is called slow if its band begins below this multiple of the lowest fitted frequency."""
LARGEST_SHARE = 0.15
"""A band is tested for changes only if peaks have less than this proportion of its power. Two spectral lines
in a band interfere, so that its power goes up and down. With less than this proportion, the lines cannot be
mistaken for a change that matters.
"""
EXPLAINED = 1.5
"""A hump of the spectrum beside a high-pass is reported as a peak only if its power is more than this many
times the power of the fitted model, without resonances, in the same band.
"""


class Band(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The frequency band of the clean ordinates, to which the models are fitted and the verdict applies."""

    from_hz: float
    to_hz: float
    notch_hz: Bands
    ordinates: int
    """The effective number of ordinates in the band."""


class Spectral(msgspec.Struct, frozen=True):
    """The evidence for the verdict, and the figures from which it was computed."""

    evidence: Evidence
    likelihood_ratio: float
    """The likelihood ratio of the null test (is it white noise?), on all ordinates."""
    ordinates: int
    """The effective number of all ordinates."""
    band: Band


def examine(
    whole: Periodogram,
    duration_s: float,
    samples: int,
    *,
    cells: Iterable[BandCells] = (),
    drift: Drift | None = None,
    peaks: tuple[Peak, ...] | None = None,
    before: Periodogram | None = None,
    median: MedianFilter | None = None,
    level: float = LEVEL,
    last_refit: LastRefit | None = None,
    from_hz: float = 0.0,
    notch: Bands = (),
) -> Spectral:
    """Examine one axis.

    `whole`: all ordinates that the user did not exclude. They lie above `from_hz` and outside the bands (low,
    high) `notch` [Hz]. `duration_s`, `samples`: length of the record. `cells`: band powers over time, to test
    whether the noise stayed the same. If empty, there is no such test. `drift`: the drift that was subtracted
    from the samples. `peaks`: peaks that were found in a spectrum of finer resolution; None to search for
    peaks in `whole`. `before`: the ordinates before a comb (lines at all multiples of a frequency) was
    removed; None if none was removed. `median`: the median filter detected in the samples. `level`:
    significance level of each test. `last_refit`: results of earlier refits.

    Raises:
        ValueError: too few ordinates are left, or all ordinates are 0.
    """
    last_refit = last_refit or LastRefit()
    seen = _seen(whole, duration_s, peaks, median, FALSE_PEAK * level / LEVEL, last_refit)
    slow_hz = drift_hz(duration_s, samples)
    clean = _clean(seen, max(from_hz, slow_hz))
    candidates = last_refit.candidates("clean", clean.ordinates, samples)
    found = _unexplained(clean.peaks, whole, candidates)
    ratio, p_all = last_refit.null_test("all", whole if before is None else before)
    p_without = p_all
    if found or seen.combs:
        _, p_without = last_refit.null_test("without peaks", seen.rest.without(from_hz, clean.bands))
    slow = None if clean.slow_line else _slow(seen.rest, from_hz, slow_hz, clean.bands)
    change = partial(_change, cells, whole, seen.of_comb + clean.bands, level, from_hz, notch)
    evidence = Evidence(
        duration_s=duration_s,
        samples=samples,
        rate_hz=1 / whole.h,
        p_all=p_all,
        p_without_peaks=p_without,
        p_clean=p_value(candidates.ratio_white, clean.ordinates.ordinates),
        peaks=seen.combs + found,
        candidates=candidates,
        reading=read(candidates, clean.from_hz, found, apart(level)),
        from_hz=clean.from_hz,
        to_hz=clean.to_hz,
        slow=slow_power(slow_hz, slow, _highest(candidates), whole.h, None if clean.slow_line else drift),
        change=last_refit.result("change", whole.ordinates, change),
        clean=clean.ordinates,
        level=level,
        median=median,
    )
    band = clean.band(notch + seen.of_comb + seen.of_median)
    return Spectral(evidence, ratio, round(whole.ordinates), band)


class _Seen(NamedTuple):
    """The peaks of a spectrum, and the bands (low, high) [Hz] that are left out because of them."""

    combs: tuple[Peak, ...]
    of_comb: Bands
    """The bands of a comb's lines, for live samples. It is empty for a file, since a comb in a file was
    already removed from the samples.
    """
    of_median: Bands
    peaks: tuple[Peak, ...]
    """All peaks other than the comb."""
    bands: Bands
    """One band for each of `peaks`."""
    rest: Periodogram
    """The ordinates outside the frequency bands that are left out for a comb of lines and for a median
    filter.
    """


def _seen(
    whole: Periodogram,
    duration_s: float,
    peaks: tuple[Peak, ...] | None,
    median: MedianFilter | None,
    false_alarm: float,
    last_refit: LastRefit,
) -> _Seen:
    """Return the peaks and their bands. The arguments are those of `examine`."""
    if not float(whole.power.max()) > 0:
        raise ValueError("the samples repeat themselves exactly: there is no noise in them")
    of_comb: Bands = ()
    is_fine = peaks is not None
    if peaks is None:
        peaks, of_comb = last_refit.result("peaks", whole.ordinates, lambda: _peaks(whole, false_alarm))
    of_median = () if median is None else (median.shaped_hz(whole.h, duration_s),)
    try:
        rest = whole.without(0.0, of_comb + of_median) if of_comb or of_median else whole
    except ValueError:  # too few ordinates are left
        rest, of_comb, of_median = whole, (), ()
    others = [peak for peak in peaks if peak.repeats is None]
    if of_median:  # a resonance in the median filter's band is a hump of the filter's response
        others = [peak for peak in others if peak.kind != "resonance" or peak.frequency_hz < of_median[0][0]]
    bands = tuple(peak.notch_hz for peak in others)
    return _Seen(
        tuple(peak for peak in peaks if peak.repeats is not None),
        of_comb,
        of_median,
        tuple(others),
        around(whole, bands) if is_fine else bands,
        rest,
    )


def _peaks(whole: Periodogram, false_alarm: float) -> tuple[tuple[Peak, ...], Bands]:
    """Return the peaks, a comb first, and the bands that are left out to remove the comb."""
    if whole.weight is None:
        return find_peaks(whole, false_alarm), ()
    comb = find_octave_comb(whole, false_alarm * FALSE_COMB / FALSE_PEAK)
    if comb is None:
        return find_peaks(whole, false_alarm), ()
    try:
        return (comb.peak, *find_peaks(whole.without(0.0, comb.bands), false_alarm)), comb.bands
    except ValueError:  # too few values of the spectrum are left between the comb's lines
        return (comb.peak,), ()


def _unexplained(peaks: tuple[Peak, ...], whole: Periodogram, f: CandidateModels) -> tuple[Peak, ...]:
    """Return the peaks that the other parts of the noise do not explain.

    A high-pass removes low frequencies, and a low-pass high ones. The band between them is a hump of the
    spectrum, but no peak. So a hump is discarded if the model, which was fitted outside the hump, also
    explains the power inside it.
    """
    if HighPass not in f.plain.kinds:
        return peaks
    model = f.plain.without(Resonance)
    hz = whole.lam / (2 * np.pi * whole.h)
    found = []
    for peak in peaks:
        low, high = peak.notch_hz
        inside = (hz >= low) & (hz <= high)
        over = whole.power[inside] / model.spectrum(whole.lam[inside], whole.h)
        weight = None if whole.weight is None else whole.weight[inside]
        if peak.kind == "line" or not inside.any() or float(np.average(over, weights=weight)) > EXPLAINED:
            found.append(peak)
    return tuple(found)


def _above_slow_lines(peaks: tuple[Peak, ...], lowest_hz: float) -> float:
    """Return `lowest_hz` [Hz], or the end of the leakage of spectral lines near it, if that is higher."""
    ends = [
        high + LEAKS * (high - low)
        for low, high in (peak.notch_hz for peak in peaks if peak.kind != "resonance")
        if low < SLOW_LINES * lowest_hz
    ]
    return max(lowest_hz, *ends) if ends else lowest_hz


def _slow(whole: Periodogram, from_hz: float, slow_hz: float, found: Bands) -> Periodogram | None:
    """Return the ordinates below `slow_hz` and outside the bands `found`, or None if there are none."""
    hz = whole.lam / (2 * np.pi * whole.h)
    keep = (hz < slow_hz) & (hz >= from_hz)
    for low, high in found:
        keep &= (hz < low) | (hz > high)
    if not keep.any():
        return None
    weight = None if whole.weight is None else whole.weight[keep]
    return whole._replace(lam=whole.lam[keep], power=whole.power[keep], weight=weight)


def _highest(f: CandidateModels) -> Callable[[Array], Array]:
    """Return a function of frequencies [rad a sample] that returns the highest power to be expected there.

    This is the highest power of all plausible models, with the power that leaks from the record's ends. A
    model with an order is plausible if its BIC is hardly worse than that of the best model without one.
    """
    possible = [f.plain] + ([f.ordered] if f.ordered is not None and f.lead > -APART else [])

    leaks = [(one, LEAKS_AT_MOST * end_leak(f, one)) for one in possible]

    def spectrum(lam: Array) -> Array:
        return np.asarray(np.max([one.spectrum(lam, f.h) + leak for one, leak in leaks], axis=0))

    return spectrum


def _change(
    cells: Iterable[BandCells], whole: Periodogram, peaks: Bands, level: float, from_hz: float, notch: Bands
) -> Change | None:
    """Return the change of the noise during the record; None if there is none.

    A band is not tested if much of its power is in `peaks`. The test takes the powers of neighbouring blocks
    of samples as independent. A strong sharp resonance makes them similar, so that parts of the record differ
    although the noise stays the same.
    """
    compared = [band for band in cells if _share_of_peaks(whole, band, peaks) < LARGEST_SHARE]
    return find_change(compared, whole.h, FALSE_CHANGE * level / LEVEL, from_hz, notch)


def _share_of_peaks(whole: Periodogram, band: BandCells, peaks: Bands) -> float:
    """Return the proportion of a band's power that lies in peaks."""
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


class _Clean(NamedTuple):
    """The clean ordinates, to which the models are fitted, and what was left out of them."""

    ordinates: Periodogram
    from_hz: float
    """The lowest frequency [Hz] of the clean ordinates, to which the models are fitted."""
    peaks: tuple[Peak, ...]
    bands: Bands
    """One band for each of `peaks`."""
    slow_line: bool
    """Whether a spectral line of low frequency, or its leakage, hides the lowest frequencies."""

    @property
    def to_hz(self) -> float:
        """The highest frequency [Hz] of the clean ordinates, to which the models are fitted."""
        return float(self.ordinates.lam[-1]) / (2 * np.pi * self.ordinates.h)

    def band(self, left_out: Bands) -> Band:
        """Return the band of these ordinates, from which the peaks' bands and `left_out` are left out."""
        return Band(self.from_hz, self.to_hz, left_out + self.bands, round(self.ordinates.ordinates))


def _clean(seen: _Seen, lowest_hz: float) -> _Clean:
    """Return the clean ordinates, which lie above `lowest_hz` and outside peaks.

    If enough ordinates are left, they begin above the leakage of spectral lines near `lowest_hz`.
    """
    from_hz = _above_slow_lines(seen.peaks, lowest_hz)
    slow_line = from_hz > lowest_hz
    try:
        ordinates, kept = _outside(seen.rest, from_hz, seen.bands)
    except ValueError:
        from_hz = lowest_hz
        ordinates, kept = _outside(seen.rest, from_hz, seen.bands)
    return _Clean(ordinates, from_hz, seen.peaks[:kept], seen.bands[:kept], slow_line)


def _outside(whole: Periodogram, from_hz: float, found: Bands) -> tuple[Periodogram, int]:
    """Return the ordinates above `from_hz` and outside the first k bands of `found`; also return k.

    k is as large as possible: at least half of the ordinates have to be left.

    Raises:
        ValueError: too few ordinates are left even if no band is left out.
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
