"""Periodic events, whose spectrum is a comb, are found with their period, in files and in live data, and
excluded from all figures.
"""

from collections.abc import Callable

import numpy as np
import pytest
from fltea.identification.axis import analyse
from fltea.identification.data_checks import axis_data_checks
from fltea.identification.judges import held
from fltea.records.arrays import Array
from fltea.spectrum import comb_words
from fltea.spectrum.comb import find_comb
from fltea.spectrum.evidence import ANYTIME_LEVEL
from fltea.spectrum.octave_comb import find_octave_comb
from fltea.spectrum.periodogram import periodogram
from fltea.spectrum.spectral import examine
from fltea.spectrum.spectral_lines import Repeats
from fltea.spectrum.verdict import decide
from scipy.signal import butter, lfilter, sawtooth

from tests.rig.identify_support import H, ar, white
from tests.rig.numpy_octaves import fed
from tests.rig.tiers import slow_but

RATE_HZ = 1 / H


def glitches(n: int, period_s: float, samples: int, size: float, late: int = 0, seed: int = 1) -> Array:
    """Return n samples, which are 0 except for a glitch at the beginning of each period. A glitch has the
    value `size` and lasts as long as `samples` says.

    Each glitch is shifted at random by up to `late` samples.
    """
    rng = np.random.default_rng(seed + 100)
    at = np.floor(np.arange(7.3, n, period_s * RATE_HZ)).astype(int)
    at += rng.integers(-late, late + 1, len(at))
    y = np.zeros(n)
    for i in range(samples):
        y[at[at + i < n] + i] += size
    return y


def noisy(n: int, *what: float, seed: int = 1) -> Array:
    return white(n, 1, seed)[0] + glitches(n, *what, seed=seed)  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    "what", [(1.0, 1, 5.0), (0.37123, 1, 5.0), (1.0037, 3, 8.0), (2.0, 2, 4.0), (1.0, 1, 8.0, 1)]
)
def test_a_glitch_in_each_period_of_a_file(what: tuple[float, ...], seed: int) -> None:
    found = analyse(noisy(6000, *what, seed=seed), H)
    (peak,) = found.summed.seen.evidence.peaks
    assert found.verdict.kind == peak.kind == "comb"
    assert peak.repeats is not None
    assert peak.repeats.period_s == pytest.approx(what[0], rel=1e-3)
    assert peak.repeats.shape == "glitch"
    assert found.verdict.what.startswith("Something happens every ")
    N = found.figures.level.N
    assert N.value is not None
    # N/√h, the white noise's σ, is 1 ± 0.04 (4 standard errors); with the glitches, it would be 1.1 to 1.9
    assert N.value / H**0.5 == pytest.approx(1, abs=0.04)
    power = what[1] * what[2] ** 2 * H / what[0]
    assert peak.power_share == pytest.approx(power / (1 + power), rel=0.15)


@pytest.mark.parametrize("n", [3000, 20_000, 60_000])
def test_more_data_do_not_say_less(n: int) -> None:
    assert analyse(noisy(n, 1.0, 1, 5.0), H).verdict.kind == "comb"


@pytest.mark.parametrize("n", [3000, 20_000, 60_000])
@pytest.mark.parametrize("what", [(1.0, 1, 5.0), (0.37123, 2, 5.0)])
def test_live(n: int, what: tuple[float, ...]) -> None:
    lines = fed(noisy(n, *what)).periodogram(0, H)
    evidence = examine(lines, n * H, n, level=ANYTIME_LEVEL).evidence
    (peak,) = evidence.peaks
    assert peak.repeats is not None
    assert peak.repeats.period_s == pytest.approx(what[0], rel=5e-3)
    assert decide(evidence).kind == "comb"
    assert float(evidence.candidates.plain.spectrum(np.array([1.0]), H)[0]) == pytest.approx(1, abs=0.2)


def hum(n: int, seed: int) -> Array:
    """Return hum of 50 Hz with two harmonics, sampled at 400 Hz."""
    phase = 2 * np.pi * 50.02 / 400 * np.arange(n)
    return white(n, 1, seed)[0] + 0.5 * np.sin(phase) + 0.25 * np.sin(2 * phase) + 0.15 * np.sin(3 * phase)


