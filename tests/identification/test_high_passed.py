"""Tests that statements on bias, heading and random walk are true if a high-pass has removed slow noise."""

import numpy as np
import pytest
from fltea.identification.axis import IdentifyOptions
from fltea.identification.axis_report import AxisReport
from fltea.identification.kalibr import axis_noise
from fltea.identification.load import Series
from scipy.signal import lfilter

from tests.rig.identify_one import identify_series
from tests.rig.identify_support import H

N, CORNER_HZ, SIGMA, K = 60_000, 0.1, 0.1, 1e-3
OPTIONS = IdentifyOptions(shuffles=0)


def coupled(n: int, seed: int) -> np.ndarray:
    """Return the output of a sensor after a high-pass of one pole. The sensor has white noise, and a bias of
    1 that does a random walk.
    """
    rng, pole = np.random.default_rng((51, seed)), np.exp(-2 * np.pi * CORNER_HZ * H)
    y = 1.0 + SIGMA * rng.standard_normal(n + 10_000)
    y += K * np.sqrt(H) * np.cumsum(rng.standard_normal(len(y)))
    return np.asarray(lfilter([1, -1], [1, -pole], y)[10_000:])


@pytest.fixture(scope="module")
def report() -> AxisReport:
    return identify_series(Series(coupled(N, 1), "deg/s", None), H, OPTIONS, False, forecast=True)


def test_nothing_is_said_of_a_walk(report: AxisReport) -> None:
    assert report.result.verdict.kind == "high-pass"
    assert report.walk is not None
    assert report.walk.said == "taken out"
    assert report.walk.at_most is None
    assert report.allan is not None
    assert report.allan.K.at_most is None
    assert "nothing is known of K" in report.allan.K.reason
    found = axis_noise(report)
    assert found.K.value is None
    assert "the sensor itself may have one" in found.K.remark
    assert found.N.value == pytest.approx(0.01, rel=0.02)


def test_the_forecast_holds_for_the_samples_and_says_so(report: AxisReport) -> None:
    """Behind a high-pass with the corner frequency f, white noise does not make the heading error grow.

    The error's standard deviation is σ √(h / (4π f)) at all times, and not N √t (σ: standard deviation of the
    samples, h: sampling period, t: time). The bias's random walk becomes white noise at low frequencies, with
    the density K / (2π f).
    """
    assert report.forecast is not None
    assert not any(one.fails for one in (*report.forecast.judged, *report.forecast.bias))
    assert "the sensor itself drifts more" in report.forecast.text
    at = dict(zip(report.forecast.t_s, report.forecast.heading_std, strict=True))
    expected = np.sqrt(SIGMA**2 * H / (4 * np.pi * CORNER_HZ) + (K / (2 * np.pi * CORNER_HZ)) ** 2 * 30)
    assert 0.9 < at[30.0] / expected < 1.5


def test_of_independent_records_the_heading_is_in_the_band(report: AxisReport) -> None:
    assert report.forecast is not None
    at = dict(zip(report.forecast.t_s, report.forecast.heading_std, strict=True))
    off = [H * np.cumsum(coupled(6_000, seed)[:6_000])[[999, 5_999]] for seed in range(100, 160)]
    rms = np.sqrt(np.mean(np.square(off), axis=0))
    # From 60 records, the standard deviation is known to ± 9 %. The high-pass makes the mean of the samples
    # 0, so no bias is subtracted.
    np.testing.assert_allclose(rms, [at[10.0], at[60.0]], rtol=0.4)


def test_a_plain_filter_has_no_high_pass_and_takes_the_noise_for_white(report: AxisReport) -> None:
    assert report.filter is not None
    assert abs(report.filter.N / 0.01 - 1) < 0.02
    assert report.filter.gauss_markov == ()
    for one in report.filter.heading_std:
        assert one.filter > one.forecast
