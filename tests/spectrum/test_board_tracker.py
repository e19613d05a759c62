"""The board's tracker with the board's own fit, compared with textbook filters, with the host's tracker and
with the true state.
"""

import numpy as np
import pytest
from fltea.estimator.tracker import Tracker
from fltea.noise.linear_system import System
from fltea.noise.parts import Order, Relaxation, White
from fltea.noise.system import system
from fltea.records.arrays import Array
from numpy.typing import NDArray

from tests.rig.identify_support import H, ar, long_recursion
from tests.rig.spectrum_probe import BoardSpectrum

WHITE, FRACTIONAL, RELAXATION = 1, 2, 3
OFFSET = 37.3
R = 5.3
"""Variance of the white noise in squared counts. Rounding to counts adds a twelfth."""
N = 20_000
SETTLED = slice(6000, N)


def steady(a: Array, q: Array, r: float) -> tuple[Array, float]:
    """Return the steady gains of a Kalman filter, and the variance of its innovations. Its states are
    relaxations with the coefficients `a`, which are driven by white noise of the variances `q`. `r`: variance
    of the measurement's white noise.

    The covariance of the states is computed again and again until it no longer changes.
    """
    P = np.diag(q / (1 - a**2))
    for _ in range(20_000):
        P = np.outer(a, a) * (P - np.outer(P.sum(1), P.sum(1)) / (P.sum() + r)) + np.diag(q)
    return P.sum(1) / (P.sum() + r), P.sum() + r


def counts_of(state: Array, seed: int) -> NDArray[np.int16]:
    white = np.random.default_rng(seed + 1000).standard_normal(len(state)) * np.sqrt(R)
    return np.floor(state + white + OFFSET + 0.5).astype(np.int16)


def rms(error: Array) -> float:
    return float(np.sqrt(np.mean(np.square(error))))


@pytest.mark.parametrize("fall", [0.003, 0.05, 0.5, 1.0, 1.6])
def test_the_gain_of_a_relaxation_is_that_of_the_riccati_equation(fall: float) -> None:
    a, variance = 1 - fall, 40.0
    (K,), S = steady(np.array([a]), np.array([variance * (1 - a * a)]), R)
    board = BoardSpectrum()
    # After a million samples of 0, the board's offset (the mean) is 0.
    board.track(np.zeros(1_000_000, dtype=np.int16))
    board.track_by(RELAXATION, fall, variance, R)
    pulse = np.zeros(40, dtype=np.int16)
    pulse[1] = 7
    state = board.track(pulse)[:, 2]
    assert state[1] == pytest.approx(7 * K, rel=1e-5)
    assert state[2] / state[1] == pytest.approx(a * (1 - K), rel=1e-4, abs=1e-6)
    assert board.track(pulse)[-1, 3] == pytest.approx(np.sqrt(R * (1 - R / S)), rel=0.02)


def test_of_lost_samples_it_predicts() -> None:
    board = BoardSpectrum()
    board.track(np.zeros(1000, dtype=np.int16))
    board.track_by(RELAXATION, 0.02, 400.0, R)
    before = board.track(np.full(50, 30, dtype=np.int16))[-1, 2]
    board.lose(99)
    # A sample comes 100 periods after the last one, and the state has faded by the factor 0.98^100. This
    # sample equals its prediction, so it does not change the state.
    wanted = before * 0.98**100
    after = board.track(np.array([round(wanted)], dtype=np.int16))[-1, 2]
    assert after == pytest.approx(wanted, abs=0.3)
    assert before > 25


def test_white_noise_has_no_state_and_its_bias_is_the_mean() -> None:
    counts = counts_of(np.zeros(N), 5)
    board = BoardSpectrum()
    board.track(counts)
    board.track_by(WHITE, 0.0, 0.0, 0.0, R)
    bias, bias_std, state, state_std = board.track(counts[:1])[-1]
    assert (state, state_std) == (0.0, 0.0)
    assert bias == pytest.approx(float(counts.mean()), abs=1e-3)
    assert bias_std == pytest.approx(np.sqrt(R / N), rel=1e-3)


