"""Make records of the maximum-likelihood fits that a board makes.

The records also have the differences from this computer's fits.

The board needs up to a minute for a fit, so a fit does not belong to the sample that arrives at the same
time. The record of a fit has the time of the sample that is the newest one when the fit arrives. The record's
fields `age` and `samples` state which samples were fitted. The bins of the fitted spectrum arrive later, in
several messages.
"""

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from typing import get_args

import msgspec
import numpy as np

from fltea.records.device_fit import DeviceAxisFit, DeviceSpectrum, DeviceVerdict
from fltea.records.events import DeviceBins, DeviceFit
from fltea.records.fit import AxisFit, Interval
from fltea.records.plus_minus import NORMAL_95
from fltea.records.records import DeviceFits
from fltea.spectrum.candidate_models import native, order_in_white
from fltea.spectrum.periodogram import Binned
from fltea.stream.epoch import Moment
from fltea.stream.live import AcceptedFit

MOST_ORDER = 2.0
"""Largest fractional order α of the noise model that the board fits."""

ROUNDING = 1e-5
"""Largest relative rounding error of a frequency that the device computes in single precision."""

MOST_DPS2 = 1e8
"""Largest possible variance in a fit [(deg/s)²]. It is the square of 10,000 deg/s, which no gyroscope
measures.
"""

CHECK_EVERY_NS = 1_000_000_000
"""This computer checks the board's fit of an axis by fitting the bins itself. Two checks of an axis are at
least this time apart [ns]. A working device sends bins only every half minute.
"""

AS_STATED = (
    *("number", "age", "samples", "ordinates", "evaluations", "searched", "tuned", "bins_left_out"),
    *("ratio_white", "ratio_relaxation"),
)
"""Fields of the board's message about a fit that the record of the fit repeats unchanged."""

VERDICTS: tuple[DeviceVerdict, ...] = get_args(DeviceVerdict)


class BoardFits:
    """Makes records of a board's fits.

    `came`: number of fits that arrived. `refused`: number of fits that arrived before any sample, or had
    impossible numbers or bins.
    """

    def __init__(self, device: str | None, accepted: Callable[[str], AcceptedFit]) -> None:
        self._device, self._accepted = device, accepted
        self._newest: dict[str, DeviceAxisFit] = {}
        self._bins: dict[str, list[DeviceBins]] = {}
        self._checked_ns: dict[str, int] = {}
        self._rate_hz = 0.0
        self.came = self.refused = 0

    def begin(self, rate_hz: float) -> None:
        """Remember the sampling rate [Hz] of the epoch that begins."""
        self._rate_hz = rate_hz

    def forget(self) -> None:
        """Forget the last fits, since the filters restart.

        Bins of these fits that still arrive are not used.
        """
        self._newest.clear()
        self._bins.clear()

    def on_fit(self, fit: DeviceFit, axes: Collection[str], moment: Moment | None) -> Iterator[DeviceFits]:
        """Yield the record of a fit that arrived. `moment`: number and times of the newest sample."""
        self.came += 1
        found = _axis_fit(fit, self._accepted(fit.axis).fit) if fit.axis in axes else None
        if moment is None or found is None:
            self.refused += fit.axis in axes
            return
        self._newest[fit.axis], self._bins[fit.axis] = found, []
        yield DeviceFits(*moment, {fit.axis: found}, device=self._device)

    def on_bins(self, bins: DeviceBins, moment: Moment | None) -> Iterator[DeviceFits]:
        """Store some of the spectral bins of an axis's newest fit.

        When all bins of this fit have arrived, yield the record of the fit again, with its bins.
        """
        fit, parts = self._newest.get(bins.axis), self._bins.get(bins.axis)
        if fit is None or parts is None or moment is None or bins.number != fit.number:
            return
        total = parts[0].total if parts else bins.total
        if not bins.hz or bins.total != total or bins.first != sum(len(part.hz) for part in parts):
            self._bins.pop(bins.axis)  # some bins of this fit were lost, so all its bins are given up
            return
        parts.append(bins)
        if bins.first + len(bins.hz) < total:
            return
        self._bins.pop(bins.axis)
        spectrum = self._spectrum(parts)
        if spectrum is None:
            self.refused += 1
            return
        checked = self._check(spectrum, bins.axis, moment) if fit.alpha.value is not None else None
        found = msgspec.structs.replace(fit, spectrum=spectrum, alpha_of_bins=checked)
        yield DeviceFits(*moment, {bins.axis: found}, device=self._device)

    def _spectrum(self, parts: Sequence[DeviceBins]) -> DeviceSpectrum | None:
        """Return the spectrum of all bins; None if the numbers of a bin are impossible."""
        hz = [one for part in parts for one in part.hz]
        density = [one for part in parts for one in part.density_dps2_per_hz]
        ordinates = [one for part in parts for one in part.ordinates]
        highest = self._rate_hz / 2 * (1 + ROUNDING) if self._rate_hz > 0 else math.inf
        if not all(map(math.isfinite, (*hz, *density, *ordinates))):
            return None
        if min(*hz, *ordinates) <= 0 or max(hz) > highest or min(density) < 0:
            return None
        rising = sorted(zip(hz, map(math.sqrt, density), ordinates, strict=True))
        return DeviceSpectrum(*(list(column) for column in zip(*rising, strict=True)))

    def _check(self, spectrum: DeviceSpectrum, axis: str, moment: Moment) -> float | None:
        """Fit the board's bins on this computer, and return the order α of this fit.

        Return None if no such check is due or possible.
        """
        before_ns = self._checked_ns.get(axis)
        if not self._rate_hz > 0 or (before_ns is not None and moment.host_ns - before_ns < CHECK_EVERY_NS):
            return None
        self._checked_ns[axis] = moment.host_ns
        return order_of_bins(spectrum, self._rate_hz)


