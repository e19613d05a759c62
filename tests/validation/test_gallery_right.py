"""Tests the gallery's rules: which models a record can distinguish, and which verdicts on it are therefore
right.
"""

from typing import get_args

import numpy as np
import pytest
from fltea.records.fit import VerdictKind

from tools.validation.gallery import contrast
from tools.validation.gallery.contrast import Bins, bins_of, shortfall
from tools.validation.gallery.noises import NOISES
from tools.validation.gallery.right import Right, right_verdicts

# the tests in this file check a reference of other tests, and no part of the program
pytestmark = pytest.mark.slow


def bins(name: str, rate_hz: float = 100.0, seconds: float = 600.0) -> Bins:
    return bins_of(lambda lam: NOISES[name].spectrum(lam, rate_hz), round(rate_hz * seconds))


def right(name: str, rate_hz: float = 100.0, seconds: float = 600.0) -> Right:
    return right_verdicts(NOISES[name], rate_hz, round(rate_hz * seconds))


def test_shortfall_is_the_mean_of_the_likelihood_ratio() -> None:
    """A model's 2 log L (L: likelihood) is below that of the true spectrum. The mean difference over many
    records is the model's shortfall.

    The periodograms of the records are random numbers: exponentially distributed, with the true spectrum as
    their mean.
    """
    lam = np.pi * (np.arange(400) + 0.5) / 400
    truth, model = 1 + np.cos(lam) ** 2, np.ones((1, 400))
    power = truth * np.random.default_rng(1).exponential(size=(4_000, 400))
    size = power.mean(axis=1)  # the factor with which the model, a constant, fits best
    ratio = 2 * (400 * np.log(size) + 400 - (np.log(truth) + power / truth).sum(axis=1))
    expected = float(shortfall(Bins(lam, np.ones(400), truth), model)[0])
    # The model's factor is fitted to each record. On average, this increases the model's 2 log L by one.
    assert ratio.mean() == pytest.approx(expected - 1, abs=4 * ratio.std() / np.sqrt(4_000))
    assert ratio.std() == pytest.approx(2 * np.sqrt(expected), rel=0.3)


@pytest.mark.parametrize(
    ("family", "name"),
    [
        (contrast.white, "white"),
        (contrast.order, "state 0.8, -1, 3"),
        (contrast.order, "ARFIMA d .4"),
        (contrast.one_relaxation, "1 relaxation"),
        (contrast.walk, "random walk"),
        (contrast.low_pass, "1 pole, 5 Hz"),
        (contrast.rising, "differenced"),
        (contrast.order_and_rise, "state 0.35, -4, 3"),
        (contrast.without_order, "3 relaxations"),
    ],
)
def test_a_family_has_its_own_members(family: object, name: str) -> None:
    assert -1e-6 < family(bins(name)) < 3


@pytest.mark.long
@pytest.mark.parametrize("name", list(NOISES))
def test_every_record_has_a_right_verdict(name: str) -> None:
    found = right(name, 5.0, 30.0)
    kinds = set(get_args(VerdictKind))
    assert found.right
    assert found.right <= kinds
    assert set(found.accepted) <= kinds - found.right
    assert all(found.accepted.values())
    if not NOISES[name].has_order:
        assert "fractional" not in found.right | set(found.accepted)
    assert found.outcome(min(found.right)) == "right"
    assert all(found.outcome(kind) == "cannot be told" for kind in found.accepted)


@pytest.mark.parametrize(
    ("name", "rate_hz", "seconds", "expected"),
    [
        ("white", 100, 600, {"white"}),
        ("1 relaxation", 100, 10_800, {"relaxations"}),
        ("slow relaxation", 100, 30, {"drift", "relaxations"}),
        ("fast relaxation", 1_000, 10_800, None),
        ("3 relaxations", 100, 600, {"relaxations", "fractional or relaxations"}),
        ("2 a decade", 100, 600, {"relaxations", "fractional or relaxations"}),
        ("1/f, 0.01 Hz", 100, 30, {"white", "fractional"}),
        ("ARFIMA d -.3", 100, 600, {"anti-persistent"}),
        ("random walk", 100, 600, {"drift", "fractional or relaxations"}),
        ("random walk", 100, 10_800, {"drift"}),
        ("ramp", 5, 30, {"drift"}),
        ("state 0.35, -4, 3", 100, 10_800, {"fractional", "fractional or relaxations"}),
        ("3 relaxations, angle", 100, 10_800, {"relaxations"}),
        ("walk, angle", 100, 600, {"drift"}),
        ("notch", 100, 600, {"notch"}),
        ("AC, 0.1 Hz", 100, 600, {"high-pass"}),
        ("AC, 0.1 Hz", 100, 30, {"white", "high-pass"}),
        ("AC, 1 Hz, 2 poles", 100, 600, {"high-pass"}),
        ("AC, 1 Hz, 2 poles", 5, 600, {"high-pass", "anti-persistent"}),
        ("auto-zero", 100, 10_800, {"high-pass"}),
        ("AC, relaxation", 100, 10_800, {"relaxations", "high-pass"}),
        ("2 poles, 600 Hz", 100, 600, {"white", "low-pass"}),
        ("2 poles, 20 Hz", 100, 30, {"low-pass"}),
        ("2 poles, 20 Hz, walk", 100, 10_800, {"drift"}),
        ("resonance, Q 10", 100, 600, {"resonance"}),
        ("line", 100, 30, {"line"}),
        ("slow line", 100, 30, {"drift"}),
        ("hum", 5, 600, {"line"}),
        ("variance steps", 100, 600, {"not stationary"}),
        ("swing, 2,000 × 2", 100, 600, {"not stationary"}),
        ("telegraph", 100, 600, {"relaxations", "low-pass"}),
    ],
)
def test_right_verdicts(name: str, rate_hz: float, seconds: float, expected: set[str] | None) -> None:
    found = right(name, rate_hz, seconds)
    if expected is None:
        assert found.outcome("white") != "wrong"
    else:
        assert found.right == expected
