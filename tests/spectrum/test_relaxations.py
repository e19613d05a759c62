"""Sums of relaxations and other families beside them: coordinates, fits, and when they are told apart."""

import numpy as np
import pytest
from filtered_noise import fractionally_integrated, relaxations
from fltea.identification.sums import examined
from fltea.spectrum.arfima import ARFIMA, arfima_parameters
from fltea.spectrum.drift import SlowPower, drift_hz
from fltea.spectrum.how_long import seconds_to_tell
from fltea.spectrum.periodogram import binned, periodogram
from fltea.spectrum.relaxations import MOST, corner_hz, grown, sum_coordinates, sum_of, sum_parameters
from fltea.spectrum.rising import RISING, rising_parameters
from fltea.spectrum.rivals import fit_all
from fltea.spectrum.verdict import decide
from fltea.spectrum.whittle import fit
from hypothesis import given
from hypothesis import strategies as st
from identify_support import H, white
from scipy.signal import lfilter


@given(st.integers(1, MOST), st.integers(0, 1000))
def test_coordinates_and_back(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    poles, shares = rng.uniform(-0.9, 0.999, count), rng.uniform(0.01, 1, count)
    white_share = rng.uniform(0.01, 1)
    found = sum_parameters(sum_coordinates(poles, shares, np.array(white_share)), count)
    np.testing.assert_allclose(found.poles, poles, atol=1e-5)
    np.testing.assert_allclose(found.shares, shares / (shares.sum() + white_share), rtol=1e-5)
    assert found.shares.sum() + found.white == pytest.approx(1)


def test_so_many_at_most() -> None:
    for count in (0, MOST + 1):
        with pytest.raises(ValueError, match="1 to 6"):
            sum_of(count)


def test_four_are_found_one_after_the_other() -> None:
    corners = (0.02, 0.3, 3.0, 20.0)
    data = binned(periodogram(relaxations(400_000, corners, 1, 1.0), H))
    found = fit(data, sum_of(1))
    for count in (1, 2, 3):
        more = fit(data, sum_of(count + 1), grown(data, found, count))
        assert more.nll[0] < found.nll[0]
        found = more
    poles = np.sort(sum_parameters(found.theta, 4).poles[0])[::-1]
    np.testing.assert_allclose([corner_hz(phi, H) for phi in poles], corners, rtol=0.4)


def test_rising_and_arfima_are_found() -> None:
    n = 30_000
    data = binned(periodogram(fractionally_integrated(n, -0.3, 1), H))
    assert rising_parameters(fit(data, RISING).theta[0])[0] == pytest.approx(0.3, abs=0.03)
    y = lfilter([1], [1, -0.6], fractionally_integrated(n, 0.35, 2)) + white(n, 1, 3)[0]
    d, phi, _ = arfima_parameters(fit(binned(periodogram(y, H)), ARFIMA).theta[0])
    assert float(d) == pytest.approx(0.35, abs=0.06)
    assert float(phi) == pytest.approx(0.6, abs=0.08)


@pytest.mark.slow
def test_three_relaxations_are_never_called_fractional() -> None:
    """The usual picture of flicker in MEMS: 0.05, 0.5 and 5 Hz in white noise."""
    kinds = [
        decide(examined(relaxations(60_000, (0.05, 0.5, 5.0), seed), H).evidence).kind for seed in range(12)
    ]
    assert set(kinds) <= {"relaxations", "fractional or relaxations"}
    long = decide(examined(relaxations(1_080_000, (0.05, 0.5, 5.0), 1), H).evidence)
    assert long.kind == "relaxations"
    assert "a sum of three" in long.what.lower()


def test_flicker_is_never_denied() -> None:
    """Nor is it claimed: relaxations do as well, and the text says how many, and for how long to record."""
    for seed in range(4):
        y = 0.25 * fractionally_integrated(60_000, 0.499, seed) + white(60_000, 1, seed + 100)[0]
        verdict = decide(examined(y, H).evidence)
        assert verdict.kind == "fractional or relaxations"
        assert "record of" in verdict.next


def test_how_long_until_two_models_are_told_apart() -> None:
    """A record of that length tells them, and half of it does not."""
    y = relaxations(60_000, (0.3, 5.0), 3, 1.0)
    p = periodogram(y, H)
    fits = fit_all(p)
    needed = seconds_to_tell(fits.data, fits.order, fits.sums[1], 600.0, 6.0)
    assert needed is not None
    assert 600 <= needed < 86_400
    assert seconds_to_tell(fits.data, fits.order, fits.order, 600.0, 6.0) is None


def test_drift_follows_the_record() -> None:
    assert drift_hz(600, 60_000) == pytest.approx(1 / 60)
    assert drift_hz(10_800, 1_080_000) == pytest.approx(1 / 1080)
    assert drift_hz(1.4, 140) == pytest.approx(4 / 1.4)  # all that can be fitted is
    assert not SlowPower(0.1, 1.9, 1e-12).is_drift()
    assert SlowPower(0.1, 2.1, 5e-5).is_drift()
    assert not SlowPower(0.1, 2.1, 5e-5).is_drift(1e-5)
    assert SlowPower(0.1, 1.0, 1.0, 12.0, 1e-6).is_drift()
    assert not SlowPower(0.1, 1.0, 1.0, 12.0, 1e-6).is_drift(1e-8)
    assert not SlowPower(0.1, 1.0, 1.0, 9.0, 1e-9).is_drift()


@pytest.mark.slow
def test_slow_flicker_is_fitted_where_the_record_is_long_enough() -> None:
    """1/f below 0.03 Hz: three hours have two decades of it."""
    y = 0.043 * fractionally_integrated(1_080_000, 0.499, 5) + white(1_080_000, 1, 6)[0]
    e = examined(y, H).evidence
    assert e.from_hz == pytest.approx(1 / 1080)
    assert decide(e).kind == "fractional or relaxations"
    assert e.contest.order == pytest.approx(0.5, abs=0.1)
