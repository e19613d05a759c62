"""Tests the ends of the intervals of α and s2 in records with almost no white noise. Also tests parts of
noise models whose free parameters are written in another form than usual.
"""

import math

import numpy as np
import pytest
from fltea.noise import parts as p
from fltea.noise.parts import CODES
from fltea.spectrum.candidate_models import CandidateModels, native
from fltea.spectrum.intervals import AT_BOUND, BY_F, BY_NOISE, BY_PARAMETER, BY_STEP, CRITICAL, interval_end

from tests.rig.identify_support import H
from tests.rig.model_support import bins

ORDER, ARFIMA = CODES.index(p.Order), CODES.index(p.Arfima)
ALPHA, LOGIT, LOG_S2 = 0.5, -2.0, 0.3
G = -(2**ALPHA) / (1 + math.exp(-LOGIT))
LEVEL = LOG_S2 - 2 * math.log(-math.expm1(-math.exp(-1.0)))
OTHERS = {
    BY_F: (ORDER, [ALPHA, LOGIT, LOG_S2], [ALPHA + G, math.log(-G), LOG_S2]),
    BY_PARAMETER: (ORDER, [ALPHA, LOGIT, LOG_S2], [ALPHA, math.log(-G / H**ALPHA), LOG_S2]),
    BY_NOISE: (ORDER, [ALPHA, LOGIT, LOG_S2], [ALPHA, LOGIT, LOG_S2 - 2 * ALPHA * math.log(H)]),
    BY_STEP: (ARFIMA, [0.3, -1.0, LEVEL], [0.3, -1.0, LOG_S2]),
}
"""Unusual forms of the free parameters. For each form: the kind of the part of the noise model, the part's
usual free parameters, and the same parameters in this form.
"""


@pytest.mark.parametrize("code", list(OTHERS))
def test_other_free_parameters_give_the_same_spectrum_with_their_own_slopes(code: int) -> None:
    data = bins((p.White(1.0),), 20_000, H, None)
    fits, size = native(data, H, 20_000), len(data.lam)

    def spectrum(number: int, eta: list[float]) -> tuple[np.ndarray, np.ndarray]:
        total, rows = np.empty(size), np.empty((4, size))
        fits.slopes([0, number], [0.0, *eta], total, rows)
        return total, rows

    own, eta, other = OTHERS[code]
    total, rows = spectrum(code, other)
    np.testing.assert_allclose(total, spectrum(own, eta)[0], rtol=1e-9)
    for k in range(3):
        step = np.eye(3)[k] * 1e-5
        higher, lower = (spectrum(code, (other + sign * step).tolist())[0] for sign in (1, -1))
        np.testing.assert_allclose(rows[k + 1], (np.log(higher) - np.log(lower)) / 2e-5, rtol=1e-4, atol=1e-6)


def test_an_end_is_found_though_the_best_fit_has_no_white_noise() -> None:
    """In these records, the best fit of noise of fractional order has no white noise.

    To find an end of the interval of s2 (the variance that drives the state), s2 is held at other values and
    the other parameters are fitted. These fits may have white noise. Then their 2 log L is higher than that
    of fits without white noise, so the search has to find them.
    """
    compared = 0
    for seed in range(12):
        truth = (p.White(0.05), p.Order(0.5, -2.0, 1 / H))
        f = CandidateModels(bins(truth, 40_000, H, seed), H, 40_000)
        best = f.order
        if best is None or best.codes != (0, ORDER) or best.eta[0] > best.eta[3] - 7:
            continue
        none = f.native.fit(list(best.codes), [best.eta[3] - 27, *best.eta[1:]], held=0)
        best = best._replace(eta=tuple(none[0]), nll=none[1])
        low = interval_end(f, best, 3, -1, best.eta[3] - 7, 0.1, AT_BOUND["s2"])
        assert low is not None
        start = [best.eta[3] - 3, *best.eta[1:3], low]
        _, nll = f.native.fit(list(best.codes), start, held=3)
        assert CRITICAL - 0.1 < 2 * (nll - best.nll) < AT_BOUND["s2"] + 0.1
        compared += 1
    assert compared >= 3
