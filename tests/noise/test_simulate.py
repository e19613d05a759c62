import math

import numpy as np
import pytest
from fltea.noise.simulation import FractionalNoise, quantise
from fltea.noise.spectra import stationary

H = 0.01


def spectrum(omega: np.ndarray, alpha: float, f: float, Q: float, R: float) -> np.ndarray:
    """Return the spectrum of a noise of order α whose memory is unlimited: S = h^2α Q / |(1 - z)^α - h^α f
    z|² + R. Here z = e^-iω, h is the sampling period, Q the variance of the driving noise and R that of the
    measurement noise.
    """
    z = np.exp(-1j * omega)
    return H ** (2 * alpha) * Q / np.abs((1 - z) ** alpha - H**alpha * f * z) ** 2 + R


@pytest.mark.parametrize(("alpha", "f"), [(0.3, -1.8), (0.6, -3.0), (0.3, 0.0), (1.2, -30.0)])
def test_mean_variance_and_spectrum_are_the_models(alpha: float, f: float) -> None:
    n, series = 2048, 16
    Q, R = 1 / H ** (2 * alpha), 0.3
    y = np.array(
        [FractionalNoise(alpha, f, Q, R, H, 2 * n, seed, warmup=n).samples(n)[0] for seed in range(series)]
    )
    omega = 2 * np.pi * np.arange(n // 2 + 1) / n
    # The three lowest ordinates of the periodogram are left out, since they contain leakage and depend on the
    # finite warm-up of the simulation.
    keep = slice(3, n // 2)
    ratio = (np.abs(np.fft.rfft(y)) ** 2 / n)[:, keep] / spectrum(omega[keep], alpha, f, Q, R)
    # The ratio of an ordinate to the spectrum has an exponential distribution with mean 1. So the mean over
    # 16 series x 1021 ordinates has a standard error of 0.8 %, and the mean over an eighth of the band has
    # one of 2.2 %. The tolerances are five standard errors.
    assert ratio.mean() == pytest.approx(1, abs=0.04)
    for band in np.array_split(ratio, 8, axis=1):
        assert band.mean() == pytest.approx(1, abs=0.11)
    if f:
        # The variance is the mean of the spectrum over all frequencies. The sum takes the spectrum at
        # midpoints between the lines of the transform, since it may be infinite at 0.
        fine = (np.arange(1 << 16) + 0.5) * np.pi / (1 << 16)
        assert y.var() == pytest.approx(spectrum(fine, alpha, f, Q, R).mean(), rel=0.08)
        assert y.mean() == pytest.approx(
            0, abs=5 * math.sqrt(spectrum(omega[:1], alpha, f, Q, R)[0] / y.size)
        )


def test_order_0_is_an_autoregression_and_order_1_its_alias() -> None:
    # Both are the autoregression x_k = φ x_(k-1) + ω_k. As a noise of order α = 0 it has f = φ. As a noise of
    # order α = 1 it has f = (φ - 1)/h, and is driven by ω/h.
    phi, n = 0.7, 4000
    y, x = FractionalNoise(0, phi, 1.0, 0.5, H, seed=3).samples(n)
    alias = FractionalNoise(1, (phi - 1) / H, 1 / H**2, 0.5, H, seed=3).samples(n)
    assert alias[1] == pytest.approx(x, rel=1e-9, abs=1e-9)
    assert alias[0] == pytest.approx(y, rel=1e-9, abs=1e-9)
    omega = x[1:] - phi * x[:-1]
    assert omega.var() == pytest.approx(1, abs=5 * math.sqrt(2 / n))
    assert np.corrcoef(omega[1:], omega[:-1])[0, 1] == pytest.approx(0, abs=5 / math.sqrt(n))
    assert (y - x).var() == pytest.approx(0.5, abs=5 * 0.5 * math.sqrt(2 / n))


def test_without_process_noise_it_is_white() -> None:
    y, x = FractionalNoise(0.3, -1.8, 0, 0.0235, H, seed=1).samples(4000)
    assert not x.any()
    assert y.var() == pytest.approx(0.0235, rel=0.12)


def test_a_driven_system_of_changing_order_worked_by_hand() -> None:
    # By hand: x_k = u_k - c_1 x_(k-1) - c_2 x_(k-2) …, with the input u_k = 1, period h = 1, f = 0 and no
    # noise. The weights c belong to the order of sample k. x_1 = 1. Sample 2 has order 2 (c = 1, -2, 1), so
    # x_2 = 1 + 2 x_1. Sample 3 has order 1/2 (c = 1, -1/2, -1/8), so x_3 = 1 + x_2/2 + x_1/8. With a window
    # of one sample, the last term is missing.
    for window, last in ((10, 1 + 1.5 + 0.125), (1, 1 + 1.5)):
        system = FractionalNoise([1, 2, 0.5], 0, 0, 0, 1.0, window)
        assert [system.step(1) for _ in range(3)] == [(x, x) for x in (1, 3, last)]
    # By hand, with period h = 1/4, order α = 1/2 and f = -1: x_k = h^α (f x_(k-1) + u_k) + x_(k-1)/2, where
    # h^α = 1/2. The inputs u = 4 and 2 give x_1 = (0 + 4)/2 = 2, and x_2 = (-2 + 2)/2 + 2/2 = 1.
    system = FractionalNoise(0.5, -1, 0, 0, 0.25, 10)
    assert [system.step(u)[1] for u in (4, 2)] == [2, 1]


def test_the_last_order_of_a_list_is_held() -> None:
    n = 50
    short = FractionalNoise([0.3], -1, 1, 0.1, H, seed=5)
    assert np.array_equal(short.samples(n), FractionalNoise(0.3, -1, 1, 0.1, H, seed=5).samples(n))


def test_equal_seeds_give_equal_samples() -> None:
    def noise(seed: int) -> np.ndarray:
        return np.array(FractionalNoise(0.3, -1.8, 1, 0.1, H, seed=seed, warmup=10).samples(100))

    assert np.array_equal(noise(1), noise(1))
    assert not np.array_equal(noise(1), noise(2))
    generator = np.random.default_rng(1)
    assert np.array_equal(
        FractionalNoise(0.3, -1.8, 1, 0.1, H, seed=generator, warmup=10).samples(100), noise(1)
    )


def test_warmup_starts_near_the_stationary_variance() -> None:
    alpha, f = 0.6, -1.0
    Q = 1 / H ** (2 * alpha)
    fine = (np.arange(1 << 16) + 0.5) * np.pi / (1 << 16)
    stationary = spectrum(fine, alpha, f, Q, 0).mean()

    def first(warmup: int) -> float:
        starts = [
            FractionalNoise(alpha, f, Q, 0, H, 500, seed, warmup=warmup).step()[1] for seed in range(300)
        ]
        return float(np.var(starts))

    # The variance of the first values of 300 runs has a relative standard error of 8 %.
    assert first(500) == pytest.approx(stationary, rel=0.3)
    assert first(0) < 0.7 * stationary


@pytest.mark.parametrize(
    ("alpha", "f", "expected"),
    [
        (0.3, 0, True),
        (0.5, 0, False),
        (0.7, 0, False),
        (0.3, -1.8, True),
        (0.3, 0.1, False),
        (1, -1 / H, True),
        (1, -2.01 / H, False),
        (1, -1.99 / H, True),
        (0, 0.9, True),
        (0, -0.9, True),
        (0, 1.1, False),
        (2, -1, False),
        (2.5, -1, False),
    ],
)
def test_the_rule_of_stationarity(alpha: float, f: float, expected: bool) -> None:
    assert bool(stationary(alpha, H**alpha * f)) is expected


def test_the_rule_of_stationarity_agrees_with_the_recursion() -> None:
    # The process is stationary if g = h^α f is above -2^α. Just inside of this limit, the impulse response
    # decays. Just outside, it grows.
    alpha = 0.6
    for factor, stable in ((0.97, True), (1.03, False)):
        f = -factor * 2**alpha / H**alpha
        assert bool(stationary(alpha, H**alpha * f)) is stable
        system = FractionalNoise(alpha, f, 0, 0, H, 1000)
        x = [system.step(u)[1] for u in [1.0] + [0.0] * 999]
        assert bool(abs(x[-1]) < abs(x[0])) is stable


def test_quantise_rounds_and_saturates() -> None:
    counts = quantise([0, 0.03, 0.1, -0.1, 1e6, -1e6, math.inf, -math.inf], 16.4, 2000)
    assert counts.dtype == np.int16
    assert counts.tolist() == [0, 0, 2, -2, 32767, -32768, 32767, -32768]
    assert quantise(300, 131, 250).tolist() == 32750


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"Q": -1}, "Q is a variance"),
        ({"R": math.nan}, "R is a variance"),
        ({"h": 0}, "h must be > 0"),
        ({"f": math.inf}, "f must be"),
        ({"alpha": math.nan}, "alpha must be"),
        ({"alpha": []}, "alpha must be"),
        ({"window": 0}, "window must be at least 1"),
        ({"warmup": -1}, "warmup"),
    ],
)
def test_wrong_arguments_are_named(change: dict, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        FractionalNoise(**({"alpha": 0.3, "f": -1, "Q": 1, "R": 1, "h": H} | change))


def test_wrong_inputs_of_the_helpers_are_named() -> None:
    with pytest.raises(ValueError, match="NaN"):
        quantise([math.nan], 16.4, 2000)
    with pytest.raises(ValueError, match="lsb_per_dps"):
        quantise([0], 0, 2000)
    with pytest.raises(ValueError, match="full_scale_dps"):
        quantise([0], 16.4, -1)
