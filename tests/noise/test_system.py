"""A noise as a linear system: the spectrum of the system is that of the noise's parts."""

import math

import numpy as np
import pytest
from fltea._native import TRACKER_COORDINATES
from fltea.estimator.tracker import Tracker
from fltea.noise import parts as p
from fltea.noise.linear_system import System
from fltea.noise.spectra import stationary
from fltea.noise.system import system
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.identify_support import H
from tests.rig.model_support import EXAMPLES, PARTS
from tests.rig.model_support import order as an_order

N = 10**6
LAM = np.geomspace(4 * math.pi / N, math.pi, 1000)
LOW = LAM < 1
NEARLY_RIGHT = 0.06
"""Largest permitted relative error, at low frequencies, of the spectrum of a linear system that approximates
a noise part of any kind.
"""


def ratio(parts: list[p.Part], samples: int = N) -> np.ndarray:
    """Return the ratio of the linear system's spectrum to the spectrum of the noise's parts, at the
    frequencies LAM.

    The ratio is computed as 1 + (system - noise) / noise. Where a filter makes the noise almost 0, the
    divisor is 0.3 % of the noise's median, so that differences at these frequencies hardly count.
    """
    wanted = p.spectrum(parts, LAM, H)
    found: np.ndarray = 1 + (system(parts, H, samples).spectrum(LAM) - wanted) / np.maximum(
        wanted, 0.003 * np.median(wanted)
    )
    return found


def order(alpha: float, f: float, s2: float) -> p.Order:
    return p.Order(alpha, f, s2 / H ** (2 * alpha))


WHITE = p.White(1.0)
EXACT: dict[str, list[p.Part]] = {
    "white": [WHITE],
    "walk": [WHITE, p.Walk(0.05)],
    "relaxation": [WHITE, p.Relaxation(1.0, 0.5), p.Relaxation(0.5, 0.003)],
    "alternating": [WHITE, p.Alternating(1.0, 0.02)],
    "resonance": [WHITE, p.Resonance(5.0, 20.0, 1.0)],
    "floor": [WHITE, p.Floor(0.1)],
    "low-pass 2": [WHITE, p.LowPass(10.0, 2.0)],
    "low-pass 3": [WHITE, p.LowPass(20.0, 3.0)],
    "low-pass 4": [WHITE, p.LowPass(40.0, 4.0)],
    "low-pass, above": [WHITE, p.LowPass(90.0, 2.0)],
    "low-pass, walk": [WHITE, p.Walk(0.1), p.LowPass(10.0, 2.0)],
    "low-pass, floor": [WHITE, p.LowPass(10.0, 2.0), p.Floor(0.01)],
}


@pytest.mark.parametrize("name", EXACT)
def test_what_has_poles_of_its_own_is_exact(name: str) -> None:
    np.testing.assert_allclose(ratio(EXACT[name])[LOW], 1, atol=3e-3)


NEARLY: dict[str, tuple[list[p.Part], float]] = {
    "1/f": ([WHITE, p.Arfima(0.5, 1e-6, 0.3)], 0.015),
    "arfima": ([WHITE, p.Arfima(0.4, 0.5, 0.3)], 0.01),
    "arfima, steep": ([WHITE, p.Arfima(0.9, 0.9, 0.01)], 0.1),
    "rise": ([WHITE, p.Rise(5.0, 0.6)], 0.03),
    "quantisation": ([p.White(0.01), p.Quantisation(H)], 0.01),
    "sharpening": ([WHITE, p.Sharpening(0.3)], 0.01),
    "smoothing": ([WHITE, p.Sharpening(-0.2)], 0.015),
    "notch": ([WHITE, p.Notch(25.0, 5.0)], 0.005),
    "notch below": ([WHITE, p.Notch(5.0, 5.0)], 0.03),
    "mean of 2": ([WHITE, p.Mean(2)], 0.02),
    "mean of 4": ([WHITE, p.Mean(4)], 0.02),
    "mean of 8": ([WHITE, p.Mean(8)], 0.02),
    "mean of 8, floor": ([WHITE, p.Mean(8), p.Floor(0.01)], 0.02),
    "low-pass of 3.5": ([WHITE, p.LowPass(25.0, 3.5)], 0.005),
    "low-pass, relaxation": ([WHITE, p.Relaxation(1.0, 5.0), p.LowPass(10.0, 2.0)], 0.03),
    "low-pass, fast relaxation": ([WHITE, p.Relaxation(1.0, 0.02), p.LowPass(10.0, 2.0)], 0.01),
    "low-pass, order": ([WHITE, order(0.7, -1, 0.3), p.LowPass(10.0, 2.0)], 0.01),
    "low-pass, resonance": ([WHITE, p.Resonance(5.0, 20.0, 1.0), p.LowPass(10.0, 2.0)], 0.01),
    "mean of 4, order": ([WHITE, order(0.7, -1, 0.3), p.Mean(4)], 0.05),
}


