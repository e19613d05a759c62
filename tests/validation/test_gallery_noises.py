"""The gallery's noises against closed forms, seen by a periodogram of other hands."""

import ast
import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from fltea.noise import spectra
from fltea.noise.weights import weights
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import welch

from tools.validation import recursions
from tools.validation.gallery.filters import CONSTANT_DELAY_MS, MPU9250_DLPF, LowPass, mpu9250
from tools.validation.gallery.noise import Drift, Line, bursts, outliers, rounded, step, wander
from tools.validation.gallery.noises import NOISES
from tools.validation.gallery.parts import Flicker, Fractional, Part, Relaxation, ladder
from tools.validation.recursions import (
    FractionalState,
    Stream,
    convolved,
    fractional_difference,
    fractional_noise,
    inverse_series,
    state_response,
)

pytestmark = pytest.mark.slow  # they prove the referee of a proof: no part of the program

GENERATORS = ("../recursions", "parts", "noise", "noises", "contrast")
SAMPLES, SEGMENT = 1 << 16, 1 << 11
RATE_HZ = 100.0
PLAIN = [name for name, noise in NOISES.items() if noise.treatment is None]


@pytest.mark.parametrize("module", GENERATORS)
def test_nothing_is_shared_with_the_fits(module: str) -> None:
    """Neither noises nor the rule of what can be told import anything of the program but the gallery."""
    source = (Path(recursions.__file__).parent / "gallery" / f"{module}.py").read_text(encoding="utf-8")
    names: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [one.name for one in node.names]
        elif isinstance(node, ast.ImportFrom):
            names.append(node.module or "")
    ours = [name for name in names if name.startswith(("fltea", "tools"))]
    shared = ("fltea.records.fit", "tools.validation.recursions")  # the names of verdicts
    assert all(name.startswith("tools.validation.gallery.") or name in shared for name in ours)


