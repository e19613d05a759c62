"""Lines at both ends of the band, and filters whose corners and side lobes are none: in files and live."""

from collections.abc import Callable

import numpy as np
import pytest
from fltea.spectrum.lines import Peak, find_peaks
from fltea.spectrum.octave_lines import find_octave_peaks
from fltea.spectrum.octaves import Octaves
from fltea.spectrum.periodogram import periodogram
from fltea.spectrum.side_lobes import lines_among_lobes, notch_below
from identify_support import Array, H, ar, white


def in_file(y: Array) -> tuple[Peak, ...]:
    return find_peaks(periodogram(y, H))


def live(y: Array) -> tuple[Peak, ...]:
    sums = Octaves(1)
    sums.add(np.ascontiguousarray(y[:, np.newaxis]))
    return find_octave_peaks(sums.periodogram(0, H))


Search = Callable[[Array], tuple[Peak, ...]]
both = pytest.mark.parametrize("search", [in_file, live])


def tone(hz: float, n: int) -> Array:
    return np.asarray(np.sin(2 * np.pi * hz * np.arange(n) * H + 1))


@both
@pytest.mark.parametrize(("n", "amplitude"), [(3000, 1.0), (60_000, 0.4)])
@pytest.mark.parametrize("periods", [10, 12.5, 20, 30.5])
def test_a_slow_line(search: Search, n: int, amplitude: float, periods: float) -> None:
    hz = periods / (n * H)
    (peak,) = search(white(n, 1, 1)[0] + amplitude * tone(hz, n))
    assert peak.kind == "line"
    assert peak.frequency_hz == pytest.approx(hz, abs=1.01 / (n * H))
    assert peak.notch_hz[0] < hz < peak.notch_hz[1]


@both
@pytest.mark.parametrize(("n", "amplitude"), [(3000, 1.0), (60_000, 0.4)])
@pytest.mark.parametrize("hz", [49.6, 49.95, 49.98])
def test_a_line_at_nyquist(search: Search, n: int, amplitude: float, hz: float) -> None:
    """A block of the live fit has lines at every 0.39 Hz, the last at 49.6."""
    (peak,) = search(white(n, 1, 2)[0] + amplitude * tone(hz, n))
    assert peak.kind in ("line", "peak")
    assert peak.frequency_hz == pytest.approx(hz, abs=0.4 if n > 3072 and search is live else 0.05)


@both
def test_a_slow_line_on_a_random_walk(search: Search) -> None:
    n = 60_000
    walk = 0.003 * np.cumsum(white(n, 1, 3)[0])
    assert search(white(n, 1, 4)[0] + walk) == ()
    (peak,) = search(white(n, 1, 4)[0] + walk + 0.6 * tone(20 / (n * H), n))
    assert peak.frequency_hz == pytest.approx(20 / (n * H), abs=1 / (n * H))


def walks(n: int, series: int) -> Array:
    return white(n, series, 1) + 0.05 * np.cumsum(white(n, series, 2), axis=1)


NOISES: dict[str, Callable[[int, int], Array]] = {
    "white": lambda n, series: white(n, series, 3),
    "walk": walks,
    "ramp": lambda n, series: white(n, series, 4) + np.linspace(0, 3, n),
    "AR(.99)": lambda n, series: ar((0.99,), n, series, 5),
    "AR(-.9)": lambda n, series: ar((-0.9,), n, series, 6),
}


@both
@pytest.mark.parametrize("noise", NOISES)
def test_slopes_at_the_ends_are_no_lines(search: Search, noise: str) -> None:
    """At a rate of false alarms of 1 %, of 100 series."""
    assert sum(bool(search(y)) for y in NOISES[noise](3000, 100)) <= 4


