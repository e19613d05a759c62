"""Tests that the Allan deviation agrees with published values, and with the noises that allantools generates.

Also tested is that no figure is claimed that the data do not show.
"""

import allantools
import numpy as np
import pytest
from fltea.identification.allan import allan, averaging_factors, overlapping
from fltea.identification.noise_model import AxisModel, Lorentzian, draw
from fltea.identification.reproduction import reproduction
from fltea.noise.parts import Order, Relaxation, White
from fltea.records.arrays import Array
from fltea.spectrum.allan_coefficients import Points, coefficients
from fltea.spectrum.allan_curve import local_slopes
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.identify_support import H, white

N = 20_000


@pytest.fixture(autouse=True)
def _seeded() -> None:
    np.random.seed(7)  # allantools' generators draw from numpy's global state


def random_walk(K: float, n: int = N) -> Array:
    """Return a rate that does a random walk, so that its variance grows by K² a second. Its two-sided
    spectrum is S(f) = (K / 2π)² / f², and the one-sided spectrum, which allantools uses, is twice that.
    """
    walk = allantools.noise.brown(n, b_minus2=2 * (K / (2 * np.pi)) ** 2, fs=1 / H)
    return np.asarray(walk)


def test_published_values() -> None:
    """The series and its Allan deviations are those of W. J. Riley, Handbook of Frequency Stability Analysis,
    NIST SP 1065 (2008), 12.4 and table 31.
    """
    state, series = 1234567890, []
    for _ in range(1000):
        series.append(state / 2147483647)
        state = 16807 * state % 2147483647
    found = overlapping([np.array(series)], np.array([1, 10, 100]))
    assert found == pytest.approx([2.922319e-1, 9.159953e-2, 3.241343e-2], rel=1e-6)


def test_white_noise_has_n_and_nothing_else() -> None:
    N_true = 0.01
    y = allantools.noise.white(N, b0=2 * N_true**2, fs=1 / H)  # `b0` is the one-sided spectrum
    found = allan([y + 4.5], H)
    assert found.N.value == pytest.approx(N_true, rel=0.02)
    assert found.N.low < N_true < found.N.high
    assert found.B.value is None
    assert "B is at most" in found.B.reason
    assert found.K.value is None
    assert "hours" in found.K.reason


def test_random_walk_has_k_and_no_n() -> None:
    found = allan([random_walk(0.02)], H)
    assert found.K.value == pytest.approx(0.02, rel=0.06)
    assert found.N.value is None
    assert "nowhere white" in found.N.reason


def test_flicker_has_b() -> None:
    B_true = 0.01
    # The generator of Kasdin and Walter also returns the Allan deviation of its noise.
    generator = allantools.Noise(nr=2**14, qd=1e-4, b=-3)
    generator.generateNoise()
    y = np.diff(generator.time_series)
    found = allan([y * B_true * 0.6643 / generator.adev(1.0, 1.0)], H)
    assert found.B.value == pytest.approx(B_true, rel=0.1)
    assert found.B.tau_to_s > 3 * found.B.tau_from_s


def test_a_higher_flat_is_not_the_floor() -> None:
    """A relaxation makes a maximum of the Allan deviation, where the curve is flat, and a later minimum,
    which is less certain.

    B comes from the minimum.
    """
    tau = np.geomspace(0.01, 1000, 60)
    falls = 0.3 * np.clip(np.log(tau / 100) / np.log(4), 0, 1)
    deviation = np.hypot(0.004 / np.sqrt(tau), 0.0074) * (1 - falls) * np.where(tau > 600, 1.3, 1.0)
    points = Points(
        tau,
        deviation,
        deviation * 0.6,
        deviation * 1.8,
        np.geomspace(1e4, 7, 60),
        local_slopes(tau, deviation),
    )
    assert coefficients(points, H).B.value == pytest.approx(deviation.min() / 0.6643, rel=1e-3)


def test_all_at_once() -> None:
    y = allantools.noise.white(N, b0=2 * 0.01**2, fs=1 / H) + random_walk(0.02)
    found = allan([y], H)
    assert found.N.value == pytest.approx(0.01, rel=0.03)
    assert found.K.value == pytest.approx(0.02, rel=0.35)
    # White noise and a random walk together have the Allan variance N²/τ + K²τ/3. Data sheets call the square
    # root of its minimum bias instability.
    assert found.B.value * 0.6643 == pytest.approx(np.sqrt(2 / np.sqrt(3) * 0.01 * 0.02), rel=0.15)
    assert 0.3 < found.B.tau_from_s < 3
    assert found.N.tau_to_s < found.B.tau_from_s < found.K.tau_to_s


