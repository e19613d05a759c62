"""What the spectrum of one axis says: null tests, peaks, filter, stationarity, and the contest of the models.

There are several sets of ordinates: all that the user left in; these without lines and resonances; of these
those above what is called drift; and these without the low-pass that all have gone through. The last are the
clean ones, to which the models are fitted.

The same for a recording and for a sensor that is looked at every second; only the level differs.
"""

from collections.abc import Callable, Iterable

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.spectrum.drift import drift_hz, slow_power
from fltea.spectrum.evidence import LEVEL, Evidence, more_than_once
from fltea.spectrum.find_low_pass import find_low_pass
from fltea.spectrum.how_long import seconds_to_tell
from fltea.spectrum.likelihood_ratio import NullFits, null_fits, p_value
from fltea.spectrum.lines import Peak, find_peaks
from fltea.spectrum.low_pass import LowPass, divided, power_gain
from fltea.spectrum.octave_lines import around, find_octave_peaks
from fltea.spectrum.octaves import BandCells, Drift
from fltea.spectrum.periodogram import FEWEST, Periodogram, binned
from fltea.spectrum.rivals import APART, Contest, Fits, contest, fit_all
from fltea.spectrum.stationarity import Change, find_change
from fltea.spectrum.warm import Warm

Array = NDArray[np.float64]
Bands = tuple[tuple[float, float], ...]


FALSE_PEAK = 0.01
"""Probability to find one where there is none, at `LEVEL`; the bins of octaves do not show lines so well that
less would leave those of real sensors."""
FALSE_CHANGE = 1e-3
"""The same probability for a change during the record."""
LEAKS = 3.0
"""The distance over which a line leaks, over the width of its notch."""
SLOW_LINES = 4.0
"""The frequency over the lowest one below which lines are slow ones."""
LEAST_CORNER = 10.0
"""A low-pass's least corner over the lowest frequency: what is slower is drift, or a relaxation."""
NEAR = (0.4, 1.5)
"""Frequencies over the corner of a low-pass between which a resonance is but the filter's fall."""
LARGE_SHARE = 0.05
"""The share of the power in a resonance that has skirts to be seen."""
LARGEST_SHARE = 0.3
"""The largest share of peaks in a band's power for which changes of the band are looked for."""