@both
@pytest.mark.parametrize("phi", [-0.5, -0.8, -0.9])
def test_a_spectrum_that_rises_to_nyquist_has_no_peak(search: Search, phi: float) -> None:
    """Also where a line of the live fit is as wide as what the spectrum changes over."""
    assert sum(bool(search(y)) for n in (20_000, 60_000) for y in ar((phi,), n, 6, 7)) <= 1


def butterworth(hz: float, n: int, seed: int) -> Array:
    """White noise through two poles, by the bilinear transform."""
    c = 1 / np.tan(np.pi * hz * H)
    b0 = 1 / (1 + 2**0.5 * c + c * c)
    phi = (2 * (c * c - 1) * b0, -(1 - 2**0.5 * c + c * c) * b0)
    x = white(n + 1002, 1, seed)[0]
    x = b0 * (x[2:] + 2 * x[1:-1] + x[:-2])
    y = np.zeros(len(x) + 2)
    for k in range(len(x)):
        y[k + 2] = x[k] + phi[0] * y[k + 1] + phi[1] * y[k]
    return y[-n:]


@both
@pytest.mark.parametrize("n", [3000, 60_000])
@pytest.mark.parametrize("hz", [5, 20, 41])
def test_a_low_pass_has_no_peak(search: Search, n: int, hz: float) -> None:
    assert search(butterworth(hz, n, 1)) == ()


def averaged(taps: int, n: int, seed: int) -> Array:
    return np.convolve(white(n + taps - 1, 1, seed)[0], np.ones(taps) / taps, "valid")


@both
@pytest.mark.parametrize("n", [3000, 60_000])
@pytest.mark.parametrize("taps", [2, 3, 4, 5, 8, 16, 20])
def test_side_lobes_are_no_resonances(search: Search, n: int, taps: int) -> None:
    assert search(averaged(taps, n, 2)) == ()


@both
def test_a_line_among_side_lobes(search: Search) -> None:
    n = 60_000
    (peak,) = search(averaged(8, n, 1) + 0.1 * tone(33.3, n))
    assert peak.frequency_hz == pytest.approx(33.3, abs=0.2)
    assert peak.kind in ("line", "peak")
    assert peak.notch_hz[0] < 33.3 < peak.notch_hz[1]


@both
@pytest.mark.parametrize("n", [3000, 60_000])
def test_a_resonance_above_slow_noise_stays_one(search: Search, n: int) -> None:
    """Between the two lies a floor, which is no notch."""
    r, angle = 0.95, 2.0
    for seed in range(3):
        y = 0.4 * ar((2 * r * np.cos(angle), -(r**2)), n, 1, seed)[0] + white(n, 1, seed + 10)[0]
        y += 3 * ar((0.99,), n, 1, seed + 20)[0]
        (peak,) = (peak for peak in search(y) if peak.kind == "resonance")
        assert peak.frequency_hz == pytest.approx(angle / (2 * np.pi * H), abs=1)


def test_what_a_notch_is() -> None:
    lam = np.linspace(0.01, 3.1, 1000)
    lobes = np.sin(4 * lam) ** 2 / np.sin(lam / 2) ** 2
    top = int(np.argmin(np.abs(lam - 1.18)))
    edge = notch_below(lam, lobes, top - 20, top + 20, 9)
    assert edge is not None
    assert 0.4 < edge < 0.79
    hump = 1 / (1 + ((lam - 1.18) / 0.05) ** 2) + 1e-3
    assert notch_below(lam, hump, top - 20, top + 20, 9) is None
    assert notch_below(lam, hump + 0.05 / lam**2 * (lam < 0.3), top - 20, top + 20, 9) is None


def test_what_stands_out_from_lobes() -> None:
    power = np.sin(np.linspace(0, 20, 960)) ** 2
    assert lines_among_lobes(power, 48) == []
    power[400:402] = 90
    ((start, stop, level),) = lines_among_lobes(power, 48)
    assert (start, stop) == (400, 402)
    assert level == pytest.approx(1 / np.log(2), rel=0.1)
