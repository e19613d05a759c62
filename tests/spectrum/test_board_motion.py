"""The board's bias predicts the mean of the next second's samples, even after motion and steps."""

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.rig.identify_support import H, long_recursion
from tests.rig.spectrum_probe import BoardSpectrum, track_sensor

WHITE, FRACTIONAL, RELAXATION = 1, 2, 3
AHEAD = 100
"""The bias is the predicted mean of this many future samples, those of the next second."""
CHUNK = 32
LSB = 16.4
"""Scale of the sensor: counts per deg/s."""
SIGMA = 1.6
R = SIGMA**2 + 1 / 12
OFFSETS = np.array([37.3, -12.2, 3.9])
SLOW = (RELAXATION, 0.005, 0.5, R)
NOTHING = (WHITE, 0.0, 0.0, 0.0, R)
BEGIN = 200 * CHUNK
"""Number of the sample at which the motion or step begins. A chunk (block of the board's spectrum) begins
there, too.
"""


def at_rest(n: int, seed: int) -> NDArray[np.float64]:
    return np.random.default_rng(seed).normal(OFFSETS, SIGMA, (n, 3))


def counts(world: NDArray[np.float64]) -> NDArray[np.int16]:
    return np.floor(world + 0.5).astype(np.int16)


def tracked(
    world: NDArray[np.float64], model: tuple[float, ...], ahead: int = AHEAD
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Let the board track the bias of each axis of `world`, which has unrounded counts, (n, 3). From sample
    2,000 on, the board gets the noise model every 2.5 s, and its offset becomes the mean until then.
    """
    axes = [BoardSpectrum(ahead) for _ in world.T]
    found, moving = [], []
    for at in range(0, len(world), 250):
        if at >= 2000:
            for axis in axes:
                axis.track_by(int(model[0]), *model[1:])
        figures, moves = track_sensor(axes, counts(world[at : at + 250]))
        found.append(figures)
        moving.append(moves)
    return np.vstack(found), np.concatenate(moving)


def test_the_bias_is_the_mean_over_the_second_to_come() -> None:
    fall, variance = 0.02, 30.0
    a = 1 - fall
    weight = float(np.mean(a ** np.arange(1, AHEAD + 1)))
    answers = np.cumsum(a ** np.arange(AHEAD))
    added = variance * (1 - a * a) * float(np.sum(answers**2)) / AHEAD**2
    rows = {}
    for ahead in (0, AHEAD):
        board = BoardSpectrum(ahead)
        # After a million samples of 0, the board's offset (the mean) is 0.
        board.track(np.zeros(1_000_000, dtype=np.int16))
        board.track_by(RELAXATION, fall, variance, R)
        rows[ahead] = board.track(np.full(40, 3, dtype=np.int16))[-1]
    bias, bias_std, state, state_std = rows[0]
    assert bias == pytest.approx(state, abs=1e-3)
    assert bias_std == pytest.approx(state_std, rel=0.01)
    assert rows[AHEAD][0] == pytest.approx(weight * state, rel=1e-4)
    assert rows[AHEAD][1] == pytest.approx(np.sqrt(weight**2 * bias_std**2 + added), rel=0.01)
    assert rows[AHEAD][2:].tolist() == [state, state_std]


@pytest.mark.parametrize(("alpha", "f", "share"), [(0.7, -2.0, 0.3), (0.5, -1.0, 1.0)])
def test_the_deviation_of_an_orders_bias_is_that_about_the_mean_to_come(
    alpha: float, f: float, share: float
) -> None:
    n, g, s2 = 20_000, f * H**alpha, share * R
    states = np.stack([long_recursion(alpha, g, n, seed) * np.sqrt(s2) for seed in range(3)], axis=1)
    found, moving = tracked(at_rest(n, 4) + states, (FRACTIONAL, alpha, g, s2, R))
    assert not moving.any()
    sums = np.vstack([np.zeros(3), np.cumsum(states, axis=0)])
    truth = (sums[1 + AHEAD :] - sums[1:-AHEAD]) / AHEAD + OFFSETS
    accepted = slice(6000, n - AHEAD)
    error = (found[: n - AHEAD, :, 0] - truth[: n - AHEAD])[accepted]
    within = np.abs(error) < 2 * found[accepted, :, 1]
    assert 0.93 < within.mean() < 0.97


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("model", [NOTHING, SLOW])
def test_motion_of_one_axis_lets_all_predict_and_the_bias_of_before_counts_again(
    model: tuple[float, ...], axis: int
) -> None:
    n, end = 12_000, BEGIN + 3000
    world = at_rest(n, 5)
    world[BEGIN:end] += 0.05 * LSB
    world[BEGIN:end, axis] += 10 * LSB
    found, moving = tracked(world, model)
    bias, std = found[:, :, 0], found[:, :, 1]
    assert np.flatnonzero(np.diff(moving)).tolist() == [
        BEGIN + CHUNK - 2,
        # The board reports motion until the last chunk (block of samples) that contains a part of the turn,
        # and for two more chunks.
        -(-end // CHUNK) * CHUNK + 2 * CHUNK - 2,
    ]
    # During the turn, the bias contains neither the turn nor its leakage into the other axes. It differs from
    # the true value only by the error of the mean of the samples before.
    during = slice(end - 1000, end)
    assert np.abs(bias[during] - OFFSETS).max() < 0.1
    # The bias is right again within a second after the motion has stopped.
    assert np.all(np.abs(bias[end + 100] - OFFSETS) < 3 * std[end + 100] + 0.05)
    if model is SLOW:
        before, last = std[BEGIN - 1, 0], std[end - 1, 0]
        assert last > 1.4 * before
        assert np.all(np.diff(std[BEGIN + CHUNK : BEGIN + 300, 0]) >= 0)
        assert std[end + 300, 0] == pytest.approx(before, rel=0.02)


def test_the_chunk_in_which_motion_is_found_and_the_one_before_are_undone() -> None:
    a = 0.995
    world = at_rest(BEGIN + CHUNK, 6)[:, :1]
    # The turn begins too slowly for the board to detect it in its first chunk of samples.
    world[BEGIN - CHUNK : BEGIN] += SIGMA
    world[BEGIN + 1 :] += 3 * LSB
    axis, other = BoardSpectrum(), BoardSpectrum()
    for board, until in ((axis, BEGIN + CHUNK), (other, BEGIN - CHUNK)):
        board.track(counts(world[:2000, 0]))
        board.track_by(*SLOW)
        last = board.track(counts(world[2000:until, 0]))[-1]
        board.track_by(*SLOW)
        if board is axis:
            moved = last
    # When the board detects the turn, it takes back this chunk of samples and the one before, as if they had
    # been lost. So the state has decayed by `a` in each of these samples.
    calm = last[2] * a ** (2 * CHUNK)
    assert moved[2] == pytest.approx(calm, abs=0.05)
    assert abs(moved[0] - OFFSETS[0]) < 0.5


def test_a_turn_is_motion_while_it_lasts_and_a_smaller_step_is_the_bias_after_ten_seconds() -> None:
    for size_dps, is_bias in ((3.0, False), (1.0, True)):
        world = at_rest(BEGIN + 4000, 7)
        world[BEGIN:, 0] += size_dps * LSB
        found, moving = tracked(world, NOTHING)
        assert moving[BEGIN + 900]
        assert moving[-1] != is_bias
        wanted = OFFSETS + np.array([size_dps * LSB * is_bias, 0.0, 0.0])
        assert np.all(np.abs(found[-1, :, 0] - wanted) < 4 * found[-1, :, 1])
        # The bias of an axis without motion is as certain as before the motion.
        assert found[-1, 1, 1] < 1.2 * SIGMA / np.sqrt(BEGIN)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("sigmas", "most_s"), [(0.3, 15.0), (1.0, 5.0)])
def test_a_step_of_the_offset_of_white_noise_is_found(sigmas: float, most_s: float, sign: int) -> None:
    world, size = at_rest(36_000, 8), sign * sigmas * SIGMA
    world[32_000:, 1] += size
    found, moving = tracked(world, NOTHING)
    assert not moving.any()
    error = found[32_000:, 1, 0] - OFFSETS[1] - size
    near = np.abs(error) < 0.2 * abs(size)
    assert np.argmax(near) < most_s * 100
    assert near[int(most_s * 100) :].mean() > 0.9
    assert np.all(np.abs(error[3500:]) < 4 * found[35_500:, 1, 1])
    assert found[-1, 1, 1] > 2 * found[-1, 0, 1]


def test_noise_that_is_at_rest_is_no_motion_and_has_no_steps() -> None:
    n = 60_000
    time_s = np.arange(n) * H
    line = 1.5 * SIGMA * np.sin(2 * np.pi * 3 * time_s)[:, None]
    for world in (at_rest(n, 9), at_rest(n, 10) + line):
        found, moving = tracked(world, NOTHING)
        assert not moving.any()
        assert np.abs(found[-1, :, 0] - OFFSETS).max() < 0.05
        assert found[-1, :, 1] == pytest.approx(np.sqrt(R / n), rel=0.03)


def test_before_there_is_a_filter_motion_is_not_in_the_offset() -> None:
    world = at_rest(2000, 11)
    world[800:1400, 2] += 20 * LSB
    axes = [BoardSpectrum(AHEAD) for _ in range(3)]
    _, moving = track_sensor(axes, counts(world))
    assert moving[900:1400].all()
    assert not moving[-1]
    for axis in axes:
        axis.track_by(*NOTHING)
    found, _ = track_sensor(axes, counts(at_rest(1, 12)))
    assert np.all(np.abs(found[0, :, 0] - OFFSETS) < 4 * found[0, :, 1] + 0.02)
