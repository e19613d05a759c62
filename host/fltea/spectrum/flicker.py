"""White noise, 1/f noise and a random walk fitted to the low frequencies of a spectrum.

These are the three terms of IEEE 952's noise model that users read from a curve of Allan deviations. Their
spectra are linear in their amplitudes, so that a fit costs less than a millisecond. The fit uses every
frequency at which the 1/f noise stands out of the white noise. So the fit determines the amplitude B long
before the Allan deviation shows a flat stretch with small errors.
"""

import math
from typing import NamedTuple

import numpy as np

from fltea.records.arrays import Array
from fltea.records.fit import Interval
from fltea.spectrum.candidate_models import CandidateModels, FittedModel, walk_column
from fltea.spectrum.intervals import CRITICAL

SLOW = 1 / 20
"""The highest fitted frequency, divided by the sample rate. A sensor's own filter nearly always acts only
above this frequency.
"""
FEWEST = 30.0
"""Fewest ordinates for a fit."""
ROUNDS = 60
LEAST_GAIN = 1e-5
"""The fit ends when an iteration raises log L (the log likelihood) by less than this."""
DAMPING = 1e-3
LEAST = 1e-12
"""Smallest squared amplitude that the fit can give a term, divided by the one from which the fit starts."""
NEAR = 0.05
"""The search for an end of an interval stops when 2 log L differs by at most this from the value that it has
to have at the end.
"""
SEARCHES = 12
WIDEST = 100.0
"""Each end of the interval of B² differs from B² by at most this factor."""


class Flicker(NamedTuple):
    """The three terms fitted to one spectrum.

    The gain of a term says by how much 2 log L is higher with this term than in the fit without it.
    """

    B: Interval
    """The amplitude B of the 1/f noise, in the unit of the samples. Value and ends are None if the gain of
    the 1/f noise is too small.

    If the fit does not need the random walk, B comes from a fit without it. No power is negative, so by
    chance a random walk in the fit could only make B smaller, never larger. But a weak random walk may be
    there. So the lower end of the interval is still that of the fit with all three terms.
    """
    gain: float
    """The gain of the 1/f noise: how much higher 2 log L is with it."""
    gain_of_walk: float
    """The gain of the random walk: how much higher 2 log L is with it."""
    behind: float
    """2 log L of the model on which the verdict is based, minus 2 log L of this fit. Both are computed at the
    same frequencies.
    """
    ordinates: float


class _Data(NamedTuple):
    """The bins of a spectrum.

    `power`, `counts`: power and number of ordinates of each bin, (k,). `columns`: spectra of white noise, 1/f
    noise and a random walk of amplitude 1, at each bin, (k, 3).
    """

    power: Array
    counts: Array
    columns: Array

    def nll(self, log_amplitudes: Array, fixed: Array | float = 0.0) -> float:
        total = self.columns[:, : len(log_amplitudes)] @ np.exp(log_amplitudes) + fixed
        return float(self.counts @ (np.log(total) + self.power / total))

    def only(self, terms: list[int]) -> "_Data":
        return self._replace(columns=self.columns[:, terms])


def flicker(f: CandidateModels, stands: FittedModel) -> Flicker | None:
    """Return the fit of white noise, 1/f noise and a random walk to the low frequencies of a spectrum.

    `f`: the candidate models, with the spectrum. `stands`: the model on which the verdict is based. The
    result is None if there are too few ordinates.
    """
    lam = np.asarray(f.data.lam, dtype=np.float64)
    keep = lam < 2 * math.pi * SLOW
    lam = lam[keep]
    counts = np.asarray(f.data.counts, dtype=np.float64)[keep]
    power = np.asarray(f.data.power[0], dtype=np.float64)[keep]
    if counts.sum() < FEWEST or not (power > 0).any():
        return None
    # The spectrum of sampled 1/f noise, ARFIMA(0, 1/2, 0), at λ [rad a sample] is B² / (2 sin(λ/2)).
    columns = np.column_stack([np.ones(len(lam)), 0.5 / np.sin(lam / 2), walk_column(lam, f.samples)])
    data = _Data(power, counts, columns)
    start = np.log(float(counts @ power) / 3 / (counts @ columns))
    best, nll = _fit(data, start)
    no_flicker, no_walk = (_fit(data.only(rest), start[rest]) for rest in ([0, 2], [0, 1]))
    model = stands.spectrum(np.ascontiguousarray(lam), f.h)
    stood = float(counts @ (np.log(model) + power / model))
    gain, of_walk = (max(2 * (one[1] - nll), 0.0) for one in (no_flicker, no_walk))
    B = Interval()
    if gain > CRITICAL:
        low, high = (_end(data, best, nll, side) for side in (-1, 1))
        B = Interval(math.exp(best[1] / 2), low, high)
        if of_walk < CRITICAL:
            alone = _end(data.only([0, 1]), *no_walk, 1)
            B = Interval(math.exp(no_walk[0][1] / 2), low, max(high, alone))
    return Flicker(B, gain, of_walk, 2 * (nll - stood), float(counts.sum()))


def _fit(data: _Data, start: Array, fixed: Array | float = 0.0) -> tuple[Array, float]:
    """Fit the terms by maximum likelihood. Return the logarithms of their squared amplitudes, and -log L.

    The method is Fisher scoring: Newton's, with the Fisher information as the curvature. It is damped.
    `fixed`: a power in each bin that is added to the power of the terms, and is not fitted itself.
    """
    x, least = start.copy(), start + math.log(LEAST)
    nll, damping = data.nll(x, fixed), DAMPING
    for _ in range(ROUNDS):
        shares = data.columns * np.exp(x)
        total = shares.sum(axis=1) + fixed
        shares /= total[:, None]
        slope = shares.T @ (data.counts * (data.power / total - 1))
        information = (shares * data.counts[:, None]).T @ shares
        information[np.diag_indices(len(x))] *= 1 + damping
        information[np.diag_indices(len(x))] += 1e-9 * data.counts.sum()
        new = np.maximum(x + np.clip(np.linalg.solve(information, slope), -3, 3), least)
        found = data.nll(new, fixed)
        if not found < nll:
            damping *= 10
            if damping > 1e6:
                break
            continue
        gained, x, nll, damping = nll - found, new, found, max(damping / 10, DAMPING)
        if gained < LEAST_GAIN:
            break
    return x, nll


def _end(data: _Data, best: Array, nll: float, side: int) -> float:
    """Return an end of the 95 % interval of B by its profile likelihood.

    For each value of B, all other terms in `data` are fitted. `best`, `nll`: result of the fit of all terms,
    of which the 1/f noise is the second one: the logarithms of their squared amplitudes, and -log L. `side`:
    -1 for the lower end, 1 for the upper one.
    """
    terms = [term for term in range(len(best)) if term != 1]
    others, free = data.only(terms), best[terms]
    near, far = 0.0, math.log(WIDEST)
    step, start = 0.3, free
    for _ in range(SEARCHES):
        fixed = data.columns[:, 1] * math.exp(best[1] + side * step)
        start, found = _fit(others, np.maximum(start, free - 10), fixed)
        deviance = 2 * (found - nll)
        if abs(deviance - CRITICAL) < NEAR:
            break
        near, far = (step, far) if deviance < CRITICAL else (near, step)
        # The deviance is how far 2 log L is below its maximum. It grows about as the square of the distance
        # of the 1/f noise's amplitude from the best one (both as logarithms).
        guess = step * math.sqrt(CRITICAL / max(deviance, 1e-3))
        step = guess if near < guess < far else (near + far) / 2
    return math.exp((best[1] + side * step) / 2)
