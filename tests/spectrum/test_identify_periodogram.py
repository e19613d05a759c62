"""The periodogram: its scale, its ordinates, and its bins."""

import numpy as np
import pytest
from fltea.spectrum.periodogram import FEWEST, Periodogram, binned, periodogram
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.identify_support import H, white


def test_scale_and_ordinates() -> None:
    """If a cosine of n samples has the frequency of ordinate j of the periodogram, its periodogram is n/4
    times the squared amplitude there, and 0 elsewhere.
    """
    n, j = 1000, 123
    p = periodogram(5 + 2 * np.cos(2 * np.pi * j * np.arange(n) / n), H)
    # ordinates 4 to 499: all but the three lowest and the one at the Nyquist frequency
    assert len(p.lam) == 496
    assert p.lam[0] == pytest.approx(2 * np.pi * 4 / n)
    assert p.lam[-1] == pytest.approx(2 * np.pi * 499 / n)
    assert p.power[j - 4] == pytest.approx(4 * n / 4)
    assert np.delete(p.power, j - 4).max() < 1e-20 * n


def test_mean_power_of_white_noise_is_its_variance() -> None:
    assert periodogram(3 * white(999, 40, 1), H).power.mean() == pytest.approx(9, rel=0.03)


def test_masks() -> None:
    p = periodogram(white(4000, 1, 1)[0], H, from_hz=1.0, notch=[(10, 12), (30, 60)])
    hz = p.lam / (2 * np.pi * H)
    assert hz.min() >= 1
    assert not ((hz >= 10) & (hz <= 12)).any()
    assert hz.max() < 30
    assert ((hz > 12) & (hz < 30)).sum() == pytest.approx(18 * 40, abs=2)


@given(st.integers(2 * FEWEST + 10, 20_000), st.floats(0, 5))
def test_bins_keep_the_whole(n: int, from_hz: float) -> None:
    """Every ordinate of the periodogram is in exactly one bin, so sums over the bins equal sums over the
    ordinates.
    """
    lam = 2 * np.pi * np.arange(4, (n - 1) // 2 + 1) / n
    keep = lam / (2 * np.pi * H) >= from_hz
    lam = lam[keep]
    power = np.random.default_rng(n).exponential(size=len(lam))
    b = binned(Periodogram(lam, power, H, n))
    assert b.ordinates == len(lam)
    assert (b.counts >= 1).all()
    assert b.power[0] @ b.counts == pytest.approx(power.sum())
    assert b.lam @ b.counts == pytest.approx(lam.sum())
    assert (np.diff(b.lam) > 0).all()


def test_bins_are_few_and_narrow() -> None:
    lam = 2 * np.pi * np.arange(4, 32_500) / 65_000
    b = binned(Periodogram(lam, np.ones(len(lam)), H, 65_000))
    assert len(b.lam) < 350
    step = 2 * np.pi / 65_000
    assert (b.counts * step <= 0.03 * b.lam + step).all()
    assert (b.counts[:25] == 1).all()


@pytest.mark.parametrize(
    ("y", "h", "message"),
    [
        (np.arange(20.0), H, "are needed: record longer"),
        (np.ones(500), H, "constant"),
        (np.full(500, np.nan), H, "finite"),
        (np.zeros((2, 2, 500)), H, "shape"),
        (np.arange(500.0), 0.0, "sampling period"),
    ],
)
def test_refuses(y: np.ndarray, h: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        periodogram(y, h)