@pytest.mark.parametrize("name", NEARLY)
def test_what_has_none_is_nearly_right_at_low_frequencies(name: str) -> None:
    parts, apart = NEARLY[name]
    np.testing.assert_allclose(ratio(parts)[LOW], 1, atol=apart)


HIGH_PASSED: dict[str, list[p.Part]] = {
    "one pole": [WHITE, p.HighPass(0.1, 1.0)],
    "one pole, fast": [WHITE, p.HighPass(5.0, 1.0)],
    "two poles": [WHITE, p.HighPass(1.0, 2.0)],
    "three poles, slow": [WHITE, p.HighPass(0.02, 3.0)],
    "floor": [WHITE, p.HighPass(0.1, 1.0), p.Floor(0.01)],
    "relaxation": [WHITE, p.Relaxation(0.5, 0.3), p.HighPass(0.1, 2.0)],
    "walk": [WHITE, p.Walk(0.3), p.HighPass(1.0, 1.0)],
    "order": [WHITE, order(0.5, -0.5, 0.1), p.HighPass(0.1, 1.0)],
    "low-pass": [WHITE, p.HighPass(0.1, 1.0), p.LowPass(20.0, 2.0)],
    "quantisation": [p.White(0.01), p.Quantisation(H), p.HighPass(0.1, 1.0)],
}


@pytest.mark.parametrize("name", HIGH_PASSED)
def test_behind_a_high_pass_it_is_right_but_for_what_no_filter_can_do_without(name: str) -> None:
    """The error of the system's spectrum is small compared with the noise before the high-pass filter.

    The filter leaves almost nothing of some frequencies. The system has a small white noise R there, because
    no Kalman filter works without one. So the error is not compared with the noise after the filter.
    """
    check_high_passed(HIGH_PASSED[name], 0.01)


@pytest.mark.parametrize("kind", [kind for kind, part in EXAMPLES.items() if not part.has("filter")])
def test_each_part_behind_a_high_pass_is_nearly_right(kind: str) -> None:
    check_high_passed([WHITE, EXAMPLES[kind], p.HighPass(0.1, 1.0)], NEARLY_RIGHT)


def check_high_passed(parts: list[p.Part], apart: float) -> None:
    s = system(parts, H, N)
    floor = sum(part.R for part in parts if isinstance(part, p.Floor))
    before = p.spectrum([part for part in parts if not isinstance(part, p.HighPass)], LAM, H)
    assert s.R - floor < 1e-3 * before[LOW].max()
    assert not s.walks
    off = s.spectrum(LAM) - (s.R - floor) - p.spectrum(parts, LAM, H)
    assert float(np.abs(off / before)[LOW].max()) < apart


@pytest.mark.parametrize("alpha", [0.0, 0.15, 0.3, 0.5, 0.7, 0.95, 1.5, 1.9])
@pytest.mark.parametrize("f", [-10.0, -2.0, -1.0, -0.1])
@pytest.mark.parametrize("samples", [10**4, N, 10**7])
def test_orders_are_right_to_a_per_cent(alpha: float, f: float, samples: int) -> None:
    if not stationary(alpha, f * H**alpha):
        return
    for parts in ([p.White(0.0), order(alpha, f, 1.0)], [WHITE, order(alpha, f, 0.3)]):
        seen = LOW & (4 * math.pi / samples < LAM)
        np.testing.assert_allclose(ratio(parts, samples)[seen], 1, atol=0.02)


WORDS: list[st.SearchStrategy[p.Part]] = [
    *PARTS.values(),
    st.builds(an_order, st.floats(1e-3, 1.999), st.floats(1e-12, 0.9999), st.floats(0.01, 100)),
]
models = st.lists(st.one_of(WORDS), max_size=7).map(lambda parts: [p.White(1.0), *parts])


def check(s: System) -> None:
    n = len(s.a)
    assert n <= TRACKER_COORDINATES
    for one in (s.Q, s.P0):
        assert one.shape == (n, n)
        np.testing.assert_array_equal(one, one.T)
        if n:
            values = np.linalg.eigvalsh(one)
            assert values.min() >= -1e-9 * max(values.max(), 1e-300)
    assert s.R > 0
    assert np.count_nonzero(s.b[2 * s.pairs :]) == 0
    assert np.all(s.b[: 2 * s.pairs] != 0)
    assert np.all(np.hypot(s.a, s.b) <= 1)


