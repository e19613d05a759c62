"""Tests that data checks find each fault that was added to noise, and none in clean noise."""

import functools

import numpy as np
import pytest
from fltea.identification.counts import Counts
from fltea.identification.data_checks import axis_data_checks, timing_data_checks
from fltea.identification.judges import held
from fltea.records.arrays import Array
from fltea.spectrum.periodogram import periodogram
from fltea.spectrum.spectral_lines import find_peaks
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs
from scipy.ndimage import median_filter

from tests.rig.identify_support import H, ar, long_recursion, white

LONG = 60_000
LSB = 0.1
QUIET = Counts(1000, 1000, 0, 1, *[0] * 9)


def kinds(y: Array, lsb: float | None = None) -> dict[str, str]:
    """Return the severity of each kind of finding of the data checks, except for the kind "short"."""
    return {
        data_check.kind: data_check.severity
        for data_check in axis_data_checks(y, H, lsb)
        if data_check.kind != "short"
    }


@functools.cache
def clean(kind: str) -> Array:
    return {
        "white": lambda: white(3000, 60, 2),
        "AR(.9)": lambda: ar((0.9,), 3000, 60, 3),
        "AR(-.8)": lambda: ar((-0.8,), 3000, 60, 4),
        "fractional": lambda: np.array([long_recursion(0.6, -0.19, 3000, seed) for seed in range(60)]),
    }[kind]()


def counts(y: Array) -> Array:
    return np.rint(y / LSB) * LSB


@pytest.mark.parametrize("kind", ["white", "AR(.9)", "AR(-.8)", "fractional"])
@pytest.mark.parametrize("lsb", [None, 0.1, 0.4])
def test_clean_noise_hardly_ever_has_one(kind: str, lsb: float | None) -> None:
    series = clean(kind)
    if lsb is not None:
        series = np.rint(series / lsb) * lsb
    found = [data_check for y in series for data_check in held([y], [lsb], H)]
    assert sum(len(kinds(y, lsb)) for y in series) + len(found) <= 1


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.floats(1e-3, 1e3), st.sampled_from([0.05, 0.3, 1.0]))
def test_no_data_check_at_any_scale(seed: int, scale: float, coarse: float) -> None:
    """Thresholds have no unit, so the findings do not depend on the scale."""
    y = np.rint(white(2000, 1, seed)[0] / coarse) * coarse
    wanted = {"quantisation"} if y.std() < 2 * coarse else set()
    assert set(kinds(y * scale, coarse * scale)) == wanted
    assert held([y * scale], [coarse * scale], H) == ()


@pytest.mark.parametrize("window", [3, 5])
def test_a_median_filter(window: int) -> None:
    y = median_filter(counts(white(LONG, 1, 1)[0]), window)
    assert kinds(y)["median filter"] == "warning"
    (data_check,) = (one for one in axis_data_checks(y, H) if one.kind == "median filter")
    assert f"a median filter of about {window} samples" in data_check.text


@pytest.mark.parametrize("sign", [1, -1])
def test_offset(sign: int) -> None:
    (data_check,) = axis_data_checks(white(LONG, 1, 1)[0] * 0.1 + sign * 4.5, H)
    assert (data_check.kind, data_check.severity) == ("offset", "note")
    assert data_check.text == "The bias is large compared with the noise.", (
        "no figure, so that all axes share one note"
    )
    assert "offset" not in kinds(white(LONG, 1, 1)[0] + 0.05)


@pytest.mark.parametrize("change", [0.3, -0.3])
def test_drift(change: float) -> None:
    y = white(LONG, 1, 1)[0] + change * np.linspace(-0.5, 0.5, LONG)
    assert kinds(y) == {"drift": "warning"}
    assert f"Drift of {change:+.1f}"[:11] in axis_data_checks(y, H)[0].text
    assert kinds(white(LONG, 1, 1)[0] + 0.02 * np.linspace(-0.5, 0.5, LONG)) == {}


@pytest.mark.parametrize(
    ("sigma_lsb", "severity"), [(0.4, "bad"), (1.0, "warning"), (1.9, "warning"), (2.2, None)]
)
@pytest.mark.parametrize("known", [True, False])
def test_quantisation(sigma_lsb: float, severity: str | None, known: bool) -> None:
    # The size of a count is 1/16.4, which is no power of ten. Otherwise, where the size is not given, the
    # checks would take the steps of the values for decimals in the file.
    lsb = 1 / 16.4
    y = np.rint(white(20_000, 1, 1)[0] * sigma_lsb) * lsb
    assert kinds(y, lsb if known else None).get("quantisation") == severity


def test_outliers() -> None:
    y = white(3000, 1, 1)[0]
    y[[100, 1500, 1501]] += [12, -15, -15]
    found = {data_check.kind: data_check for data_check in axis_data_checks(y, H)}
    assert found["outliers"].severity == "warning"
    assert "the first at 1 s" in found["outliers"].text
    y[::50] += 20
    assert kinds(y)["outliers"] == "bad"


