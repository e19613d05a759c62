"""What the figures of the report are drawn from: more than the numbers in `axis.AxisResult`."""

from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.estimator.baseline import baseline_of, lane_baselines
from fltea.estimator.lane_settings import LaneSettings
from fltea.estimator.lanes import Lanes
from fltea.identification.axis import AxisResult, IdentifyOptions
from fltea.identification.fltea_fit import after_startup
from fltea.identification.gaps import Gaps, bridged, longest_epoch, no_gaps
from fltea.identification.shuffled import ACCURACY, BLOCK, PROBABILITIES
from fltea.identification.sums import left_in, lines_of_stretches, octaves_of_stretches
from fltea.noise.spectra import HIGHEST_ORDER
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.models import FULL, held, share
from fltea.spectrum.periodogram import binned
from fltea.spectrum.profile import NO_WHITE, critical_value
from fltea.spectrum.whittle import fit

Array = NDArray[np.float64]

COPIES = 60
POINTS = 400
"""The largest number of points of a trajectory."""
LAGS = 100
ORDERS = np.linspace(0, HIGHEST_ORDER - 0.01, 41)


class Spectrum(NamedTuple):
    """The periodogram in bins, over all ordinates that the user left in."""

    hz: Array
    power: Array
    counts: Array
    """Ordinates in each bin."""


class Path(NamedTuple):
    """FLTEA's estimates over time, and quantiles (points, 3) of what white noise gives after as long."""

    t_s: Array
    alpha: Array
    alpha_std: Array
    f: Array
    f_std: Array
    white_alpha: Array
    white_f: Array
    copies: int


class Curves(NamedTuple):
    """All of one axis."""

    spectrum: Spectrum
    orders: Array
    deviance: Array
    """2 log L below the best fit, of the best fit that has the order."""
    critical: Array
    """The deviance up to which the order is in its interval."""
    path: Path
    autocorrelation: Array
    """The autocorrelation of FLTEA's innovations in the last two thirds, at lags 1 to `LAGS`."""
    innovations: int


def curves(
    y: Array,
    h: float,
    lsb: float | None,
    options: IdentifyOptions,
    result: AxisResult,
    gaps: Gaps | None = None,
) -> Curves:
    """Make them for an axis that has been identified; arguments as for `axis.identify_axis`."""
    gaps = gaps or no_gaps()
    stretches = bridged(y, gaps)
    lines, _ = lines_of_stretches(stretches, octaves_of_stretches(stretches), h)
    whole = binned(left_in(lines, options.from_hz, options.notch_hz))
    clean = binned(left_in(lines, result.band.from_hz, result.band.notch_hz))
    fits = [fit(clean, held("alpha", alpha)) for alpha in ORDERS.tolist()]
    nll = np.array([float(one.nll[0]) for one in fits])
    weight = np.array([float(share(one.theta[0, -1])) for one in fits])
    critical = np.array([critical_value("alpha", one) for one in (1 - weight < NO_WHITE * weight).tolist()])
    lowest = min(float(nll.min()), float(fit(clean, FULL).nll[0]))
    path, innovation = _path(y, gaps, h, lsb, options)
    tested = innovation[len(innovation) // 3 :]
    return Curves(
        Spectrum(whole.lam / (2 * np.pi * h), whole.power[0], whole.counts),
        ORDERS,
        2 * (nll - lowest),
        critical,
        path,
        _autocorrelation(tested),
        len(tested),
    )


def _path(y: Array, gaps: Gaps, h: float, lsb: float | None, options: IdentifyOptions) -> tuple[Path, Array]:
    """Return the data over which FLTEA is run in lane 0, and white noise drawn from them in the others.

    Returns the innovations of the data, too.
    """
    config, startup = options.estimator, options.estimator.startup_needed
    begin, end = longest_epoch(len(y), gaps)
    y, gaps = y[begin:end], gaps.within(begin, end)
    copies = min(COPIES, options.shuffles)
    rng = np.random.default_rng(options.seed)
    own = baseline_of(y, "axis", config, lsb)
    bias, R = _baselines(rng.choice(y, (startup, copies)), own.bias_dps[0], own.R[0], config, lsb)
    settings = LaneSettings(msgspec.structs.replace(config, memory="compressed"), h, R, accuracy=ACCURACY)
    lanes = Lanes(copies + 1, settings)
    rest, missing = after_startup(y, gaps, config)
    block = max(BLOCK, -(-len(rest) // POINTS))
    rows, innovation = [], np.empty(len(rest))
    for start in range(0, len(rest), block):
        now = rest[start : start + block]
        drawn = rng.choice(y, (len(now), copies))
        # What is lost of the data is lost of the copies.
        gone = (
            None if missing is None else np.repeat(missing[start : start + block, None], copies + 1, axis=1)
        )
        e = lanes.run(np.column_stack([now, drawn]) - bias, gone)
        innovation[start : start + block] = e.innovation[:, 0]
        rows.append(np.stack([e.alpha[-1], e.alpha_std[-1], e.f[-1], e.f_std[-1]]))
    table = np.stack(rows)
    ends = np.minimum(np.arange(1, len(rows) + 1) * block, len(rest))
    white = table[:, :, 1:]
    alpha, alpha_std, f, f_std = table[:, :, 0].T
    white_alpha, white_f = _quantiles(white[:, 0]), _quantiles(white[:, 2])
    t_s = (startup + ends) * h
    return Path(t_s, alpha, alpha_std, f, f_std, white_alpha, white_f, copies), innovation


def _baselines(
    window: Array, bias: float, R: float, config: EstimatorConfig, lsb: float | None
) -> tuple[Array, Array]:
    """Return bias and R of all lanes; the copies have those of their own start-up windows."""
    biases, Rs = lane_baselines(window, config, lsb)
    # A copy can happen to be constant, of data that hardly ever change.
    Rs = np.maximum(Rs, 1e-6 * R) if config.R == "auto" else Rs
    return np.append(bias, biases), np.append(R, Rs)


def _quantiles(values: Array) -> Array:
    """Return quantiles over the copies, (points, 3), or NaN where there are none."""
    found = np.full((len(values), 3), np.nan)
    for row, these in zip(found, values, strict=True):
        finite = these[np.isfinite(these)]
        if finite.size:
            row[:] = np.quantile(finite, PROBABILITIES)
    return found


def _autocorrelation(values: Array) -> Array:
    good = values[np.isfinite(values)]
    power = float(good @ good) or 1.0
    return np.array([good[lag:] @ good[:-lag] / power for lag in range(1, LAGS + 1)])
