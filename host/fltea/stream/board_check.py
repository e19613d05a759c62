"""This computer's fit of the bins that a board fitted: a check of the board's arithmetic (pure)."""

import math

import numpy as np

from fltea.records.device_fit import DeviceSpectrum
from fltea.spectrum.likelihood_ratio import null_fits
from fltea.spectrum.models import FULL, parameters
from fltea.spectrum.periodogram import Binned
from fltea.spectrum.whittle import fit


def order_of_bins(spectrum: DeviceSpectrum, rate_hz: float) -> float | None:
    """Order of the fractional model of the highest likelihood; None for bins that cannot be fitted.

    Such are bins of several stretches of samples, of which two may have the same frequency.
    """
    lam = np.array(spectrum.hz) * (2 * math.pi / rate_hz)
    power = np.square(spectrum.density) * (rate_hz / 2)
    data = Binned(lam, np.array(spectrum.ordinates), power[np.newaxis])
    try:
        null = null_fits(data)
        full = fit(data, FULL, null.alternative.theta[np.newaxis])
    except ValueError:
        return None
    return float(parameters(full.theta[0]).alpha)