@pytest.mark.parametrize("filters", [[], [p.LowPass(10.0, 2.0)]], ids=["plain", "low-pass"])
@pytest.mark.parametrize("kind", EXAMPLES)
def test_each_part_is_nearly_right_at_low_frequencies(kind: str, filters: list[p.Part]) -> None:
    if kind == "high-pass" or (filters and EXAMPLES[kind].has("filter")):
        return  # high-passes are tested above, and no model has two low-passes
    np.testing.assert_allclose(ratio([WHITE, EXAMPLES[kind], *filters])[LOW], 1, atol=NEARLY_RIGHT)


@given(models, st.integers(64, 10**7))
def test_any_sentence_is_a_system(parts: list[p.Part], samples: int) -> None:
    s = system(parts, H, samples)
    check(s)
    check(s.with_offset())
    # A state that decays has a stationary covariance. The initial covariance P0 has to be this covariance.
    still = np.hypot(s.a, s.b) < 1
    apart = s.A @ s.P0 @ s.A.T + s.Q - s.P0
    np.testing.assert_allclose(apart[np.ix_(still, still)], 0, atol=1e-9 * np.abs(s.P0).max(initial=1.0))
    Tracker([0.0]).set(0, s)  # the tracker accepts the system as its model


@pytest.mark.parametrize("alpha", [1e-6, 0.1, 0.49])
def test_an_order_without_f_is_a_system(alpha: float) -> None:
    seen = LOW & (LAM > 1e-4)
    np.testing.assert_allclose(ratio([WHITE, p.Order(alpha, 0.0, 1.0)])[seen], 1, atol=0.02)


def test_the_state_is_what_is_no_coloured_noise() -> None:
    s = system([WHITE, p.Relaxation(1.0, 0.5), p.Resonance(5.0, 20.0, 1.0)], H, N)
    assert s.pairs == 1
    np.testing.assert_array_equal(s.signal, [0, 0, 1])
    assert not s.walks
    assert system([WHITE, p.Walk(0.1)], H, N).walks


def test_an_offset_is_one_coordinate_more() -> None:
    s = system([WHITE, p.Relaxation(math.sqrt(2.0), 0.5)], H, N).with_offset()
    np.testing.assert_allclose(s.a, [math.exp(-H / 0.5), 1.0])
    np.testing.assert_array_equal(s.signal, [1.0, 0.0])
    assert s.P0[1, 1] == pytest.approx(3e4)


def test_what_is_not_stationary_is_refused() -> None:
    with pytest.raises(ValueError, match="not stationary"):
        system([WHITE, p.Order(0.5, 3.0, 1.0)], H, N)


@pytest.mark.parametrize("poles", [2.1215274861128472, 2.132277290972571, 2.0276815574736102])
def test_coordinates_do_not_cancel_each_other(poles: float) -> None:
    """A system with two nearly equal poles must not have a state for each pole.

    In an earlier version, the variance of each of these states was 10⁷ times that of their sum, and the
    Kalman filter diverged.
    """
    s = system([p.White(0.019), p.LowPass(21.0, poles), p.Walk(0.1164)], H, 4096)
    of_noise = s.signal == 0
    assert np.trace(s.P0[np.ix_(of_noise, of_noise)]) < 100 * 0.019


@pytest.mark.parametrize(
    ("parts", "signal"),
    [
        # white noise after a filter in the sensor that averages exponentially
        ([p.White(1e-10), p.Relaxation(0.0335, 0.045)], [0.0]),
        # filtered white noise that was rounded to counts
        ([p.White(2e-6), p.Relaxation(0.0335, 0.045)], [0.0]),
        ([p.White(1e-10), p.Relaxation(0.0335, 0.045), p.Relaxation(0.05, 2.0)], [0.0, 1.0]),
        ([p.White(1e-10), p.Relaxation(0.0335, 0.045), p.Walk(0.01)], [0.0, 1.0]),
        # the white noise makes a floor of the spectrum, so the relaxation is not due to a filter in the
        # sensor
        ([p.White(0.01), p.Relaxation(0.05, 0.2)], [1.0]),
        # this relaxation is slower than any sensor's filter, so it is a part of the noise and not a filter
        ([p.White(1e-10), p.Relaxation(0.05, 2.0)], [1.0]),
    ],
)
def test_without_white_noise_the_fastest_relaxation_is_that_behind_a_filter(
    parts: list[p.Part], signal: list[float]
) -> None:
    np.testing.assert_array_equal(system(parts, H, N).signal, signal)


def test_an_order_without_white_noise_stays_the_state() -> None:
    s = system([p.White(0.0), p.Arfima(0.2, 1e-9, 0.01)], H, N)
    assert s.signal.all()
    assert s.R > 1e-7


def test_a_relaxation_that_is_noise_has_the_spectrum_that_it_had() -> None:
    parts: list[p.Part] = [p.White(1e-10), p.Relaxation(0.0335, 0.045), p.Relaxation(0.05, 2.0)]
    np.testing.assert_allclose(ratio(parts), 1, atol=2e-3)
