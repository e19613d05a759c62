"""Noise models that a record cannot distinguish."""

import math

import numpy as np
import pytest
from fltea.noise import parts as p
from fltea.noise.left_open import distance, mean_order, nearby

H, R = 0.01, 0.02
NEARLY_WHITE = p.Order(0.5, -2.0, R / H)
LAM = np.geomspace(0.01, math.pi, 50)


@pytest.mark.parametrize("found", [p.Order(0.916, -13.4, 21.4), p.Order(0.354, -0.97, 1.03)], ids=str)
def test_white_noise_beside_an_order_that_is_nearly_white_is_open(found: p.Order) -> None:
    """A minute of samples was once fitted by two different models, each of white noise and a fractional
    noise.

    The samples were of this kind, too: `NEARLY_WHITE` is their fractional noise, and R the variance of their
    white noise. One model has too much white noise, the other too little.
    """
    white = p.White(0.0326 if found.alpha > 0.5 else 0.0026)
    mean, power = mean_order([white, found], found, LAM, H, 6000)
    assert abs(mean - R) < 0.7 * abs(white.R - R)
    total = p.spectrum([white, found], LAM, H)
    np.testing.assert_allclose(mean + power, total, rtol=0.15)


def test_in_a_long_record_hardly_anything_is_open() -> None:
    parts = [p.White(R), p.Relaxation(0.3, 5.0), NEARLY_WHITE]
    mean, power = mean_order(parts, NEARLY_WHITE, LAM, H, 10**8)
    assert mean == pytest.approx(R, rel=0.01)
    np.testing.assert_allclose(power, p.spectrum([NEARLY_WHITE], LAM, H), rtol=0.01)


def test_behind_a_filter_it_is_the_same_noise() -> None:
    filtered = mean_order([p.White(R), NEARLY_WHITE, p.LowPass(20.0, 2.0)], NEARLY_WHITE, LAM, H, 6000)
    bare = mean_order([p.White(R), NEARLY_WHITE], NEARLY_WHITE, LAM, H, 6000)
    assert filtered[0] == pytest.approx(bare[0], rel=0.02)


def test_the_level_of_white_noise_is_known_by_the_root_of_two_over_the_samples() -> None:
    ((less, more),) = nearby([p.White(R)], H, 10_000)
    assert isinstance(less[0], p.White)
    assert isinstance(more[0], p.White)
    assert math.log(more[0].R / less[0].R) / 2 == pytest.approx(math.sqrt(2 / 10_000), rel=0.02)


def test_there_are_as_many_directions_as_free_parameters() -> None:
    parts = [p.White(R), p.Relaxation(0.3, 5.0), NEARLY_WHITE, p.Mean(3)]
    both = list(nearby(parts, H, 10_000))
    assert len(both) == 6
    for less, more in both:
        assert [type(one) for one in less] == [type(one) for one in more] == [type(one) for one in parts]
        assert less != more


def test_a_noise_is_no_distance_from_itself_and_the_farther_from_another_the_longer_the_record() -> None:
    one, other = [p.White(R)], [p.White(1.1 * R)]
    assert distance(one, one, H, 1000) == 0
    assert distance(one, other, H, 10_000) == pytest.approx(5000 * (1 / 1.1 - 1 + math.log(1.1)), rel=0.02)