def two_outliers(n: int, seed: int) -> Array:
    y = white(n, 1, seed)[0]
    y[[n // 3, n // 3 + n // 23]] += 100
    return y


def resonance(n: int, seed: int) -> Array:
    return ar((1.38, -0.98), n, 1, seed)[0] * 0.1 + white(n, 1, seed + 50)[0]


NO_COMB: dict[str, Callable[[int, int], Array]] = {
    "white": lambda n, seed: white(n, 1, seed)[0],
    "walk": lambda n, seed: white(n, 1, seed)[0] + 0.05 * np.cumsum(white(n, 1, seed + 50)[0]),
    "mean of 50": lambda n, seed: np.convolve(white(n + 49, 1, seed)[0], np.ones(50) / 50, "valid"),
    "low-pass": lambda n, seed: np.asarray(lfilter(*butter(2, 0.1), white(n, 1, seed)[0])),
    "hum": hum,
    "two outliers": two_outliers,
    "resonance": resonance,
}


@pytest.mark.parametrize("name", slow_but(["white", "low-pass", "two outliers"], NO_COMB))
def test_no_comb_where_there_is_none(name: str) -> None:
    for n, seeds in ((3000, 15), (20_000, 5)):
        for seed in range(seeds):
            y = NO_COMB[name](n, seed)
            assert all(peak.repeats is None for peak in analyse(y, H).summed.seen.evidence.peaks)
            assert find_octave_comb(fed(y).periodogram(0, H)) is None


def test_few_lines_are_no_comb_and_a_wave_is_one() -> None:
    """Mains hum with two harmonics is reported as spectral lines.

    A sawtooth has a dozen harmonics and is a comb, but no glitch.
    """
    assert analyse(hum(20_000, 3), 1 / 400).verdict.kind == "line"
    wave = 2 * sawtooth(2 * np.pi * np.arange(20_000) / 83.7)
    found = analyse(white(20_000, 1, 1)[0] + wave, H)
    peak = found.summed.seen.evidence.peaks[0]
    assert peak.repeats is not None
    assert peak.repeats.shape == "wave"
    assert peak.repeats.period_s == pytest.approx(0.837, rel=1e-3)
    assert found.verdict.kind == "comb"
    assert peak.power_share == pytest.approx(4 / 7, rel=0.05)


def test_beside_other_noise_it_is_said_too() -> None:
    slow = lfilter([0.2], [1, -0.95], white(20_000, 1, 9)[0])
    found = analyse(noisy(20_000, 1.0, 1, 6.0) + slow, H)
    assert found.verdict.kind in ("relaxations", "fractional or relaxations")
    assert "There is also something that happens every 1.00 s (a glitch of 10 ms" in found.verdict.text


def test_the_samples_are_not_those_of_the_glitches() -> None:
    y = noisy(20_000, 1.0, 1, 10.0)
    found = analyse(y, H)
    (stretch,) = found.stretches
    changed = np.flatnonzero(stretch.y != y)
    assert len(changed) / len(y) < 0.05
    assert set(np.flatnonzero(glitches(20_000, 1.0, 1, 10.0))) <= set(changed.tolist())
    kinds = {
        data_check.kind
        for data_check in axis_data_checks(stretch.y, H, peaks=found.summed.seen.evidence.peaks)
    }
    assert kinds == {"short", "comb"}


def test_a_period_is_not_a_multiple_of_it() -> None:
    for seed in range(5):
        comb = find_comb(periodogram(noisy(20_000, 0.37123, 1, 5.0, seed=seed), H))
        assert comb is not None
        assert comb.period == pytest.approx(37.123, rel=1e-3)


@pytest.mark.parametrize("period_s", [1.037, 0.4819, 0.555])
def test_a_period_that_is_no_number_of_samples_is_not_ten_periods(period_s: float) -> None:
    """The period is found, and not a multiple of it. It is no whole number of samples, but 55.5, for
    example. Events begin at whole samples, so their distances repeat only after several periods.
    """
    comb = find_comb(periodogram(noisy(60_000, period_s, 1, 5.0), H))
    assert comb is not None
    assert comb.period == pytest.approx(period_s / H, rel=1e-3)


@pytest.mark.parametrize(
    ("period_s", "said", "then"),
    [
        (1.0, "1.00 s", "GPS"),
        (12.34, "12.3 s", "logger"),
        (0.02, "20 ms", "mains"),
        (0.025, "25 ms", "radio"),
    ],
)
def test_words(period_s: float, said: str, then: str) -> None:
    repeats = Repeats(period_s, 7, "glitch", 0.002, 4.0)
    assert comb_words.happens(repeats, 0.1).startswith(f"Something happens every {said}: a glitch of 2 ms")
    assert then in comb_words.next_step(repeats)


# --- median filters ---


def median(y: Array, samples: int) -> Array:
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(y, samples), axis=1))


