"""The contest of the models, the residual test, and the words for what was fitted."""

import numpy as np
import pytest
from fltea.noise.spectra import ar2
from fltea.spectrum.periodogram import Binned, periodogram
from fltea.spectrum.pole_pair import pole_pair
from fltea.spectrum.relaxations import corner_hz
from fltea.spectrum.residuals import residual_ks
from fltea.spectrum.rivals import Contest, contest, fit_all
from identify_support import H, ar, long_recursion, white


def of(y: np.ndarray) -> Contest:
    p = periodogram(y, H)
    return contest(p, fit_all(p))


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("white", lambda: white(3000, 5, 1)),
        ("ar1", lambda: ar((0.6,), 3000, 5, 2) + white(3000, 5, 3)),
        ("two_ar1", lambda: ar((0.995,), 20_000, 3, 6) / 5 + ar((0.5,), 20_000, 3, 7)),
        ("fractional", lambda: [long_recursion(0.6, -0.19, 20_000, seed) for seed in (8, 9)]),
    ],
)
def test_the_right_one_wins(name: str, make: object) -> None:
    """By BIC, in all but one of the series at most, and its residuals are white."""
    found = [of(y) for y in make()]  # type: ignore[operator]
    assert sum(c.best != name for c in found) <= (1 if len(found) > 2 else 0)
    winners = [c for c in found if c.best == name]
    assert sum(c.models[name].residual_ks > 1.36 for c in winners) <= 1
    for c in found:
        assert {"white", "ar1", "ar2", "two_ar1", "fractional"} <= set(c.models)
        assert ("rising" in c.models) == (c.ratio_white > 8.3 or name != "white")
        assert c.models["white"].log_likelihood == 0
        # Models within others.
        gain = {key: model.log_likelihood for key, model in c.models.items()}
        assert 0 <= gain["ar1"] + 0.1 <= min(gain["ar2"], gain["two_ar1"], gain["fractional"]) + 0.3


@pytest.mark.parametrize("radius", [0.9, 0.98])
def test_a_resonance_is_found_by_both_models_that_have_one(radius: float) -> None:
    """The fractional model makes nearly the same ones, with α > 1."""
    phi = 2 * radius * np.cos(1.2), -(radius**2)
    for y in ar(phi, 6000, 3, 4) + white(6000, 3, 5):
        models = of(y).models
        assert abs(models["ar2"].log_likelihood - models["fractional"].log_likelihood) < 6
        assert models["ar2"].log_likelihood > models["two_ar1"].log_likelihood + 100
        assert models["fractional"].parameters["alpha"] > 1.5
        assert models["ar2"].parameters["resonance_hz"] == pytest.approx(1.2 / (2 * np.pi * H), rel=0.02)


def test_bic_by_hand() -> None:
    c = of(ar((0.5,), 2000, 1, 1)[0])
    for name, k in (("white", 0), ("ar1", 2), ("ar2", 3), ("two_ar1", 4), ("fractional", 3)):
        model = c.models[name]
        assert model.bic == pytest.approx(k * np.log(996) - 2 * model.log_likelihood)


def test_residual_statistic() -> None:
    """Of a right spectrum 5 % are above 1.36; of a wrong one nearly all are."""
    rng = np.random.default_rng(1)
    m = 1000
    right = [residual_ks(rng.exponential(size=m), np.ones(m)) for _ in range(1000)]
    assert (np.array(right) > 1.36).mean() == pytest.approx(0.05, abs=0.025)
    slope = np.linspace(1.4, 0.6, m)
    wrong = [residual_ks(rng.exponential(size=m) * slope, np.ones(m)) for _ in range(50)]
    assert (np.array(wrong) > 1.36).mean() > 0.9
    lines = [residual_ks(*averaged(np.ones(m), rng)) for _ in range(1000)]
    assert (np.array(lines) > 1.36).mean() == pytest.approx(0.05, abs=0.025)
    wrong = [residual_ks(*averaged(slope, rng)) for _ in range(50)]
    assert (np.array(wrong) > 1.36).mean() > 0.9
    assert residual_ks(2 * np.ones(4), np.ones(4)) == 0
    assert residual_ks(np.array([1.0, 0, 0, 0]), np.ones(4)) == pytest.approx(0.75 * 2)


def averaged(spectrum: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Lines that stand for 1, 2 or 5 ordinates; the spectrum that is tested for, their weights."""
    weight = np.repeat([1.0, 2.0, 5.0], len(spectrum) // 3 + 1)[: len(spectrum)]
    return rng.gamma(weight) / weight * spectrum, np.ones(len(spectrum)), weight


def test_corner_is_that_of_the_relaxation_before_it_was_sampled() -> None:
    """Also where that is above half the sample rate."""
    for hz in (0.01, 5.0, 41.0, 73.0):
        assert corner_hz(np.exp(-2 * np.pi * hz * H), H) == pytest.approx(hz)


@pytest.mark.parametrize(
    ("phi1", "phi2", "known"),
    [
        (2 * 0.9 * np.cos(1.2), -0.81, {"resonance_hz"}),
        (0.5, -0.06, {"bend_hz"}),  # two real poles
        (2 * 0.4 * np.cos(0.3), -0.16, {"bend_hz"}),  # a pair, but no peak
        (-0.5, 0.0, set()),
        (0.0, 0.0, set()),
    ],
)
def test_a_resonance_needs_a_peak(phi1: float, phi2: float, known: set[str]) -> None:
    lam = np.linspace(0.005, 3.1, 400)
    data = Binned(lam, np.full(400, 10.0), ar2(lam, phi1, phi2)[np.newaxis])
    assert set(pole_pair(data, phi1, phi2, H)) - {"height"} == known
    flat = data._replace(power=np.ones((1, 400)))
    assert "resonance_hz" not in pole_pair(flat, phi1, phi2, H)  # the data have no peak


def test_parameters_in_units() -> None:
    scale = 7.0
    y = scale * (ar((2 * 0.9 * np.cos(1.2), -0.81), 20_000, 1, 4)[0] + white(20_000, 1, 5)[0])
    found = of(y).models["ar2"].parameters
    assert found["resonance_hz"] == pytest.approx(1.2 / (2 * np.pi * H), rel=0.02)
    assert found["s2"] == pytest.approx(scale**2, rel=0.2)
    assert found["R"] == pytest.approx(scale**2, rel=0.2)
    assert found["height"] > 10
    two = of(ar((0.995,), 20_000, 1, 6)[0] / 5 + ar((0.5,), 20_000, 1, 7)[0]).models["two_ar1"].parameters
    assert two["phi_1"] > two["phi_2"]
    assert two["bend_1_hz"] < two["bend_2_hz"]
    assert two["s2_2"] + two["R"] == pytest.approx(1, rel=0.2)
