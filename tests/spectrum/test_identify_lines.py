"""Lines and resonances: found where they are, and not where there are none."""

import numpy as np
import pytest
from fltea.spectrum.lines import Peak, f_log_tail, find_peaks
from fltea.spectrum.periodogram import periodogram
from fltea.spectrum.spectral import _above_slow_lines
from hypothesis import given
from hypothesis import strategies as st
from identify_support import H, ar, long_recursion, white


@pytest.mark.parametrize("m", [1, 4, 64])
def test_tail_by_counting(m: int) -> None:
    rng = np.random.default_rng(m)
    ratio = rng.gamma(m, size=100_000) / m / (rng.gamma(48, size=100_000) / 48)
    for x in (0.8, 1.2, 1.6):
        assert np.exp(f_log_tail(m, 48, x)) == pytest.approx((ratio > x).mean(), abs=0.006)
    assert f_log_tail(1, 48, 3.0) == pytest.approx(-48 * np.log(1 + 3 / 48))
    assert f_log_tail(1, 48, 1e9) == pytest.approx(-48 * np.log1p(1e9 / 48))


@given(st.integers(1, 3000), st.sampled_from([48, 500, 6000]), st.floats(0, 50), st.floats(0, 5))
def test_tail_falls(m: int, k: int, ratio: float, more: float) -> None:
    assert f_log_tail(m, k, ratio + more) <= f_log_tail(m, k, ratio) + 1e-9 <= 1e-9


@pytest.mark.parametrize("kind", ["white", "AR(.9)", "AR(-.8)", "fractional"])
def test_no_false_alarms(kind: str) -> None:
    y = {
        "white": lambda: white(3000, 60, 1),
        "AR(.9)": lambda: ar((0.9,), 3000, 60, 2),
        "AR(-.8)": lambda: ar((-0.8,), 3000, 60, 2),
        "fractional": lambda: [long_recursion(0.6, -0.19, 3000, seed) for seed in range(60)],
    }[kind]()
    assert sum(bool(find_peaks(periodogram(series, H))) for series in y) <= 2


@pytest.mark.parametrize("hz", [3.3, 13.37, 31.4, 45.0])
def test_a_line_is_found(hz: float) -> None:
    n = 6000
    y = white(n, 1, 4)[0] + 0.4 * np.sin(2 * np.pi * hz * np.arange(n) * H + 1)
    (peak,) = find_peaks(periodogram(y, H))
    assert peak.kind == "line"
    assert peak.frequency_hz == pytest.approx(hz, abs=1 / (n * H))
    assert peak.power_share == pytest.approx(0.08 / 1.08, rel=0.25)
    assert peak.notch_hz[0] < hz < peak.notch_hz[1]
    assert peak.notch_hz[1] - peak.notch_hz[0] < 2


def test_two_lines_are_found_and_then_none() -> None:
    n, t = 6000, np.arange(6000) * H
    y = white(n, 1, 4)[0] + np.sin(2 * np.pi * 11.1 * t) + 0.4 * np.sin(2 * np.pi * 37.7 * t)
    first, second = find_peaks(periodogram(y, H))
    assert (round(first.frequency_hz, 1), round(second.frequency_hz, 1)) == (11.1, 37.7)
    assert not find_peaks(periodogram(y, H, notch=[first.notch_hz, second.notch_hz]))


def test_a_tone_without_any_noise() -> None:
    (peak, *_) = find_peaks(periodogram(np.sin(2 * np.pi * 0.1 * np.arange(2000)), H))
    assert peak.frequency_hz == pytest.approx(10)


def test_a_resonance_is_found_with_its_width() -> None:
    r, angle = 0.97, 1.97
    x = ar((2 * r * np.cos(angle), -(r**2)), 60_000, 1, 5)[0]
    y = x / x.std() * 0.5 + white(60_000, 1, 6)[0]
    peak = find_peaks(periodogram(y, H))[0]
    assert peak.kind == "resonance"
    assert peak.frequency_hz == pytest.approx(angle / (2 * np.pi * H), abs=0.4)
    assert peak.width_hz == pytest.approx(2 * (1 - r) / (2 * np.pi * H), rel=0.4)
    assert peak.power_share == pytest.approx(0.2, abs=0.05)
    assert peak.notch_hz[0] < peak.frequency_hz - peak.width_hz
    assert peak.notch_hz[1] > peak.frequency_hz + peak.width_hz


@pytest.mark.parametrize(
    ("kind", "notch_hz", "from_hz"),
    [
        ("line", (0.25, 0.5), 1.25),
        ("peak", (0.25, 0.5), 1.25),
        ("resonance", (0.25, 0.5), 0.125),
        ("line", (0.5, 0.75), 0.125),
        ("line", (0.0, 0.03125), 0.125),
    ],
)
def test_the_band_begins_beyond_what_leaks_from_a_slow_line(
    kind: str, notch_hz: tuple[float, float], from_hz: float
) -> None:
    """Three widths of it, where a line is below four times the band's lowest frequency."""
    assert _above_slow_lines((Peak(kind, 0.3, 0.1, 0.5, 9.0, notch_hz),), 0.125) == from_hz
