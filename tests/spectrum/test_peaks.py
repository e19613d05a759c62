"""Spectral lines and resonances are found where they exist, and nowhere else, in files and in live data."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from fltea import _native
from fltea.records.arrays import Array
from fltea.spectrum.ordinates import around
from fltea.spectrum.periodogram import Periodogram, periodogram
from fltea.spectrum.spectral import _above_slow_lines
from fltea.spectrum.spectral_lines import Peak, find_peaks
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import butter, lfilter

from tests.rig.identify_support import H, ar, long_recursion, white
from tests.rig.numpy_octaves import fed
from tests.rig.peak_oracle import strongest
from tests.rig.tiers import slow

N = 60_000


class Search(NamedTuple):
    """Finds the peaks of a record. `seen`: function that computes the record's spectrum, as for a file or as
    in a live run.
    """

    seen: Callable[[Array], Periodogram]

    def __call__(self, y: Array) -> tuple[Peak, ...]:
        return find_peaks(self.seen(y))


def octave_lines(y: Array) -> Periodogram:
    return fed(y).periodogram(0, H)


FILE, LIVE = Search(lambda y: periodogram(y, H)), Search(octave_lines)
both = pytest.mark.parametrize("search", [FILE, LIVE], ids=["file", "live"])


OVERSAMPLED = 20


def low_passed(n: int, corner_hz: float, poles: int, seed: int) -> Array:
    """Return n samples, at 100 Hz, of white noise of density 1 that has passed a Butterworth filter."""
    b, a = butter(poles, 2 * corner_hz * H / OVERSAMPLED)
    rng = np.random.default_rng(seed)
    waves = rng.standard_normal((n + 200) * OVERSAMPLED) * np.sqrt(OVERSAMPLED)
    return np.asarray(lfilter(b, a, waves)[::OVERSAMPLED][-n:])


def averaged(n: int, count: int, seed: int) -> Array:
    """Return n samples of the moving average of white noise."""
    waves = np.random.default_rng(seed).standard_normal(n + count - 1)
    return np.convolve(waves, np.ones(count) / count, "valid")


def tone(hz: float, n: int) -> Array:
    return np.asarray(np.sin(2 * np.pi * hz * np.arange(n) * H + 1))


def resonance(radius: float, angle: float, n: int, seed: int) -> Array:
    return ar((2 * radius * np.cos(angle), -(radius**2)), n, 1, seed)[0]


# --- existing peaks are found ---

AT_JOINTS_OF_OCTAVES = (1.09, 2.16, 2.18, 4.33, 4.35, 8.68, 8.7, 17.3, 17.45)


@pytest.mark.parametrize(
    ("search", "n", "amplitude", "hz"),
    [(FILE, 6000, 0.4, hz) for hz in (3.3, 13.37, 31.4, 45.0)]
    + [(LIVE, N, 0.25, hz) for hz in (0.7, *AT_JOINTS_OF_OCTAVES, 31.4, 44.0, 46.5, 47.8)],
)
def test_a_line_is_found_and_left_out(search: Search, n: int, amplitude: float, hz: float) -> None:
    seen = search.seen(white(n, 1, 4)[0] + amplitude * tone(hz, n))
    (peak,) = find_peaks(seen)
    resolution_hz = 1 / (n * H) if search is FILE else max(0.12, 0.01 * hz)
    assert peak.frequency_hz == pytest.approx(hz, abs=resolution_hz)
    # At the boundary between two octaves, each octave shows only half of the power of a spectral line.
    share = amplitude**2 / 2
    assert peak.power_share == pytest.approx(share / (1 + share), rel=0.25 if search is FILE else 0.6)
    assert peak.kind == "line" or search is LIVE
    low_hz, high_hz = peak.notch_hz
    assert low_hz < hz < high_hz < low_hz + 2
    assert find_peaks(seen.without(0, [peak.notch_hz])) == ()


@both
@pytest.mark.parametrize(("n", "amplitude"), [(3000, 1.0), (N, 0.4)])
@pytest.mark.parametrize("periods", [10, 12.5, 20, 30.5])
def test_a_slow_line(search: Search, n: int, amplitude: float, periods: float) -> None:
    hz = periods / (n * H)
    (peak,) = search(white(n, 1, 1)[0] + amplitude * tone(hz, n))
    assert peak.kind == "line"
    assert peak.frequency_hz == pytest.approx(hz, abs=1.01 / (n * H))
    assert peak.notch_hz[0] < hz < peak.notch_hz[1]


@both
@pytest.mark.parametrize(("n", "amplitude"), [(3000, 1.0), (N, 0.4)])
@pytest.mark.parametrize("hz", [49.6, 49.95, 49.98])
def test_a_line_at_nyquist(search: Search, n: int, amplitude: float, hz: float) -> None:
    """A spectral line near the Nyquist frequency of 50 Hz is found. The live spectrum has frequencies every
    0.39 Hz, the last at 49.6 Hz.
    """
    (peak,) = search(white(n, 1, 2)[0] + amplitude * tone(hz, n))
    assert peak.kind in ("line", "peak")
    assert peak.frequency_hz == pytest.approx(hz, abs=0.4 if n > 3072 and search is LIVE else 0.05)


@both
def test_a_slow_line_on_a_random_walk(search: Search) -> None:
    y = white(N, 1, 4)[0] + 0.003 * np.cumsum(white(N, 1, 3)[0])
    assert search(y) == ()
    (peak,) = search(y + 0.6 * tone(20 / (N * H), N))
    assert peak.frequency_hz == pytest.approx(20 / (N * H), abs=1 / (N * H))


@both
def test_several_are_found_strongest_first(search: Search) -> None:
    found = search(white(N, 1, 5)[0] + 0.3 * tone(12, N) + 0.9 * tone(30, N))
    assert [round(peak.frequency_hz) for peak in found] == [30, 12]


def test_a_tone_without_any_noise() -> None:
    (peak, *_) = FILE(np.sin(2 * np.pi * 0.1 * np.arange(2000)))
    assert peak.frequency_hz == pytest.approx(10)


@both
def test_a_line_among_side_lobes(search: Search) -> None:
    (peak,) = search(averaged(N, 8, 1) + 0.1 * tone(33.3, N))
    assert peak.frequency_hz == pytest.approx(33.3, abs=0.2)
    assert peak.kind in ("line", "peak")
    assert peak.notch_hz[0] < 33.3 < peak.notch_hz[1]


@both
def test_a_resonance_is_found_with_its_width(search: Search) -> None:
    radius, angle = 0.97, 1.97
    x = resonance(radius, angle, N, 5)
    peak = search(x / x.std() * 0.5 + white(N, 1, 6)[0])[0]
    assert peak.kind == "resonance"
    assert peak.frequency_hz == pytest.approx(angle / (2 * np.pi * H), abs=0.4)
    width_hz = 2 * (1 - radius) / (2 * np.pi * H)
    assert peak.width_hz == pytest.approx(width_hz, abs=0.4 if search is FILE else 2 * 0.39)
    assert peak.power_share == pytest.approx(0.2, abs=0.05)
    assert peak.notch_hz[0] < peak.frequency_hz - peak.width_hz
    assert peak.notch_hz[1] > peak.frequency_hz + peak.width_hz


@both
@pytest.mark.parametrize("n", [3000, slow(N)])
def test_a_resonance_above_slow_noise_stays_one(search: Search, n: int) -> None:
    """The minimum between the resonance and the slow noise is the noise floor, not a notch of a filter."""
    for seed in range(3):
        y = 0.4 * resonance(0.95, 2.0, n, seed) + white(n, 1, seed + 10)[0]
        y += 3 * ar((0.99,), n, 1, seed + 20)[0]
        (peak,) = (peak for peak in search(y) if peak.kind == "resonance")
        assert peak.frequency_hz == pytest.approx(2.0 / (2 * np.pi * H), abs=1)


# --- no peak is found where there is none ---

NOISES: dict[str, Callable[[int, int], Array]] = {
    "white": lambda n, series: white(n, series, 3),
    "t4": lambda n, series: np.random.default_rng(n).standard_t(4, (series, n)),
    "one LSB": lambda n, series: np.rint(white(n, series, 3)),
    "walk": lambda n, series: white(n, series, 1) + 0.05 * np.cumsum(white(n, series, 2), axis=1),
    "ramp": lambda n, series: white(n, series, 4) + np.linspace(0, 3, n),
    "AR(.99)": lambda n, series: ar((0.99,), n, series, 5),
    "AR(.9)": lambda n, series: ar((0.9,), n, series, 2),
    "AR(-.9)": lambda n, series: ar((-0.9,), n, series, 6),
    "fractional": lambda n, series: np.array([long_recursion(0.6, -0.19, n, i) for i in range(series)]),
}


@both
@pytest.mark.parametrize(("n", "series", "most"), [(3000, 100, 4), (20_000, 20, 1)])
@pytest.mark.parametrize("noise", NOISES)
def test_noise_has_no_peaks(search: Search, noise: str, n: int, series: int, most: int) -> None:
    """The rate of false alarms is 1 %, even for spectra that are steep at the ends of the band."""
    assert sum(bool(search(y)) for y in NOISES[noise](n, series)) <= most


@both
@pytest.mark.parametrize("phi", [-0.5, -0.8, -0.9])
def test_a_spectrum_that_rises_to_nyquist_has_no_peak(search: Search, phi: float) -> None:
    """A spectrum that rises up to the Nyquist frequency has no peak, even where the live spectrum is too
    coarse to resolve the rise.
    """
    assert sum(bool(search(y)) for n in (20_000, N) for y in ar((phi,), n, 6, 7)) <= 1


FILTERED: dict[str, Callable[[int], Array]] = {
    **{f"low-pass of {hz} Hz": lambda n, hz=hz: low_passed(n, hz, 2, 1) for hz in (5, 20, 41)},
    **{f"mean of {taps}": lambda n, taps=taps: averaged(n, taps, 2) for taps in (2, 3, 4, 5, 8, 16, 20)},
}


@both
@pytest.mark.parametrize("n", [3000, N])
@pytest.mark.parametrize("noise", FILTERED)
def test_a_filter_has_no_peaks_nor_are_its_side_lobes_resonances(search: Search, n: int, noise: str) -> None:
    assert search(FILTERED[noise](n)) == ()


# --- the band around peaks ---


def test_bands_are_widened_by_the_lobes_of_averaged_lines() -> None:
    p = octave_lines(white(N, 1, 6)[0])
    slow, fast = around(p, ((0.5, 0.6), (30.0, 30.1)))
    assert slow == pytest.approx((0.5, 0.6))
    assert fast == pytest.approx((30 - 0.59, 30.1 + 0.59), abs=0.02)
    assert around(p._replace(weight=None), ((1.0, 2.0),)) == ((1.0, 2.0),)


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
    """A spectral line is left out by a notch. If the notch begins below four times the lowest fitted
    frequency, the line is slow, and leaks into the fitted band.

    The band then begins above the notch, at a distance of three times the notch's width.
    """
    assert _above_slow_lines((Peak(kind, 0.3, 0.1, 0.5, 9.0, notch_hz),), 0.125) == from_hz


# --- the native search ---


@given(
    seed=st.integers(0, 1 << 32),
    single=st.integers(0, 60),
    octaves=st.integers(0, 4),
    heights=st.lists(st.floats(0.5, 4), max_size=4),
    slope=st.sampled_from([-2.0, 0.0, 1.5]),
    false_alarm=st.floats(1e-9, 0.9),
)
def test_the_strongest_is_found_as_it_is_defined(
    seed: int, single: int, octaves: int, heights: list[float], slope: float, false_alarm: float
) -> None:
    # The spectrum consists of single values of the periodogram, followed by octaves. Each value in an octave
    # is the mean of twice as many values of the periodogram as in the octave before.
    rng = np.random.default_rng(seed)
    weight = np.concatenate([np.ones(single), *(np.full(40, 1.7 * 2**k) for k in range(octaves))])
    power = rng.gamma(weight, 1 / weight) * np.linspace(0.1, 1, len(weight)) ** slope
    for height in heights if len(weight) else []:
        at, width = rng.integers(len(weight)), rng.integers(1, 12)
        power[at : at + width] *= 10**height
    found = _native.strongest_octave_peak(power, weight, false_alarm)
    expected = strongest(power, weight, false_alarm) if len(weight) else None
    assert (found is None) == (expected is None)
    if found is not None and expected is not None:
        assert found == (*expected[:2], pytest.approx(expected[2], rel=1e-12))


def test_the_native_search_refuses_what_are_no_lines() -> None:
    one = np.ones(3)
    with pytest.raises(ValueError, match="a power and a weight"):
        _native.strongest_octave_peak(one, one[:2], 0.1)
    for false_alarm in (0.0, 1.0, float("nan")):
        with pytest.raises(ValueError, match="between 0 and 1"):
            _native.strongest_octave_peak(one, one, false_alarm)


@both
@pytest.mark.filterwarnings("error")
def test_counts_that_repeat_exactly_have_lines_without_a_word_of_numpy(search: Search) -> None:
    """A record whose counts repeat exactly has spectral lines without any noise around them.

    numpy must not print a warning for such a record.
    """
    counts = np.rint(40 * np.sin(2 * np.pi * 5 * np.arange(N) * H))
    found = search(counts)
    assert min(abs(peak.frequency_hz - 5.0) for peak in found) < 0.02
    assert all(peak.height > 1 for peak in found)