def test_a_knock_moves_neither_bias_nor_state_far() -> None:
    counts = counts_of(np.zeros(N), 6)
    board = BoardSpectrum()
    board.track(counts)
    board.track_by(RELAXATION, 0.01, 4.0, R)
    calm = board.track(counts)[-1]
    knocked = board.track(np.full(5, 20_000, dtype=np.int16))[-1]
    board.track_by(RELAXATION, 0.01, 4.0, R)
    after = board.track(counts[:2000])[-1]
    assert abs(knocked[2] - calm[2]) < 5 * 6 * 0.2 * np.sqrt(R)
    assert after[0] == pytest.approx(OFFSET, abs=4 * after[1])


def tracked_with(
    model: System, counts: NDArray[np.int16], verdict: int, *given: float
) -> tuple[Array, Array]:
    """Return the biases that the board and the host track, as two arrays of shape (n, 2): the bias and its σ
    after each sample.

    Board and host use the true noise model after the first tenth of the samples.
    """
    begin = N // 10
    board, host = BoardSpectrum(), Tracker([None])
    board.track(counts[:begin])
    host.run(counts[:begin, None].astype(float))
    host.set(0, model)
    parts = []
    for at in range(begin, N, 300):
        # The board's filter gets its noise model anew every three seconds, as on a real board.
        board.track_by(verdict, *given)
        parts.append(board.track(counts[at : at + 300])[:, :2])
    found = host.run(counts[begin:, None].astype(float))
    ours = np.vstack([np.full((begin, 2), np.nan), *parts])
    theirs = np.vstack(
        [np.full((begin, 2), np.nan), np.column_stack([found.bias[:, 0], found.bias_std[:, 0]])]
    )
    return ours, theirs


@pytest.mark.parametrize(
    ("alpha", "f", "share"), [(0.7, -2.0, 0.3), (0.5, -2.0, 1.0), (0.8, -1.0, 3.0), (0.6, -12.0, 1.0)]
)
def test_an_order_is_tracked_as_well_as_by_the_host(alpha: float, f: float, share: float) -> None:
    g, s2 = f * H**alpha, share * R
    board_errors, host_errors, within = [], [], []
    for seed in range(3):
        state = long_recursion(alpha, g, N, seed) * np.sqrt(s2)
        parts = [White(R + 1 / 12), Order(alpha, f, s2 / H ** (2 * alpha))]
        ours, theirs = tracked_with(
            system(parts, H, N), counts_of(state, seed), FRACTIONAL, alpha, g, s2, R + 1 / 12
        )
        error = (ours[:, 0] - OFFSET - state)[SETTLED]
        board_errors.append(error)
        host_errors.append((theirs[:, 0] - OFFSET - state)[SETTLED])
        within.append(np.abs(error) < 2 * ours[SETTLED, 1])
    board, host = rms(np.concatenate(board_errors)), rms(np.concatenate(host_errors))
    assert board < 1.02 * host
    assert board < rms(np.array([np.sqrt(R)]))
    assert 0.93 < np.concatenate(within).mean() < 0.97


def test_a_relaxation_is_tracked_by_the_boards_own_fits_as_by_the_host_that_knows_it() -> None:
    tau_s, sigma = 2.0, 2 * np.sqrt(R)
    a = np.exp(-H / tau_s)
    state = ar((float(a),), N, 1, 3)[0] * sigma * np.sqrt(1 - a * a)
    counts = counts_of(state, 3)
    host = Tracker([None])
    host.run(counts[:2000, None].astype(float))
    host.set(0, system([White(R + 1 / 12), Relaxation(float(sigma), tau_s)], H, N))
    best = host.run(counts[2000:, None].astype(float)).bias[4000:, 0]
    board, tracked = BoardSpectrum(), []
    for at in range(0, N, 1000):
        part = counts[at : at + 1000]
        tracked.append(board.track(part))
        board.add(part)
        board.fit()
        board.retrack()
    found = np.vstack(tracked)[SETTLED]
    truth = state[SETTLED] + OFFSET
    assert rms(found[:, 0] - truth) < 1.03 * rms(best - truth)
    assert 0.93 < np.mean(np.abs(found[:, 0] - truth) < 2 * found[:, 1]) < 0.97
    assert np.mean(np.abs(found[:, 2] - state[SETTLED]) < 2 * found[:, 3]) > 0.9
