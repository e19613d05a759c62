"""Estimate what a record of given length leaves uncertain about the noise that was found in it.

The likelihood is that of a spectrum (Whittle, *Ark. Mat.* 2, 1953). It is computed without the samples, as if
their spectrum were exactly that of the noise that was found.
"""

import functools
import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from fltea import _native
from fltea.noise.parts import (
    FILTERS,
    Arfima,
    Order,
    Part,
    White,
    free_of,
    part_of,
    spectrum,
    spectrum_of,
)
from fltea.records.arrays import Array, merged

STEP, STEPS = 0.1, 10
LEAST, MOST = 0.05, 1.05
"""Lowest and highest order that are tried in addition to the order that was found."""
UNLIKELY = 7.0
"""An order is left out if its log likelihood is lower than that of the best order by more than this."""
LOWEST = 10
"""The record holds this number of periods of the lowest fitted frequency."""
POINTS = 80
CONVERGED, ITERATIONS = 1e-3, 60
PRIOR = 1.0
"""Fisher information that is added for each free parameter, so that none is entirely unknown. With 1, each is
known to ± 1. Nearly all free parameters are logarithms, of which ± 1 is a factor of e.
"""


def mean_order(
    parts: Sequence[Part], order: Order | Arfima, lam: Array, h: float, samples: int
) -> tuple[float, Array]:
    """Return the mean variance of white noise, and the mean spectrum (at `lam`) of the fractional noise.

    Fractional noise is the part `order`. The means are posterior means, over the noises that are likely given
    the record. A record hardly shows how much power belongs to white noise, and how much to fractional noise
    whose spectrum is nearly white. The most likely fractional noise may take all of this power, or none.

    Callers make a linear filter of the samples from the means. No other linear filter has a smaller mean
    square error over the likely noises, and the filter states this error rightly. A filter for the most
    likely noise alone has a larger error, and states one that is too small.

    For each α that is tried, the fractional and the white noise are fitted to the spectrum that both have
    together, and weighted by their likelihood. The other parts are assumed to be known.

    Args:
        parts: the parts of the noise, including `order`.
        order: the part that is noise of an order α.
        lam: frequencies λ in rad per sample.
        h: sampling period [s].
        samples: length of the record.
    """
    R = sum(part.R for part in parts if isinstance(part, White))
    codes, best = [White(R).code, order.code], [*White(R).eta(h), *order.eta(h)]
    at, counts = _ordinates(samples)
    own = spectrum_of(codes, best, at, h)
    filters = [part for part in parts if isinstance(part, FILTERS)]
    share = own * spectrum([White(1.0), *filters], at, h) / spectrum(parts, at, h)
    fits = _fits(at, counts * share**2, own, h)

    def fit(start: Sequence[float], alpha: float) -> tuple[list[float], float]:
        eta = [start[0], alpha, *start[2:]]
        return fits.fit(codes, eta, held=1, converged=CONVERGED, steps=ITERATIONS)

    tried = [one for k in range(-STEPS, STEPS + 1) if k and LEAST < (one := best[1] + STEP * k) < MOST]
    found = dict.fromkeys(tried, (best, math.inf)) | {best[1]: fit(best, best[1])}
    for orders in (tried, tried[::-1]):
        eta = best
        for alpha in orders:
            found[alpha] = min(found[alpha], fit(eta, alpha), key=lambda one: one[1])
            eta = found[alpha][0]
    least = min(nll for _, nll in found.values())
    likely = [(eta, math.exp(least - nll)) for eta, nll in found.values() if nll < least + UNLIKELY]
    weights = np.array([weight for _, weight in likely])
    weights /= weights.sum()
    white = np.array([math.exp(eta[0]) for eta, _ in likely])
    spectra = [spectrum_of(codes, eta, lam, h) for eta, _ in likely]
    return float(weights @ white), np.asarray(weights @ (np.array(spectra) - white[:, None]))


def distance(parts: Sequence[Part], others: Sequence[Part], h: float, samples: int) -> float:
    """Return how much log likelihood is lost on average if `others` describes noise made of `parts`.

    The loss is relative to the likelihood of `parts` themselves. `samples`: length of the noise's record.
    """
    at, counts = _ordinates(samples)
    ratio = spectrum(parts, at, h) / spectrum(others, at, h)
    return float(counts @ (ratio - 1 - np.log(ratio)))


def nearby(parts: Sequence[Part], h: float, samples: int) -> Iterator[tuple[list[Part], list[Part]]]:
    """Yield pairs of noises whose free parameters are below and above those of `parts` by one σ.

    Each pair changes the free parameters in another direction. The errors in these directions are
    independent.
    """
    codes, eta = [part.code for part in parts], np.array([x for part in parts for x in part.eta(h)])
    at, counts = _ordinates(samples)
    total, rows = np.empty(len(at)), np.empty((len(eta), len(at)))
    _fits(at, counts, spectrum(parts, at, h), h).slopes(codes, eta.tolist(), total, rows)
    covariance = np.linalg.inv((rows * counts) @ rows.T + PRIOR * np.eye(len(eta)))
    for off in np.linalg.cholesky(covariance).T:
        yield _parts(codes, eta - off, h), _parts(codes, eta + off, h)


def _parts(codes: Sequence[int], eta: Array, h: float) -> list[Part]:
    rest = iter(eta.tolist())
    return [part_of(code, list(itertools.islice(rest, free_of(code))), h) for code in codes]


# the cached result is the same for all axes and devices with records of this length
@functools.lru_cache(maxsize=8)
def _ordinates(samples: int) -> tuple[Array, Array]:
    """Return frequencies λ, and for each the number of frequencies of a record's periodogram around it."""
    low = min(2 * math.pi * LOWEST / samples, 1.0)
    lam = merged(np.geomspace(low, math.pi, POINTS), np.linspace(low, math.pi, POINTS))
    return lam, np.gradient(lam) * samples / (2 * math.pi)


def _fits(lam: Array, counts: Array, power: Array, h: float) -> _native.WhittleFits:
    return _native.WhittleFits(lam, counts, power, 1 / (4 * np.sin(lam / 2) ** 2), np.zeros_like(lam), h)