def _axis_fit(fit: DeviceFit, host: AxisFit | None) -> DeviceAxisFit | None:
    """Return the board's fit of an axis as the record states it; None if a number in it is impossible."""
    ratios = fit.ordinates, fit.ratio_white, fit.ratio_relaxation
    numbers = *ratios, fit.alpha, fit.f, fit.s2_dps2, fit.R_dps2
    verdict = next((one for one in VERDICTS if one == fit.verdict), None)
    if verdict is None or not all(map(math.isfinite, numbers)):
        return None
    some, ordered = verdict != "none", verdict in ("fractional", "relaxation")
    if some and not (fit.ordinates > 0 and 0 <= fit.R_dps2 <= MOST_DPS2):
        return None
    if ordered and not (0 <= fit.alpha <= MOST_ORDER and 0 <= fit.s2_dps2 <= MOST_DPS2 and fit.f <= 0):
        return None
    alpha = Interval()
    if ordered:
        reach = NORMAL_95 * fit.alpha_std
        low, high = max(0.0, fit.alpha - reach), min(MOST_ORDER, fit.alpha + reach)
        known = fit.alpha_defined and math.isfinite(reach) and low < high
        alpha = Interval(fit.alpha, *((low, high) if known else (None, None)))
    difference = half_widths = None
    if host is not None and alpha.value is not None and host.alpha.value is not None:
        difference = alpha.value - host.alpha.value
        if host.alpha.low is not None and host.alpha.high is not None and host.alpha.high > host.alpha.low:
            half_widths = difference / ((host.alpha.high - host.alpha.low) / 2)
    return DeviceAxisFit(
        **{name: getattr(fit, name) for name in AS_STATED},
        verdict=verdict,
        alpha=alpha,
        f=Interval(fit.f if ordered else None),
        s2=Interval(fit.s2_dps2 if ordered else None),
        R=Interval(fit.R_dps2 if some else None),
        alpha_difference=difference,
        half_widths=half_widths,
        host_verdict=host.verdict if host is not None else None,
    )


def order_of_bins(spectrum: DeviceSpectrum, rate_hz: float) -> float | None:
    """Fit on this computer the bins that a board has fitted, to check the board's arithmetic.

    The noise model is a sum of fractional noise and white noise. The result is the order α with the highest
    likelihood. It is None if the bins cannot be fitted, for example if two bins have the same frequency. This
    may happen if the board's record has several stretches.
    """
    lam = np.array(spectrum.hz) * (2 * math.pi / rate_hz)
    power = np.square(spectrum.density) * (rate_hz / 2)
    data = Binned(lam, np.array(spectrum.ordinates), power[np.newaxis])
    try:
        return order_in_white(native(data, 1 / rate_hz, 0)).eta[1]
    except ValueError:
        return None