@pytest.mark.parametrize("sign", [1, -1])
def test_torn_reads(sign: int) -> None:
    y = counts(white(3000, 1, 1)[0])
    y[[700, 2000]] += sign * 256 * LSB
    (data_check,) = (data_check for data_check in axis_data_checks(y, H, LSB) if data_check.kind != "short")
    assert (data_check.kind, data_check.severity) == ("torn reads", "bad")
    assert data_check.text.startswith("2 jumps")
    y[1000] += 100 * LSB
    assert set(kinds(y, LSB)) == {"torn reads", "outliers"}
    assert "torn reads" not in kinds(y, None)


@pytest.mark.parametrize("width", [100, 20])
@pytest.mark.parametrize("tails", ["laplace", "standard_cauchy"])
def test_heavy_tails_are_no_torn_reads(tails: str, width: float) -> None:
    """A torn read mixes bytes of two samples, so it is wrong by about 256 counts. If σ is large or tails are
    heavy, outliers may differ by as much, but they are not called torn reads.
    """
    rng = np.random.default_rng(3)
    y = counts(width * LSB * np.clip(getattr(rng, tails)(size=20_000), -50, 50))
    assert "torn reads" not in kinds(y, LSB)
    assert ("outliers" in kinds(y, LSB)) == (tails == "standard_cauchy" or width > 50)


@pytest.mark.parametrize("end", [32767, -32768])
def test_saturation(end: int) -> None:
    near = counts(white(3000, 1, 1)[0] + (end - 100 * np.sign(end)) * LSB)
    assert "saturation" not in kinds(near, LSB)
    near[100:110] = end * LSB
    (data_check,) = (
        data_check for data_check in axis_data_checks(near, H, LSB) if data_check.kind == "saturation"
    )
    assert data_check.severity == "bad"
    assert data_check.text.startswith("10 samples")
    assert "saturation" not in kinds(near, None)


@pytest.mark.parametrize("lsb", [None, LSB, 1.0])
def test_stuck(lsb: float | None) -> None:
    y = white(3000, 1, 1)[0]
    y = y if lsb is None else np.rint(y / lsb) * lsb
    y[1000:1060] = y[1000]
    (data_check,) = (data_check for data_check in axis_data_checks(y, H, lsb) if data_check.kind == "stuck")
    assert data_check.severity == "bad"
    assert "for 6" in data_check.text
    assert "number 1000 on" in data_check.text or lsb == 1.0


def test_a_constant_axis_is_stuck() -> None:
    assert kinds(np.ones(3000)) == {"stuck": "bad"}


@pytest.mark.parametrize(("every", "severity"), [(2, "bad"), (50, "warning")])
@pytest.mark.parametrize("lsb", [None, LSB])
def test_repeated_reads(every: int, severity: str, lsb: float | None) -> None:
    y = white(6000, 3, 1)
    y = (y if lsb is None else counts(y)).T
    y[1::every] = y[:-1:every][: len(y[1::every])]
    (data_check,) = held(list(y.T), [lsb] * 3, H)
    assert (data_check.kind, data_check.severity) == ("repeated", severity)
    # if one axis changes, the sample is a new one, and the equal values of the other axes are chance
    y[:, 2] = white(6000, 1, 9)[0]
    assert held(list(y.T), [lsb] * 3, H) == ()


def test_peaks() -> None:
    n = 6000
    y = white(n, 1, 1)[0] + 0.4 * np.sin(2 * np.pi * 31.4 * np.arange(n) * H)
    (data_check,) = (
        t for t in axis_data_checks(y, H, None, find_peaks(periodogram(y, H))) if t.kind == "line"
    )
    assert data_check.severity == "warning"
    assert "31.4 Hz" in data_check.text
    assert "--notch" in data_check.remedy


@pytest.mark.parametrize(
    ("n", "h", "short"),
    [(60_000, 0.01, False), (49_999, 0.02, False), (60_000, 0.001, True), (30, 0.01, True)],
)
def test_too_short(n: int, h: float, short: bool) -> None:
    y = white(n, 1, 1)[0]
    assert any(data_check.kind == "short" for data_check in axis_data_checks(y, h)) is short


def test_gaps() -> None:
    lossy = structs.replace(QUIET, lost=3, gaps=1, stretches=2)
    (few,) = timing_data_checks(structs.replace(lossy, used=800), 100.0, 20.0)
    assert (few.kind, few.severity) == ("gaps", "note")
    assert "800 of 1000" in few.text
    for change in ({"used": 400}, {"lost": 50}):
        (many,) = timing_data_checks(structs.replace(lossy, **change), 100.0, 20.0)
        assert many.severity == "warning"


@pytest.mark.parametrize(
    ("ppm", "severity"),
    [(None, None), (900.0, None), (-7026.0, "warning"), (2000.0, "warning"), (-60_000.0, "bad")],
)
def test_sample_rate(ppm: float | None, severity: str | None) -> None:
    found = list(timing_data_checks(QUIET, 100.0, ppm))
    assert [data_check.severity for data_check in found] == ([severity] if severity else [])
    if severity and ppm:
        assert f"{100 * (1 + ppm * 1e-6):.6g} Hz" in found[0].text
