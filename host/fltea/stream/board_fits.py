"""What a board's own maximum-likelihood fits become: records, with their difference from this computer's fit.

A fit takes the board up to a minute, so its record stands at the newest sample when it comes; `age` and
`samples` say of what it is. Its bins come behind it, some at a time.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, get_args

import msgspec

from fltea.records.device_fit import DeviceAxisFit, DeviceSpectrum, DeviceVerdict
from fltea.records.events import DeviceBins, DeviceFit
from fltea.records.fit import AxisFit, Interval
from fltea.records.records import DeviceFits
from fltea.stream.board_check import order_of_bins
from fltea.stream.live import Said

NORMAL_95 = 1.96
"""Standard deviations of a 95 % interval."""

MOST_ORDER = 2.0
"""Of the model that the board fits."""

VERDICTS: tuple[DeviceVerdict, ...] = get_args(DeviceVerdict)


class Place(NamedTuple):
    """Of the newest sample."""

    seq: int
    epoch: int
    device_us: int
    host_ns: int


class BoardFits:
    """Makes the records.

    came: fits that came; unplaced: those of them for which there was no sample yet, or whose numbers no fit
    can have.
    """

    def __init__(self, device: str | None, said: Callable[[str], Said]) -> None:
        self._device, self._said = device, said
        self._newest: dict[str, DeviceAxisFit] = {}
        self._bins: dict[str, list[DeviceBins]] = {}
        self._rate_hz = 0.0
        self.came = self.unplaced = 0

    def begin(self, rate_hz: float) -> None:
        """Begin an epoch of samples at a rate."""
        self._rate_hz = rate_hz

    def forget(self) -> None:
        """Another epoch: bins that are still to come belong to no fit."""
        self._newest.clear()
        self._bins.clear()

    def on_fit(self, fit: DeviceFit, axes: Sequence[str], place: Place | None) -> Iterator[DeviceFits]:
        """Take a fit."""
        self.came += 1
        found = _axis_fit(fit, self._said(fit.axis).fit) if fit.axis in axes else None
        if place is None or found is None:
            self.unplaced += fit.axis in axes
            return
        self._newest[fit.axis], self._bins[fit.axis] = found, []
        yield DeviceFits(*place, {fit.axis: found}, device=self._device)

    def on_bins(self, bins: DeviceBins, place: Place | None) -> Iterator[DeviceFits]:
        """Take some bins of the newest fit; the fit again with all of them, when they are there."""
        fit, parts = self._newest.get(bins.axis), self._bins.get(bins.axis)
        if fit is None or parts is None or place is None or bins.number != fit.number:
            return
        if bins.first != sum(len(part.hz) for part in parts):  # some were lost
            self._bins.pop(bins.axis)
            return
        parts.append(bins)
        spectrum = _spectrum(parts)
        if spectrum is not None:
            self._bins.pop(bins.axis)
            known = fit.alpha.value is not None and self._rate_hz > 0
            checked = order_of_bins(spectrum, self._rate_hz) if known else None
            found = msgspec.structs.replace(fit, spectrum=spectrum, alpha_of_bins=checked)
            yield DeviceFits(*place, {bins.axis: found}, device=self._device)


def _spectrum(parts: Sequence[DeviceBins]) -> DeviceSpectrum | None:
    """All bins, as soon as they are there; None too if one is no bin."""
    hz = [one for part in parts for one in part.hz]
    density = [one for part in parts for one in part.density_dps2_per_hz]
    ordinates = [one for part in parts for one in part.ordinates]
    if len(hz) != parts[-1].total or not all(map(math.isfinite, (*hz, *density, *ordinates))):
        return None
    if min((*hz, *density, *ordinates), default=-1.0) < 0:
        return None
    rising = sorted(zip(hz, map(math.sqrt, density), ordinates, strict=True))
    return DeviceSpectrum(*(list(column) for column in zip(*rising, strict=True)))


def _axis_fit(fit: DeviceFit, host: AxisFit | None) -> DeviceAxisFit | None:
    """The fit of an axis; None if its numbers are none of a fit."""
    numbers = (
        fit.ordinates,
        fit.ratio_white,
        fit.ratio_relaxation,
        fit.alpha,
        fit.f,
        fit.s2_dps2,
        fit.R_dps2,
    )
    verdict = next((one for one in VERDICTS if one == fit.verdict), None)
    if verdict is None or not all(map(math.isfinite, numbers)):
        return None
    alpha = Interval()
    if verdict != "white":
        reach = NORMAL_95 * fit.alpha_std
        known = fit.alpha_defined and math.isfinite(reach)
        low, high = max(0.0, fit.alpha - reach), min(MOST_ORDER, fit.alpha + reach)
        alpha = Interval(fit.alpha, *((low, high) if known else (None, None)))
    difference = half_widths = None
    if host is not None and alpha.value is not None and host.alpha.value is not None:
        difference = alpha.value - host.alpha.value
        if host.alpha.low is not None and host.alpha.high is not None and host.alpha.high > host.alpha.low:
            half_widths = difference / ((host.alpha.high - host.alpha.low) / 2)
    return DeviceAxisFit(
        verdict=verdict,
        number=fit.number,
        age=fit.age,
        samples=fit.samples,
        ordinates=fit.ordinates,
        evaluations=fit.evaluations,
        searched=fit.searched,
        tuned=fit.tuned,
        ratio_white=fit.ratio_white,
        ratio_relaxation=fit.ratio_relaxation,
        alpha=alpha,
        f=fit.f if alpha.value is not None else None,
        s2=fit.s2_dps2 if alpha.value is not None else None,
        R=fit.R_dps2,
        alpha_difference=difference,
        half_widths=half_widths,
        host_verdict=host.verdict if host is not None else None,
    )