class Band(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The clean ordinates of the band that is judged."""

    from_hz: float
    to_hz: float
    notch_hz: Bands
    ordinates: int
    """The number of effective ordinates."""


class Spectral(msgspec.Struct, frozen=True):
    """The evidence, and the figures that it was drawn from."""

    evidence: Evidence
    likelihood_ratio: float
    """The null test's ratio on all ordinates."""
    ordinates: int
    """The number of all effective ordinates."""
    fits: Fits
    """The fits to the clean ordinates."""
    band: Band

    def spectrum(self, lam: Array, h: float) -> Array:
        """Return the spectrum of the fractional model through the low-pass, (len(lam),); h in s."""
        found: Array = self.fits.full.spectrum(lam)[0]
        low_pass = self.evidence.low_pass
        return found if low_pass is None else found * power_gain(lam, low_pass, h)


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
        false_alarm = FALSE_PEAK * level / LEVEL
        find = find_peaks if whole.weight is None else find_octave_peaks
        peaks = warm.looked("peaks", ordinates, lambda: find(whole, false_alarm))
        found = tuple(peak.notch_hz for peak in peaks)
    else:
        found = around(whole, tuple(peak.notch_hz for peak in peaks))
    slow_hz = drift_hz(duration_s, samples)
    clean_from_hz = max(from_hz, slow_hz)
    above_lines_hz = _above_slow_lines(peaks, clean_from_hz)
    slow_line = above_lines_hz > clean_from_hz
    try:
        clean, kept = _clean(whole, above_lines_hz, found)
        clean_from_hz = above_lines_hz
    except ValueError:
        clean, kept = _clean(whole, clean_from_hz, found)
    peaks, found = peaks[:kept], found[:kept]
    p_without_peaks = _null_p(whole.without(from_hz, found), warm) if peaks else p_all
    kept_peaks = peaks
    low_pass = warm.looked("low-pass", ordinates, lambda: _low_pass(clean, warm, kept_peaks, level))
    clean, fits = _through(clean, low_pass, warm)
    peaks = _not_ripples(peaks, low_pass)
    rivals = contest(clean, fits)

    def change() -> Change | None:
        # Where a sharp resonance rules, neighbouring blocks are alike: parts of the record differ for that.
        compared = [one for one in cells if _share_of_peaks(whole, one, found) < LARGEST_SHARE]
        return find_change(compared, clean.h, FALSE_CHANGE * level / LEVEL, from_hz, notch)

    def decides() -> float | None:
        return seconds_to_tell(fits.data, fits.order, fits.sums[-1], duration_s, APART)

    p_clean = p_value(rivals.ratio_white, clean.ordinates)
    to_hz = float(clean.lam[-1]) / (2 * np.pi * clean.h)
    evidence = Evidence(
        duration_s=duration_s,
        samples=samples,
        rate_hz=1 / whole.h,
        p_all=p_all,
        p_without_peaks=p_without_peaks,
        p_clean=p_clean,
        peaks=peaks,
        contest=rivals,
        from_hz=clean_from_hz,
        to_hz=to_hz,
        slow=slow_power(
            slow_hz,
            None if slow_line else _slow(whole, from_hz, slow_hz, found),
            _highest(rivals, fits),
            whole.h,
            None if slow_line else drift,
        ),
        low_pass=low_pass,
        change=warm.looked("change", ordinates, change),
        decides_s=warm.looked("decides", ordinates, decides) if _close(rivals) and p_clean < level else None,
        level=level,
    )
    return Spectral(
        evidence,
        ratio,
        round(ordinates),
        fits,
        Band(clean_from_hz, to_hz, notch + found, round(clean.ordinates)),
    )


def _low_pass(clean: Periodogram, warm: Warm, peaks: tuple[Peak, ...], level: float) -> LowPass | None:
    """Return the filter, unless it is a resonance or drift that looks so."""
    search = warm.of("clean")
    low_pass = find_low_pass(clean.h, fit_all(clean, search), search, more_than_once(level))
    lowest_hz = float(clean.lam[0]) / (2 * np.pi * clean.h)
    if low_pass is None or low_pass.corner_hz < LEAST_CORNER * lowest_hz or _skirts(peaks, low_pass):
        return None
    return low_pass


def _through(clean: Periodogram, low_pass: LowPass | None, warm: Warm) -> tuple[Periodogram, Fits]:
    """Return what has gone into the filter, and the fits to that; the same again if there is none."""
    if low_pass is not None:
        try:
            through = divided(clean, low_pass)
            return through, fit_all(through, warm.of("through"))
        except ValueError:  # too few ordinates are left to say anything else
            pass
    return clean, fit_all(clean, warm.of("clean"))


def _above_slow_lines(peaks: tuple[Peak, ...], lowest_hz: float) -> float:
    """Return where the clean ordinates begin: beyond what leaks from slow lines."""
    ends = [
        high + LEAKS * (high - low)
        for low, high in (peak.notch_hz for peak in peaks if peak.kind != "resonance")
        if low < SLOW_LINES * lowest_hz
    ]
    return max(lowest_hz, *ends) if ends else lowest_hz


def _skirts(peaks: tuple[Peak, ...], low_pass: LowPass) -> bool:
    """Return whether it is a resonance that falls so, or what leaks from a line, and no filter."""
    # A filter of one pole is a faint fall: beside a resonance it cannot be told from its skirt.
    low, high = NEAR
    if low_pass.poles == 1 and any(p.kind == "resonance" and p.power_share > LARGE_SHARE for p in peaks):
        return True
    return any(
        peak.power_share > LARGE_SHARE and low < peak.frequency_hz / low_pass.corner_hz < high
        for peak in peaks
    )


def _not_ripples(peaks: tuple[Peak, ...], low_pass: LowPass | None) -> tuple[Peak, ...]:
    """Return the peaks but for the side lobes of a filter of finite length."""
    if low_pass is None:
        return peaks
    return tuple(peak for peak in peaks if peak.kind == "line" or peak.frequency_hz < low_pass.corner_hz)


def _slow(whole: Periodogram, from_hz: float, slow_hz: float, found: Bands) -> Periodogram | None:
    """Return the ordinates below slow_hz, if there are any."""
    hz = whole.lam / (2 * np.pi * whole.h)
    keep = (hz < slow_hz) & (hz >= from_hz)
    for low, high in found:
        keep &= (hz < low) | (hz > high)
    if not keep.any():
        return None
    weight = None if whole.weight is None else whole.weight[keep]
    return whole._replace(lam=whole.lam[keep], power=whole.power[keep], weight=weight)


def _highest(rivals: Contest, fits: Fits) -> Callable[[Array], Array]:
    """Return the highest spectrum of the models that may be right."""
    named = fits.named()
    possible = [named[rivals.best]]
    if rivals.best != "white":
        possible += [named[rivals.best_sum], fits.order]

    def spectrum(lam: Array) -> Array:
        return np.asarray(np.max([one.spectrum(lam)[0] for one in possible], axis=0))

    return spectrum


def _close(rivals: Contest) -> bool:
    """Return whether the fractional model and a sum of relaxations describe the data as well."""
    return abs(rivals.order_gain - rivals.sum_gain) <= APART


def _share_of_peaks(whole: Periodogram, band: BandCells, peaks: Bands) -> float:
    """Return the share of a band's power that is in peaks."""
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


def _clean(whole: Periodogram, from_hz: float, found: Bands) -> tuple[Periodogram, int]:
    """Return the clean ordinates, and how many of the bands `found` are left out.

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
