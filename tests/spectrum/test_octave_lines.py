"""Peaks among the lines of octaves: found wherever they stand, and none where there are none."""

import numpy as np
import pytest
from fltea.spectrum.octave_lines import around, find_octave_peaks
from fltea.spectrum.octaves import Octaves
from fltea.spectrum.periodogram import Periodogram
from identify_support import Array, H, ar, white

N = 60_000


def lines(y: Array) -> Periodogram:
    sums = Octaves(1)
    sums.add(np.ascontiguousarray(y[:, np.newaxis]))
    return sums.periodogram(0, H)


@pytest.mark.parametrize(
    "hz", [0.7, 1.09, 2.16, 2.18, 4.33, 4.35, 8.68, 8.7, 17.3, 17.45, 31.4, 44.0, 46.5, 47.8]
)
def test_a_line_is_found_and_left_out(hz: float) -> None:
    """Also at both edges of the joints of octaves, and near Nyquist's frequency."""
    y = white(N, 1, 1)[0]
    p = lines(y + 0.25 * np.sin(2 * np.pi * hz * np.arange(N) * H))
    (peak,) = find_octave_peaks(p)
    assert peak.frequency_hz == pytest.approx(hz, abs=max(0.12, 0.01 * hz))
    assert peak.notch_hz[0] < hz < peak.notch_hz[1]
    assert peak.power_share == pytest.approx(0.03, rel=0.6)  # half of one at a joint
    rest = p.without(0, [peak.notch_hz])
    assert len(rest.lam) < len(p.lam)
    assert find_octave_peaks(rest) == ()


@pytest.mark.parametrize("n", [3000, 20_000])
@pytest.mark.parametrize("noise", ["gauss", "t4", "lsb"])
def test_white_noise_has_none(n: int, noise: str) -> None:
    """At a rate of false alarms of 1 %, of 60 series."""
    rng = np.random.default_rng(n)
    make = {
        "gauss": lambda: rng.standard_normal(n),
        "t4": lambda: rng.standard_t(4, n),
        "lsb": lambda: np.rint(rng.standard_normal(n)),
    }[noise]
    assert sum(bool(find_octave_peaks(lines(make()))) for _ in range(60)) <= 3


def test_slopes_have_none() -> None:
    for seed in range(10):
        assert find_octave_peaks(lines(ar((0.98,), 20_000, 1, seed)[0])) == ()
        assert find_octave_peaks(lines(np.cumsum(white(20_000, 1, seed)[0]))) == ()


def test_a_resonance_is_no_line() -> None:
    y = ar((2 * 0.92 * np.cos(1.3), -(0.92**2)), N, 1, 3)[0] / 4 + white(N, 1, 4)[0]
    peak = find_octave_peaks(lines(y))[0]
    assert peak.kind == "resonance"
    assert peak.frequency_hz == pytest.approx(1.3 / (2 * np.pi * H), abs=0.5)


def test_several_are_found_strongest_first() -> None:
    t = np.arange(N) * H
    y = white(N, 1, 5)[0] + 0.3 * np.sin(2 * np.pi * 12 * t) + 0.9 * np.sin(2 * np.pi * 30 * t)
    found = find_octave_peaks(lines(y))
    assert [round(peak.frequency_hz) for peak in found] == [30, 12]


def test_bands_are_widened_by_the_lobes_of_averaged_lines() -> None:
    p = lines(white(N, 1, 6)[0])
    slow, fast = around(p, ((0.5, 0.6), (30.0, 30.1)))
    assert slow == pytest.approx((0.5, 0.6))
    assert fast == pytest.approx((30 - 0.59, 30.1 + 0.59), abs=0.02)
    assert around(p._replace(weight=None), ((1.0, 2.0),)) == ((1.0, 2.0),)
