"""Low-passes: found, with their corner; divided out, so that they hide nothing; not found where none is."""

import numpy as np
import pytest
from filtered_noise import averaged, fractionally_integrated, low_passed, relaxations
from fltea.identification.sums import examined
from fltea.spectrum.low_pass import LowPass, divided, power_gain
from fltea.spectrum.periodogram import periodogram
from fltea.spectrum.spectral import Spectral
from fltea.spectrum.verdict import decide
from identify_support import H, ar, white
from scipy.signal import butter, freqz
from tiers import slow_but

from tools.validation.gallery.records import draw

N = 60_000


def seen(y: np.ndarray) -> Spectral:
    return examined(y, H)


@pytest.mark.parametrize("n", [3_000, 60_000])
@pytest.mark.parametrize(("corner_hz", "poles"), [(5, 1), (20, 1), (5, 2), (20, 2), (20, 4)])
def test_the_filter_is_named_with_its_corner(corner_hz: float, poles: int, n: int) -> None:
    for seed in range(3):
        e = seen(low_passed(n, corner_hz, poles, seed)).evidence
        assert e.low_pass is not None
        assert e.low_pass.corner_hz == pytest.approx(corner_hz, rel=0.25 if n < 10_000 else 0.06)
        assert e.low_pass.poles == pytest.approx(poles, rel=0.3 if n < 10_000 else 0.15)
        assert decide(e).kind == "low-pass"


@pytest.mark.parametrize(("corner_hz", "poles"), [(41, 1), (41, 2)])
def test_a_corner_near_half_the_sample_rate(corner_hz: float, poles: int) -> None:
    """Aliases lift the spectrum there: the corner is not known well, but it is nothing but a low-pass."""
    for seed in range(3):
        verdict = decide(seen(low_passed(N, corner_hz, poles, seed)).evidence)
        assert verdict.kind == "low-pass"
        assert "resonance" not in verdict.text


@pytest.mark.parametrize(("count", "corner_hz"), [(4, 11.4), (10, 4.5)])
def test_moving_averages_are_low_passes(count: int, corner_hz: float) -> None:
    """Their side lobes are no resonances."""
    for seed in (1, 2):
        e = seen(averaged(N, count, seed)).evidence
        assert e.low_pass is not None
        assert e.low_pass.corner_hz == pytest.approx(corner_hz, rel=0.12)
        assert "resonance" not in decide(e).text


def test_what_is_below_the_filter_is_seen() -> None:
    flicker = fractionally_integrated(N, 0.499, 3) * 0.25
    e = seen(low_passed(N, 20, 2, 3) + flicker).evidence
    assert e.low_pass is not None
    assert e.low_pass.corner_hz == pytest.approx(20, rel=0.1)
    verdict = decide(e)
    assert verdict.kind == "fractional or relaxations"
    assert e.contest.order == pytest.approx(0.5, abs=0.15)
    assert "low-pass with its corner at" in verdict.text


def test_flicker_in_front_of_one_pole() -> None:
    """It looks like relaxations of which the fastest is the filter: the contest has to know of both."""
    for name, seconds in (("1 pole, 41 Hz, 1/f", 600.0), ("1 pole, 41 Hz, 1/f", 1200.0)):
        e = examined(draw(name, 100.0, seconds, 1), H).evidence
        assert e.low_pass is not None
        assert e.low_pass.corner_hz == pytest.approx(41, rel=0.15)
        assert e.contest.order == pytest.approx(0.5, abs=0.1)
        assert decide(e).kind == "fractional or relaxations"


def test_drift_behind_a_filter_is_the_verdict() -> None:
    walk = np.cumsum(white(N, 1, 5)[0]) / 300
    verdict = decide(seen(low_passed(N, 20, 2, 5) + walk).evidence)
    assert verdict.kind == "drift"
    assert "low-pass with its corner at" in verdict.text


def test_what_rises_behind_a_filter_of_another_shape() -> None:
    """Each tenth sample twice: 1 + 0.2 cos λ, nearly but not quite one pole."""
    e = examined(draw("every 10th repeated", 100.0, 10_800.0, 0), H).evidence
    assert e.p_clean < 1e-3
    assert decide(e).kind == "low-pass"


def test_noise_of_the_sensor_is_that_before_the_filter() -> None:
    """R of the fit is the density below the corner, 1."""
    found = seen(low_passed(N, 5, 2, 1))
    assert found.fits.null.white.scale[0] == pytest.approx(1, rel=0.05)
    lam = 2 * np.pi * H * np.array([0.5, 5.0, 15.0])
    np.testing.assert_allclose(found.spectrum(lam, H), [1, 0.5, 1 / 82], rtol=0.3)


NO_FILTER = {
    "white": lambda seed: white(N, 1, seed)[0],
    "a relaxation in white noise": lambda seed: relaxations(N, (5.0,), seed),
    "three of them": lambda seed: relaxations(N, (0.05, 0.5, 5.0), seed),
    "an order": lambda seed: fractionally_integrated(N, 0.3, seed),
    "a resonance": lambda seed: ar((2 * 0.95 * np.cos(1.2), -0.9025), N, 1, seed)[0] + white(N, 1, seed)[0],
    "a broad resonance": lambda seed: ar((2 * 0.7 * np.cos(1.2), -0.49), N, 1, seed)[0],
    "a random walk": lambda seed: np.cumsum(white(N, 1, seed)[0]) / 50 + white(N, 1, seed + 9)[0],
    "differences": lambda seed: np.diff(white(N + 1, 1, seed)[0]),
}


@pytest.mark.parametrize("name", slow_but(NO_FILTER.keys() - {"a resonance", "a broad resonance"}, NO_FILTER))
def test_none_is_found_where_none_is(name: str) -> None:
    for seed in (1, 2, 3):
        assert seen(NO_FILTER[name](seed)).evidence.low_pass is None


@pytest.mark.parametrize("poles", [1, 2, 4])
def test_gain_is_that_of_the_filter(poles: int) -> None:
    """Of the oversampled chain, folded: all branches add up."""
    over, corner_hz = 200, 12.0
    hz = np.linspace(1, 48, 20)
    b, a = butter(poles, corner_hz / (over / H / 2))
    branches = np.abs([freqz(b, a, f, fs=over / H)[1] for f in fold(hz, over)]) ** 2
    expected = branches.sum(axis=0)
    at_zero = (np.abs([freqz(b, a, f, fs=over / H)[1] for f in fold(np.array([1e-6]), over)]) ** 2).sum()
    found = power_gain(2 * np.pi * H * hz, LowPass(corner_hz, float(poles), 0.0, 0.0), H)
    np.testing.assert_allclose(found, expected / at_zero, rtol=0.03, atol=2e-3)


def fold(hz: np.ndarray, over: int) -> list[np.ndarray]:
    """The frequencies up to half the rate before sampling that look like hz."""
    rate = 1 / H
    return [hz] + [one for k in range(1, over // 2) for one in (k * rate - hz, k * rate + hz)]


def test_divided_keeps_the_pass_band() -> None:
    p = periodogram(white(4000, 1, 1)[0], H)
    through = divided(p, LowPass(10.0, 2.0, 0.0, 9.0))
    highest = through.lam[-1] / (2 * np.pi * H)
    assert 7 < highest < 10
    np.testing.assert_allclose(
        through.power * power_gain(through.lam, LowPass(10.0, 2.0, 0.0, 9.0), H), p.power[: len(through.lam)]
    )
    with pytest.raises(ValueError, match="frequencies to fit"):
        divided(p, LowPass(0.5, 2.0, 0.0, 9.0))
