"""The forecast of the heading, judged by the second half of a recording."""

import numpy as np
import pytest
from fltea.identification.forecast import judged, now, said, tracked_system
from fltea.noise.parts import Walk, White

H = 0.02


def _walking(K: float, seed: int, n: int = 20000) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.normal(size=n) * 0.1 + np.cumsum(rng.normal(size=n)) * K * np.sqrt(H) + 3.0


def test_a_right_model_holds() -> None:
    y = _walking(0.02, 1)
    pieces = judged(tracked_system((White(0.01), Walk(0.02)), y[: len(y) // 2], H), y, len(y) // 2, H)
    assert not any(one.fails for one in pieces)
    assert min(one.pieces for one in pieces) >= 5
    assert "does not contradict" in said(pieces, "deg/s")


def test_a_model_that_drifts_too_little_fails_in_a_sentence() -> None:
    y = _walking(0.02, 1)
    pieces = judged(tracked_system((White(0.01), Walk(0.004)), y[: len(y) // 2], H), y, len(y) // 2, H)
    assert any(one.fails for one in pieces)
    assert said(pieces, "deg/s").startswith("It drifts faster than its model: ")


def test_bands_hold_the_truth_as_often_as_they_say() -> None:
    parts, inside, total = (White(0.01), Walk(0.02)), 0.0, 0
    for seed in range(10):
        y = _walking(0.02, seed)
        for one in judged(tracked_system(parts, y[:10000], H), y, 10000, H)[:4]:
            inside, total = inside + one.within * one.pieces, total + one.pieces
    assert inside / total == pytest.approx(0.95, abs=0.015)


def test_the_bias_now_is_the_walk_at_the_end() -> None:
    y = _walking(0.02, 3)
    found = now(tracked_system((White(0.01), Walk(0.02)), y, H), y, H)
    assert found.bias == pytest.approx(y[-30:].mean(), abs=5 * found.bias_std)