@pytest.mark.parametrize("step", [0.0, 0.05])
@pytest.mark.parametrize("samples", [3, 5, 7])
def test_a_median_filter_is_named(samples: int, step: float) -> None:
    y = median(white(20_000, 1, samples)[0], samples)
    y = np.rint(y / step) * step if step else y
    found = analyse(y, H)
    assert found.verdict.kind == "low-pass"
    assert f"White noise through a median filter of about {samples} samples." in found.verdict.what
    assert "resonance" not in found.verdict.text
    assert "median filter" in {data_check.kind for data_check in axis_data_checks(y, H)}
    assert held([y], [None], H) == (), "no sample was delivered twice"
    # The true density of the filter's output at low frequencies, from a long record. It is 8 to 14 % above
    # that of the filter's input.
    long = median(white(1_000_000, 1, 99)[0], samples)
    density = long[: len(long) // 1000 * 1000].reshape(-1, 1000).mean(axis=1).std() * 1000**0.5
    N = found.figures.level.N
    assert N.value is not None
    assert N.value / H**0.5 == pytest.approx(density, rel=0.08)


def replaced(y: Array, samples: int) -> Array:
    """Return the output of Hampel's filter, which replaces outliers by the median around them."""
    windows = np.lib.stride_tricks.sliding_window_view(y, samples)
    centre, middle = windows[:, samples // 2], np.median(windows, axis=1)
    scale = 1.4826 * np.median(np.abs(windows - middle[:, np.newaxis]), axis=1)
    return np.where(np.abs(centre - middle) > 3 * scale, middle, centre)


def test_hampels_filter_is_named() -> None:
    found = analyse(replaced(white(20_000, 1, 3)[0], 5), H)
    assert found.verdict.kind == "low-pass"
    assert "Hampel" in found.verdict.what


def rounded(step: float) -> Callable[[Array], Array]:
    return lambda y: np.rint(y / step) * step


NO_MEDIAN: dict[str, Callable[[Array], Array]] = {
    "white": lambda y: y,
    **{f"rounded to {step} σ": rounded(step) for step in (0.05, 0.3, 1.0, 3.0)},
    "slow, rounded": lambda y: np.rint(lfilter([1.0], [1.0, -0.99], y) / 0.3),
    "held": lambda y: np.repeat(y, 2)[: len(y)],
    "each tenth held": lambda y: np.where(np.arange(len(y)) % 10 == 9, np.roll(y, 1), y),
    "rounded, moved by two offsets": lambda y: (
        np.rint(3 * y) + np.where(np.arange(len(y)) % 400 < 200, 0.0, 0.3)
    ),
    "dead band": lambda y: np.where(np.abs(y) < 1.5, 0.0, y),
    "mean of 5": lambda y: np.convolve(y, np.ones(5) / 5, "valid"),
}


@pytest.mark.parametrize("name", list(NO_MEDIAN))
def test_no_median_filter_where_there_is_none(name: str) -> None:
    for seed in range(4):
        y = NO_MEDIAN[name](white(20_000, 1, seed)[0])
        assert "median filter" not in {data_check.kind for data_check in axis_data_checks(y, H)}


# --- a spectral line whose frequency wanders ---


def wandering(n: int, rate_hz: float, seed: int) -> Array:
    """Return n samples of white noise of standard deviation 1, with hum of 50 Hz ± 0.3 Hz whose amplitude is
    5.
    """
    pole = np.exp(-1 / (2 * rate_hz))
    away = lfilter([0.3 * np.sqrt(1 - pole**2)], [1, -pole], white(n, 1, seed + 50)[0])
    return white(n, 1, seed)[0] + 5 * np.sin(2 * np.pi * np.cumsum(50 + away) / rate_hz)


@pytest.mark.parametrize("rate_hz", [25.0, 50.0, 98.0, 99.0, 100.0, 101.0, 200.0])
def test_wandering_hum_is_no_filter(rate_hz: float) -> None:
    """At sample rates of 25 and 50 Hz, aliasing moves the hum to 0 Hz. At 100 Hz, the hum is at Nyquist."""
    found = analyse(wandering(20_000, rate_hz, 4), 1 / rate_hz)
    assert found.verdict.kind == "resonance"
    N = found.figures.level.N
    assert N.value is not None
    assert N.value * rate_hz**0.5 == pytest.approx(1, abs=0.03)
    assert ("wanders about a multiple" in found.verdict.what) == (rate_hz <= 50)


@pytest.mark.parametrize("slowness", [0.03, 0.1, 1.0])
def test_a_walk_is_no_line(slowness: float) -> None:
    """A random walk is not reported as a line that wanders about. A line is recognised by its constant
    amplitude: the fourth moment of its values is small for their variance. A random walk that has only a few
    slow waves in a record can have such a small fourth moment, too.
    """
    for seed in range(6):
        walk = slowness * np.cumsum(white(20_000, 1, seed + 50)[0])
        found = analyse(white(20_000, 1, seed)[0] + walk, H)
        assert "wanders about" not in found.verdict.text


@pytest.mark.parametrize("seed", range(3))
def test_noise_behind_a_slow_low_pass_is_no_line(seed: int) -> None:
    y = 10 * lfilter(*butter(2, 0.02), white(20_000, 1, seed)[0]) + 0.3 * white(20_000, 1, seed + 50)[0]
    found = analyse(y, H)
    assert found.verdict.kind == "low-pass"
    assert "or of the program that wrote the file" in found.verdict.next
