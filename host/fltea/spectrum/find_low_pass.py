"""Whether a spectrum has gone through a low-pass filter (pure)."""

import math

import numpy as np
from numpy.typing import NDArray

from fltea.noise import spectra as spectrum
from fltea.spectrum.arfima import LEAST_ORDER, MOST_ORDER
from fltea.spectrum.low_pass import LowPass, fit_low_pass, of_one_pole, steep
from fltea.spectrum.models import ar2_parameters, fractional, parameters
from fltea.spectrum.periodogram import Binned
from fltea.spectrum.pole_pair import pole_pair
from fltea.spectrum.profile import CRITICAL
from fltea.spectrum.relaxations import sum_parameters
from fltea.spectrum.rivals import APART, Fits, bic, is_order
from fltea.spectrum.warm import Search
from fltea.spectrum.whittle import Fit, fit, negative_log_likelihood

Array = NDArray[np.float64]

LARGEST_FLOOR, LARGEST_OF_SLOW = 0.03, 0.003
"""Shares of white noise and of slow parts that rounding may add to a low-pass of one pole."""
SLOW_CORNER = 2 * math.pi / 100
"""Rad a sample: nobody filters a hundred times as slowly as he samples."""
LEAST_PHI = 0.05
"""The spectrum of AR(1) with less falls by less than a fifth."""
PHI = np.linspace(LEAST_PHI, 0.98, 48)
PLATEAUS = np.linspace(0.7, 1.4, 15)
BOUNDED = fractional(MOST_ORDER)
CORNERS = np.linspace(math.log(0.05), math.log(3.0), 7).tolist()
"""Logarithms of rad a sample, of one pole."""
HALVINGS = 3


def find_low_pass(h: float, fits: Fits, search: Search, more: float = 0.0) -> LowPass | None:
    """Return the filter that the noise of `fits` has gone through; None if none is seen. h in s.

    more: what 2 log L has to gain more than of one look.
    """
    if fits.rising is None:  # it is white
        return None
    data = fits.data
    found = fit_low_pass(data, search)
    phi1, phi2, _ = (float(v) for v in ar2_parameters(fits.ar2.theta[0]))
    peak = "resonance_hz" in pole_pair(data, phi1, phi2, h)
    others = [fits.null.white, *fits.sums, fits.null.alternative, fits.rising]
    others += [fits.ar2] if peak else []
    others += [fits.order] if is_order(fits.order) else []
    without = min(others, key=lambda one: bic(one, data))
    filtered = min(bic(one, data) for one in (found, *([] if peak else [fits.ar2])))
    gain = 2 * float(without.nll[0] - found.nll[0])
    if filtered + more < bic(without, data) and gain > APART + more:
        low_pass = steep(found, h, gain)
        if low_pass is not None:
            return low_pass
    return None if any(without is one for one in (fits.ar2, fits.null.white)) else _one_pole(h, fits, more)


def _one_pole(h: float, fits: Fits, more: float) -> LowPass | None:
    """Return the fastest relaxation, if next to nothing is faster and no fractional order says the same."""
    data = fits.data
    best = min(fits.sums, key=lambda one: bic(one, data))
    if is_order(fits.order) and bic(fits.order, data) < bic(best, data):
        return None
    if 2 * float(fits.bounded.nll[0] - best.nll[0]) <= APART + more:
        return None
    if (phi := _before_an_order(data, bic(best, data) - more)) is not None:
        return of_one_pole(phi, 0.0, h)
    p = sum_parameters(best.theta, best.theta.shape[1] // 2)
    fastest = int(p.poles[0].argmin())
    phi, white = float(p.poles[0, fastest]), float(p.white[0])
    if phi < LEAST_PHI:
        return None
    plateau = float(p.shares[0, fastest]) / (1 - phi) ** 2
    corner = np.array([min(-np.log(phi), np.pi)])
    if float(best.model.shape(corner, best.theta)[0, 0]) > 2 * (plateau / 2 + white):
        return None
    if white <= (LARGEST_FLOOR if corner[0] > SLOW_CORNER else LARGEST_OF_SLOW) * plateau:
        return of_one_pole(phi, white / plateau, h)
    pure = _pure(data, best, fastest)
    return None if pure is None else of_one_pole(pure, 0.0, h)


def _before_an_order(data: Binned, to_beat: float) -> float | None:
    """Return φ of a pole that noise of an order has gone through, if it brings BIC below `to_beat`.

    Such noise looks like a sum of relaxations of which the fastest is the filter.
    """
    found: dict[float, tuple[float, Fit]] = {}

    def fitted(log_corner: float, warm: Fit | None) -> None:
        gain = spectrum.ar1(data.lam, math.exp(-math.exp(log_corner)))
        through = fit(data._replace(power=data.power / gain), BOUNDED, warm=warm and warm.theta)
        of_gain = 2 * float(data.counts @ np.log(gain)) + math.log(data.ordinates)
        found[log_corner] = bic(through, data) + of_gain, through

    def best() -> float:
        return min(found, key=lambda one: found[one][0])

    last = None
    for log_corner in CORNERS:
        fitted(log_corner, last)
        last = found[log_corner][1]
    step = CORNERS[1] - CORNERS[0]
    for _ in range(HALVINGS):
        step /= 2
        middle = best()
        for log_corner in (middle - step, middle + step):
            fitted(log_corner, found[middle][1])
    lowest, through = found[best()]
    alpha = float(parameters(through.theta[0], MOST_ORDER).alpha)
    phi = math.exp(-math.exp(best()))
    return phi if lowest < to_beat and alpha >= LEAST_ORDER and phi > LEAST_PHI else None


def _pure(data: Binned, found: Fit, fastest: int) -> float | None:
    """Return φ of the fastest relaxation if the data are described as well without white noise."""
    p = sum_parameters(found.theta, found.theta.shape[1] // 2)
    slow = np.zeros_like(data.lam)
    for k in range(p.poles.shape[1]):
        if k != fastest:
            slow += p.shares[0, k] * spectrum.ar1(data.lam, p.poles[0, k])
    level = float(p.shares[0, fastest] / (1 - p.poles[0, fastest]) ** 2 + p.white[0])
    rows = np.zeros(PHI.size * PLATEAUS.size, dtype=np.intp)
    phis, plateaus, lowest = PHI, level * PLATEAUS, math.inf
    for _ in range(2):  # coarse, then fine
        phi, plateau = (axis.ravel() for axis in np.meshgrid(phis, plateaus, indexing="ij"))
        shapes = slow + (plateau * (1 - phi) ** 2)[:, np.newaxis] * spectrum.ar1(data.lam, phi)
        nll, _ = negative_log_likelihood(data, shapes, rows)
        best = int(nll.argmin())
        lowest = float(nll[best])
        phis = np.clip(phi[best] + np.linspace(-1, 1, PHI.size) * (phis[1] - phis[0]), LEAST_PHI, 0.999)
        plateaus = plateau[best] + np.linspace(-1, 1, PLATEAUS.size) * (plateaus[1] - plateaus[0])
    return float(phi[best]) if 2 * (lowest - float(found.nll[0])) < CRITICAL else None
