"""Tests that data checks find values that are too frequent: dead bands, one value in place of others,
clipping.

Plain rounding to counts or decimals is not reported.
"""

import fltea
import numpy as np
import pytest
from fltea.identification.advice import CURE_FIRST
from fltea.identification.values import value_data_checks
from fltea.records.arrays import Array

from tests.rig.identify_support import ar, long_recursion, white

N = 20_000


def kinds(y: Array) -> dict[str, str]:
    return {data_check.kind: data_check.severity for data_check in value_data_checks(y, "deg/s")}


@pytest.mark.parametrize(("band", "severity"), [(0.3, "warning"), (0.6, "bad"), (1.5, "bad")])
@pytest.mark.parametrize("offset", [0.0, 0.4])
@pytest.mark.parametrize("n", [3_000, N])
def test_a_dead_band(band: float, severity: str, offset: float, n: int) -> None:
    y = offset + white(n, 1, 1)[0]
    y[np.abs(y) <= band] = 0
    assert kinds(y)["dead band"] == severity


@pytest.mark.parametrize("counts", [2, 5, 20])
def test_a_dead_band_of_counts(counts: int) -> None:
    y = np.rint(counts * white(N, 1, 2)[0])
    assert "dead band" not in kinds(y)
    y[np.abs(y) <= max(counts // 2, 1)] = 0
    assert kinds(y * 0.061)["dead band"] == "bad"


def test_what_is_said_and_that_nothing_is_built_on_it() -> None:
    y = 0.1 * white(N, 1, 3)[0]
    y[np.abs(y) <= 0.15] = 0
    found = fltea.identify(y, rate_hz=100.0, unit="deg/s")
    assert "87% of the samples are exactly 0 deg/s" in found.withheld
    assert "nearer to it than 0.15 deg/s: a dead band" in found.withheld
    assert found.now is None
    assert found.text.endswith(CURE_FIRST)
    told = {data_check.kind for data_check in found.data_checks}
    assert "repeated" not in told, "no sample came twice"
    assert "outliers" not in told, "what is outside of the band is the noise"


def test_one_value_in_place_of_others() -> None:
    y = white(N, 1, 4)[0]
    shrunk = np.sign(y) * np.maximum(np.abs(y) - 0.5, 0)
    assert kinds(shrunk) == {"common value": "bad"}
    for share, severity in ((0.02, "warning"), (0.1, "bad")):
        failed = np.where(np.random.default_rng(5).random(N) < share, 0.0, y)
        assert kinds(failed) == {"common value": severity}


@pytest.mark.parametrize("counts", [None, 20])
def test_clipping(counts: int | None) -> None:
    y = white(3 * N, 1, 6)[0]
    y = y if counts is None else np.rint(y * counts) / counts
    assert kinds(y) == {}
    assert kinds(np.clip(y, -2, 2)) == {"clipped": "bad"}
    (data_check,) = value_data_checks(np.minimum(y, 1.5), "deg/s")
    assert "exactly 1.5 deg/s" in data_check.text


NOISES = {
    "white": lambda: white(N, 1, 7)[0],
    "Laplace": lambda: np.random.default_rng(8).laplace(size=N),
    "t4": lambda: np.random.default_rng(9).standard_t(4, N),
    "slow": lambda: ar((0.99,), N, 1, 10)[0],
    "order": lambda: long_recursion(0.6, -0.02, N, 11),
    "walk": lambda: white(N, 1, 12)[0].cumsum(),
}


@pytest.mark.parametrize("noise", NOISES)
def test_rounding_is_none_of_them(noise: str) -> None:
    y = NOISES[noise]()
    y /= y.std()
    assert kinds(y) == {}
    for counts in (0.2, 0.3, 0.5, 0.7, 1, 1.5, 2, 3, 5, 20):
        for offset in (0.0, 0.25, 0.5):
            rounded = np.rint(counts * y + offset)
            # a count of 0.061, written with two decimals: successive values differ by 0.06 or 0.07
            written = np.round(rounded * 0.061, 2)
            found = [*kinds(rounded), *kinds(written)]
            # Slow noise over a range of two or three counts has few different values. It is reported as
            # coarse.
            assert set(found) <= ({"few values"} if counts < 1 and noise in ("walk", "slow") else set())


def test_rest_and_motion_in_one_record_are_no_dead_band() -> None:
    y = np.rint(np.where(np.arange(N) > 0.7 * N, 100.0, 0.3) * white(N, 1, 13)[0])
    assert kinds(y) == {}
