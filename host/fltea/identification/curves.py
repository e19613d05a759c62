"""Compute the curves for the pictures of the report."""

from typing import NamedTuple

import msgspec
import numpy as np

from fltea.estimator.baseline import baseline_of, lane_baselines
from fltea.estimator.lane_settings import LaneSettings
from fltea.estimator.lanes import Lanes
from fltea.identification.axis import AxisAnalysis, IdentifyOptions
from fltea.identification.fltea_fit import after_startup
from fltea.identification.gaps import Gaps, longest_epoch
from fltea.identification.shuffled import ACCURACY, BLOCK, PROBABILITIES
from fltea.identification.sums import left_in
from fltea.noise.parts import Arfima, Order
from fltea.records.arrays import Array
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.candidate_models import CandidateModels
from fltea.spectrum.intervals import little_white
from fltea.spectrum.periodogram import binned

COPIES = 60
POINTS = 400
"""Largest number of points that show FLTEA's estimates over time."""
LAGS = 100
ORDERS = np.linspace(0.0, 1.5, 61)


class Spectrum(NamedTuple):
    """The periodogram, averaged in bins. The bins contain all ordinates that the user did not leave out."""

    hz: Array
    power: Array
    counts: Array
    """Number of ordinates that were averaged in each bin."""


class Path(NamedTuple):
    """FLTEA's estimates for the data over time, and for comparison those for white noise.

    White noise is made by shuffling: `copies` copies consist of samples drawn at random from the data.
    `white_alpha` and `white_f` are three quantiles of the estimates for these copies at each time, (points,
    3).
    """

    t_s: Array
    alpha: Array
    alpha_std: Array
    f: Array
    f_std: Array
    white_alpha: Array
    white_f: Array
    copies: int


class Curves(NamedTuple):
    """All curves of one axis."""

    spectrum: Spectrum
    orders: Array
    deviance: Array
    """How much worse the model fits with its order fixed at each of `orders`: the decrease of 2 log L, twice
    the logarithm of the likelihood.
    """
    path: Path | None
    """FLTEA's estimates over time; None if FLTEA was not run."""
    autocorrelation: Array
    """Autocorrelation of FLTEA's innovations in the last two thirds of the record, at lags 1 to `LAGS`."""
    innovations: int


def curves(
    analysis: AxisAnalysis, lsb: float | None, options: IdentifyOptions, *, with_path: bool = True
) -> Curves:
    """Return the curves of an axis that has been identified with these options.

    `lsb`: one count in the unit of the samples, if known. `with_path`: whether FLTEA can be run over the
    axis.
    """
    whole = binned(left_in(analysis.summed.lines, options.from_hz, options.notch_hz))
    path, tested = None, np.empty(0)
    if with_path:
        path, innovation = _path(analysis.y, analysis.gaps, analysis.h, lsb, options)
        tested = innovation[len(innovation) // 3 :]
    return Curves(
        Spectrum(whole.lam / (2 * np.pi * analysis.h), whole.power[0], whole.counts),
        ORDERS,
        profile(analysis.summed.seen.evidence.candidates, ORDERS),
        path,
        _autocorrelation(tested),
        len(tested),
    )


def profile(f: CandidateModels, orders: Array) -> Array:
    """Return how much worse the model fits if its order is fixed at each of `orders`, (k,).

    This is the decrease of 2 log L, twice the logarithm of the likelihood. The first fit has the order next
    to the best one. Each further fit has the next higher or lower order, and starts from the parameters of
    the fit before.
    """
    best = f.order or f.null
    at = best.place(Order, Arfima)
    assert at is not None
    nll = np.empty(len(orders))
    first = int(np.searchsorted(orders, best.eta[at]))
    for way in (range(first, len(orders)), range(first - 1, -1, -1)):
        eta = list(best.eta)
        for i in way:
            eta[0], eta[at] = max(eta[0], little_white(f)), float(orders[i])
            eta, nll[i] = f.native.fit(list(best.codes), eta, held=at)
    return np.asarray(np.maximum(2 * (nll - min(best.nll, float(nll.min()))), 0.0))


def _path(y: Array, gaps: Gaps, h: float, lsb: float | None, options: IdentifyOptions) -> tuple[Path, Array]:
    """Run FLTEA over the data, and over random copies, which are white noise.

    A copy consists of samples that are drawn at random from the data. Data and copies are lanes that run in
    parallel; lane 0 is the data.

    Returns the estimates over time, and the innovations of the data.
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
        # In the shuffled copies, the same samples are missing as in the data.
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
    """Return bias and R for the samples and for each shuffled copy, from a start-up window of its own."""
    if not window.shape[1]:
        return np.array([bias]), np.array([R])
    biases, Rs = lane_baselines(window, config, lsb)
    # If the samples hardly ever change, the start-up window of a copy may hold a single value. R would then
    # be 0, so it is kept above a small fraction of the R of the data.
    Rs = np.maximum(Rs, 1e-6 * R) if config.R == "auto" else Rs
    return np.append(bias, biases), np.append(R, Rs)


def _quantiles(values: Array) -> Array:
    """Return three quantiles over the shuffled copies at each point, (points, 3).

    They are NaN at a point where no copy has a finite estimate.
    """
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