def test_coefficients_of_white_noise_are_not_made_up() -> None:
    found = [allan([y], H) for y in white(3000, 60, 1)]
    assert sum(a.B.value is not None for a in found) <= 1
    assert sum(a.K.value is not None for a in found) <= 1
    assert all(a.N.value == pytest.approx(0.1, rel=0.1) for a in found)


@given(st.integers(1, 10**7))
def test_averaging_factors(n: int) -> None:
    factors = averaging_factors(n)
    assert factors[0] == 1
    assert factors[-1] == max(n // 4, 1)
    assert (np.diff(factors) > 0).all()


@settings(max_examples=25, deadline=None)
@given(st.floats(1e-3, 1e3), st.floats(-100, 100))
def test_scale_and_offset(scale: float, offset: float) -> None:
    y = white(500, 1, 3)[0]
    one, other = allan([y], H), allan([y * scale + offset * scale], H)
    assert other.deviation == pytest.approx([d * scale for d in one.deviation], rel=1e-6)
    assert other.degrees_of_freedom == one.degrees_of_freedom
    assert other.N.value == pytest.approx(one.N.value * scale, rel=1e-6)


@pytest.mark.parametrize(
    ("y", "h", "word"),
    [
        (np.ones(1000), H, "constant"),
        (np.arange(99.0), H, "needs 100"),
        (np.full(1000, np.nan), H, "finite"),
        (np.arange(1000.0), 0.0, "h is a sampling period"),
        (np.zeros((1000, 2)), H, "shape"),
    ],
)
def test_what_cannot_be_analysed(y: Array, h: float, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        allan([y], h)


def test_intervals_are_those_of_allantools() -> None:
    """The intervals agree to 1 %, but not exactly. Their degrees of freedom come from long sums: allantools
    ends these early, and fltea leaves out terms evenly.
    """
    for y in (white(3000, 1, 1)[0], random_walk(0.02), white(30_000, 1, 2)[0]):
        found = allan([y], H)
        slope = local_slopes(np.array(found.tau_s), np.array(found.deviation))
        power = np.clip(np.rint(-1 - 2 * slope), -2, 0).astype(int)
        for i, (m, kind) in enumerate(zip(averaging_factors(len(y)).tolist(), power.tolist(), strict=True)):
            edf = allantools.edf_greenhall(alpha=kind, d=2, m=m, N=len(y) + 1, overlapping=True)
            assert found.degrees_of_freedom[i] == pytest.approx(edf, rel=0.012)
            low, high = allantools.confidence_interval(found.deviation[i], edf, 0.95)
            assert (found.low[i], found.high[i]) == pytest.approx((low, high), rel=0.01)


MODELS = {
    "white": AxisModel((White(0.01),)),
    "relaxation": AxisModel((White(0.01), Relaxation(0.07, 0.1))),
    "order": AxisModel((White(0.02), Order(0.6, -3.0, 0.15))),
    "resonance": AxisModel((White(0.01),), (Lorentzian(31.4, 0.8, 0.003),)),
}


@pytest.mark.parametrize("name", MODELS)
def test_a_model_reproduces_its_own_noise(name: str) -> None:
    model = MODELS[name]
    y, _ = draw(model, H, 6000, np.random.default_rng(1))
    found = reproduction(allan([y], H), H, model)
    assert all(found.within), found.text
    assert found.text.startswith("The model reproduces the sensor from 0.01 to 15 s.")
    assert all(
        low <= ratio <= high for low, ratio, high in zip(found.low, found.ratio, found.high, strict=True)
    )
    assert np.mean([low < 1 < high for low, high in zip(found.low, found.high, strict=True)]) > 0.6


def test_a_model_that_lacks_the_drift() -> None:
    y = white(N, 1, 1)[0] + 0.5 * random_walk(1.0)
    found = reproduction(allan([y], H), H, AxisModel((White(1.0),)))
    assert not all(found.within)
    assert found.from_s == pytest.approx(H)
    assert found.to_s < 1.0
    assert found.ratio[-1] < 0.2
    assert "only; at " in found.text


def test_a_model_of_another_power() -> None:
    y = white(3000, 1, 1)[0]
    found = reproduction(allan([y], H), H, AxisModel((White(25.0),)))
    assert found.ratio[0] == pytest.approx(5, rel=0.05)
    assert not any(found.within[:20])
    assert not all(found.within)


def test_of_samples_that_recur_exactly_there_is_nothing_to_compare() -> None:
    """The samples recur exactly. At the averaging time of their period, the Allan deviation is 0."""
    curve = allan([np.tile([3.0, -1.0], 1500)], H)
    with pytest.raises(ValueError, match="nothing to compare"):
        reproduction(curve, H, MODELS["white"])