@pytest.mark.parametrize("name", PLAIN)
def test_spectrum(name: str) -> None:
    """Bands of Welch's periodogram hold the power that the closed form has there."""
    noise = NOISES[name]._replace(lines=(), drift=None)
    y = noise.draw(SAMPLES, RATE_HZ, np.random.default_rng(5))
    _, power = welch(y, window="hann", nperseg=SEGMENT, scaling="density", fs=2 * np.pi)
    power *= np.pi  # so that white noise of variance R has R
    lam = 2 * np.pi * np.arange(SEGMENT // 2 + 1) / SEGMENT
    edges = np.unique(np.geomspace(5, SEGMENT // 2 - 3, 9).astype(int))
    # A window of a short segment smears what is steep; the mean of neighbours is what it sees of a curve.
    fine = np.linspace(-1.5, 1.5, 31)
    near = noise.spectrum((lam[5:, np.newaxis] + fine * lam[1]).ravel(), RATE_HZ).reshape(-1, len(fine))
    weight = np.cos(np.pi * fine / 4) ** 8
    smeared = np.concatenate([np.ones(5), near @ weight / weight.sum()])
    for begin, end in itertools.pairwise(edges):
        expected, got = smeared[begin:end].sum(), power[begin:end].sum()
        share = (smeared[begin:end] ** 2).sum() / expected**2  # of one ordinate, in effect
        spread = math.sqrt(share / (SAMPLES / SEGMENT * 1.3))
        assert got / expected == pytest.approx(1, abs=5 * spread + 0.03), f"ordinates {begin} to {end}"


@pytest.mark.parametrize("name", ["every 10th repeated", "slow chip", "white", "1 relaxation"])
def test_drawn_again_is_the_same(name: str) -> None:
    first, again = (NOISES[name].draw(1_000, 5.0, np.random.default_rng(3)) for _ in range(2))
    assert (first == again).all()
    assert (first != NOISES[name].draw(1_000, 5.0, np.random.default_rng(4))).any()


@pytest.mark.parametrize("rate_hz", [5.0, 100.0, 1_000.0])
@pytest.mark.parametrize("name", list(NOISES))
def test_every_rate(name: str, rate_hz: float) -> None:
    noise = NOISES[name]
    y = noise.draw(150, rate_hz, np.random.default_rng(1))
    assert y.shape == (150,)
    assert np.isfinite(y).all()
    density = noise.spectrum(np.linspace(0.01, 3.1, 50), rate_hz)
    assert (density > 0).all()
    assert np.isfinite(density).all()


@given(st.floats(-0.999, 0.999), st.lists(st.integers(0, 400), max_size=3), st.integers(0, 99))
def test_a_stream_goes_on(pole: float, cuts: list[int], seed: int) -> None:
    """However a record is cut."""
    e = np.random.default_rng(seed).standard_normal(400)
    stream = Stream([1.0], [1.0, -pole], pole * 2.0)
    x = np.concatenate([stream.run(part) for part in np.split(e, sorted(cuts))])
    before = 2.0
    for k in range(400):
        before = pole * before + e[k]
        assert x[k] == pytest.approx(before, abs=1e-9)


@pytest.mark.parametrize("length", [10, 1_000])
def test_convolution(length: int) -> None:
    rng = np.random.default_rng(3)
    e, response = rng.standard_normal(5_000), rng.standard_normal(length)
    np.testing.assert_allclose(
        convolved(e, response, 800), np.convolve(e, response, mode="valid")[-800:], atol=1e-8
    )


@given(st.floats(-0.9, 0.9))
def test_differences_undo_each_other(d: float) -> None:
    there, back = fractional_difference(d, 300), fractional_difference(-d, 300)
    np.testing.assert_allclose(np.convolve(there, back)[:300], np.eye(300)[0], atol=1e-12)
    np.testing.assert_allclose(inverse_series(there), back, atol=1e-9)


@pytest.mark.parametrize("d", [0.2, 0.4, -0.3])
def test_order_has_its_autocovariance(d: float) -> None:
    """Variance Γ(1 - 2d) / Γ(1 - d)², neighbours correlated by d / (1 - d)."""
    y = np.stack([fractional_noise(d, 64, np.random.default_rng([6, i])) for i in range(4_000)])
    variance = math.gamma(1 - 2 * d) / math.gamma(1 - d) ** 2
    assert (y**2).mean() == pytest.approx(variance, rel=0.03)
    assert (y[:, 1:] * y[:, :-1]).mean() / variance == pytest.approx(d / (1 - d), abs=0.02)
    assert (y[:, 0] ** 2).mean() == pytest.approx(variance, rel=0.1)


def test_what_is_drawn_is_stationary_from_its_first_sample_on() -> None:
    rng = np.random.default_rng(7)
    state, relaxation = FractionalState(0.6, -0.02, 64), Relaxation(0.05, 100.0)
    pole = math.exp(-2 * math.pi * relaxation.hz / RATE_HZ)
    first = np.array([relaxation.draw(1, RATE_HZ, rng)[0] for _ in range(4_000)])
    assert first.var() == pytest.approx(100 * (1 - pole) / (1 + pole), rel=0.1)
    x = np.array([state.draw(rng) for _ in range(400)])
    assert x.shape == (400, 64)
    assert x[:, [0, -1]].var(axis=0) == pytest.approx(state.power, rel=0.3)


def test_states_stay_stationary_at_slow_rates() -> None:
    for noise in NOISES.values():
        for part in noise.parts:
            if isinstance(part, Fractional):
                for rate_hz in (5.0, 100.0, 1_000.0):
                    assert -(2**part.alpha) < part.g(rate_hz)
                    assert part.g(rate_hz) < part._weights().sum() if part.window else part.g(rate_hz) <= 0


@pytest.mark.parametrize("parts", [(Flicker(1.0),), ladder(1e-4, 1e3, 8, 1.0)])
def test_flicker_is_as_dense_as_white_at_its_corner(parts: tuple[Part, ...]) -> None:
    lam = 2 * np.pi * np.array([0.1, 1.0]) / 1_000
    density = sum(part.spectrum(lam, 1_000.0) for part in parts)
    np.testing.assert_allclose(density, [10, 1], rtol=0.01)


@pytest.mark.parametrize(("bandwidth_hz", "delay_ms"), [*MPU9250_DLPF.items()])
def test_dlpf_delays_are_those_of_one_pole(bandwidth_hz: int, delay_ms: float) -> None:
    """Of all but 250 Hz, which runs at 8 kHz and has less of the constant."""
    of_one_pole = 1e3 / (2 * math.pi * bandwidth_hz)
    if bandwidth_hz != 250:
        assert delay_ms == pytest.approx(of_one_pole + CONSTANT_DELAY_MS, abs=0.35)
    low_pass = mpu9250(bandwidth_hz)
    assert low_pass.every(100.0) == (80 if bandwidth_hz == 250 else 10)
    lam = 2 * np.pi * np.array([1e-9, bandwidth_hz]) / (low_pass.every(100.0) * 100.0)
    gain = low_pass.power(lam, low_pass.every(100.0) * 100.0)
    assert gain[0] == pytest.approx(1)
    assert gain[1] == pytest.approx(0.5, abs=0.1)


def test_filters_run_well_above_their_corner() -> None:
    assert LowPass(41.0).every(5.0) * 5.0 >= 8 * 41.0
    assert LowPass(5.0).every(1_000.0) == 1


def test_lines_fold() -> None:
    hum = Line(50.02, 1.0)
    assert hum.folded(100.0) == pytest.approx(49.98)
    assert hum.folded(1_000.0) == pytest.approx(50.02)
    assert hum.folded(5.0) == pytest.approx(0.02)
    assert Line(0.03, 1.0, "nyquist").folded(100.0) == pytest.approx(49.97)
    power = np.abs(np.fft.rfft(hum.draw(50_000, 100.0, np.random.default_rng(1)))) ** 2
    assert power.argmax() * 100.0 / 50_000 == pytest.approx(49.98)


def test_treatments() -> None:
    y, rng = np.random.default_rng(9).standard_normal(200_000), np.random.default_rng(10)
    coarse = rounded(0.1)(y, rng)
    assert set(coarse.tolist()) <= {-1.0, 0.0, 1.0}
    assert 0.015 < (coarse != 0).mean() < 0.035
    assert (np.abs(outliers(y, rng)) == 20).mean() == pytest.approx(1e-3, rel=0.3)
    assert np.abs(bursts(y, rng)).max() > 50
    halves = np.split(step(y, rng), 2)
    assert halves[1].var() / halves[0].var() == pytest.approx(2, rel=0.03)
    quarters = np.split(wander(y, rng), 4)
    assert quarters[0].var() / quarters[2].var() > 2
    assert Drift(3.0).draw(100)[[0, -1]].tolist() == pytest.approx([0, 2.97])


@pytest.mark.parametrize(("alpha", "f"), [(0.3, -3.0), (0.6, -0.3), (0.8, -10.0)])
def test_state_response_is_the_recursion_in_time(alpha: float, f: float) -> None:
    """And that of the closed form in frequency."""
    g, n = 0.01**alpha * f, 300
    c, x = weights(alpha, n), np.zeros(n)
    for k in range(n):
        x[k] = (k == 0) + (g * x[k - 1] if k else 0) - c[1 : k + 1] @ x[:k][::-1]
    np.testing.assert_allclose(state_response(alpha, g, n), x, atol=1e-12)
    power = np.abs(np.fft.rfft(state_response(alpha, g, 1 << 17))) ** 2
    at = np.array([50, 500, 5_000, 50_000])
    np.testing.assert_allclose(power[at], spectra.fractional(2 * np.pi * at / (1 << 17), alpha, g), rtol=0.01)
