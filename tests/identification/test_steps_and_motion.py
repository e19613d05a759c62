"""Tests that `fltea identify` reports steps of the bias and motion, and that neither distorts the noise
figures.
"""

import math
from pathlib import Path

import fltea
import numpy as np
import pytest
from fltea.identification.advice import EXPECT_STEPS
from fltea.identification.axis import IdentifyOptions
from fltea.identification.axis_report import AxisReport
from fltea.identification.event_checks import EVENT_CHECKS, popcorn_noise
from fltea.identification.findings import document
from fltea.identification.gaps import Gaps, no_gaps
from fltea.identification.lead import lead
from fltea.identification.left_out import LeftOut, without
from fltea.identification.load import GYRO_UNIT, Request, Series
from fltea.identification.run import identify_all
from fltea.identification.sensor_events import BiasStep
from fltea.identification.workers import Here
from fltea.records.arrays import Array
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from tests.rig.identify_files import LSB_PER_DPS, QUICK, RATE_HZ, settings
from tests.rig.identify_one import identify_series
from tests.rig.identify_support import H
from tests.rig.tiers import slow

N_TRUE, SIGMA, SAMPLES = 0.01, 0.1, 60_000
LSB_PER_G = 16384.0


def identified(y: Array, gaps: Gaps | None = None) -> AxisReport:
    series = Series(y, GYRO_UNIT, None, gaps or no_gaps())
    return identify_series(series, H, IdentifyOptions(QUICK, shuffles=0), False)


def told(found: AxisReport) -> list[str]:
    return [data_check.text for data_check in found.data_checks if data_check.kind in EVENT_CHECKS]


def white(seed: int = 1, axes: int = 1) -> Array:
    y = SIGMA * np.random.default_rng(seed).standard_normal((SAMPLES, axes))
    return y[:, 0] if axes == 1 else y


@pytest.mark.parametrize("at", [20_000, 31_240, 55_000])
@pytest.mark.parametrize("size", [SIGMA, 0.3 * SIGMA])
def test_white_noise_with_a_step_is_white_noise_and_the_step_is_told(size: float, at: int) -> None:
    y = white(2)
    y[at:] += size
    found = identified(y)
    assert found.result.verdict.kind == "white"
    assert found.result.level.N.value == pytest.approx(N_TRUE, rel=0.02)
    (step,) = found.bias_steps
    assert step.at_s == pytest.approx(at * H, abs=3 * 0.3 * (SIGMA / size) ** 2)
    assert step.size == pytest.approx(size, abs=4 * step.size_std)
    assert "drift" not in {data_check.kind for data_check in found.data_checks}
    (text,) = told(found)
    assert text.startswith(f"Bias: step of +{step.size:.3f}"[:18])
    assert f"deg/s at {step.at_s:.1f} s" in text
    assert found.now is not None
    assert found.filter is not None
    for bias, std in ((found.now.bias, found.now.bias_std), (found.filter.bias, found.filter.bias_std)):
        assert bias == pytest.approx(size, abs=4 * std)
        assert std < 0.3 * size, "after the step, and not the mean of all samples"


def test_a_step_is_that_of_a_gap_free_time_and_the_bias_is_that_of_the_setting() -> None:
    """The time of a step in the report includes the time of the lost samples before the step."""
    y = white(3)
    y[30_000:] += 0.2
    found = identified(y, Gaps(np.array([10_000, 20_000]), np.array([50, 5000])))
    (step,) = found.bias_steps
    assert step.at_s == pytest.approx((30_000 + 5050) * H, abs=0.3)
    assert found.now is not None
    assert found.now.bias_s == 1.0
    assert "Bias(1 s) 0." in lead(found)


@pytest.mark.parametrize(("seed", "size"), [(1, 0.2), (3, 0.2), (2, 0.3)])
def test_popcorn_noise_is_named_and_what_is_between_is_white(seed: int, size: float) -> None:
    """The steps are telegraph noise, which stays at a level for 20 s on average. Its spectrum is that of a
    relaxation.
    """
    rng = np.random.default_rng(seed)
    y = SIGMA * rng.standard_normal(SAMPLES)
    jumps = np.cumsum(rng.exponential(2000, 200)).astype(int)
    y += size * (np.searchsorted(jumps, np.arange(SAMPLES), "right") % 2)
    found = identified(y)
    assert found.result.verdict.kind == "white"
    assert found.result.level.N.value == pytest.approx(N_TRUE, rel=0.02)
    apart, every_s = popcorn_noise(found.bias_steps) or (0, 0)
    assert apart == pytest.approx(size, rel=0.15)
    assert 15 < every_s < 30
    (text,) = told(found)
    assert text.startswith("Popcorn noise: the bias steps between two levels 0.")
    assert f"and {len(found.bias_steps) - 3} more." in text
    assert "bias steps" in [data_check.kind for data_check in found.data_checks]


@pytest.mark.parametrize("seed", [1, 4])
def test_steps_of_a_deviation_to_and_fro_are_all_found(seed: int) -> None:
    """The samples step up and down by σ every 20 s.

    The first search for a model takes the steps for a relaxation, which hides some of them. Still, all are
    found.
    """
    found = identified(white(seed) + SIGMA * (np.arange(SAMPLES) // 2000 % 2))
    np.testing.assert_allclose([step.at_s for step in found.bias_steps], np.arange(20, 600, 20), atol=1.0)
    assert popcorn_noise(found.bias_steps) is not None


def test_steps_one_way_are_no_popcorn() -> None:
    up = [BiasStep(float(t), 0.1, 0.01) for t in range(8)]
    assert popcorn_noise(up) is None
    assert popcorn_noise([BiasStep(one.at_s, one.size * (-1) ** i, 0.01) for i, one in enumerate(up)]) == (
        pytest.approx(0.1),
        pytest.approx(1.0),
    )
    assert popcorn_noise([BiasStep(float(t), (-1) ** t * 0.1 * (t + 1), 0.01) for t in range(8)]) is None


def fractional(rng: np.random.Generator, alpha: float) -> Array:
    f = np.fft.rfftfreq(2 * SAMPLES)
    response = np.r_[0, f[1:] ** -alpha]
    return np.fft.irfft(np.fft.rfft(rng.standard_normal(2 * SAMPLES)) * response)[:SAMPLES]


NOISES = {
    "white": lambda rng: 0.0,
    "walk": lambda rng: np.cumsum(2e-4 * rng.standard_normal(SAMPLES)),
    "fast walk": lambda rng: np.cumsum(2e-3 * rng.standard_normal(SAMPLES)),
    "relaxation": lambda rng: lfilter([0.01], [1, -0.995], rng.standard_normal(SAMPLES)),
    "slow relaxation": lambda rng: lfilter([0.003], [1, -0.9995], rng.standard_normal(SAMPLES)),
    "1/f": lambda rng: 0.02 * fractional(rng, 0.5),
    "1/f^1.4": lambda rng: 0.01 * fractional(rng, 0.7),
    "drift": lambda rng: np.linspace(0, 0.05, SAMPLES),
}


@pytest.mark.parametrize("seed", [1, slow(2), slow(3)])
@pytest.mark.parametrize("name", NOISES)
def test_noise_without_steps_has_none(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    found = identified(SIGMA * rng.standard_normal(SAMPLES) + NOISES[name](rng))
    assert (found.bias_steps, found.motion, told(found)) == ((), (), [])


def recorded(folder: Path, gyro: Array, accel: Array | None = None) -> Path:
    arrays = {"gyro_raw": np.rint(gyro * LSB_PER_DPS).astype(np.int32)}
    if accel is not None:
        arrays["accel_raw"] = np.rint(accel / 9.80665 * LSB_PER_G).astype(np.int32)
    path = folder / "rest.npz"
    np.savez(path, lsb_per_dps=LSB_PER_DPS, fs_hz=RATE_HZ, accel_lsb_per_g=LSB_PER_G, **arrays)
    return path


def still(seed: int = 9) -> Array:
    return np.random.default_rng(seed).normal(0, 0.02, (SAMPLES, 3)) + np.array([0, 0, 9.81])


def test_a_turn_about_z_is_motion_of_all_axes_and_in_no_figure(tmp_path: Path) -> None:
    y = white(5, 3)
    y[30_000:33_000] += [0.05, -0.05, 10]
    (report,) = identify_all([Request((recorded(tmp_path, y),))], settings(), Here())
    for axis in report.axes.values():
        assert isinstance(axis, AxisReport)
        assert axis.result.verdict.kind == "white"
        assert axis.result.level.N.value == pytest.approx(N_TRUE, rel=0.03)
        (span,) = axis.motion
        assert (span.begin_s, span.end_s) == (pytest.approx(300, abs=0.7), pytest.approx(330, abs=1.2))
        assert (span.by, span.unit) == ("gyro_z", "deg/s")
        assert span.largest == pytest.approx(10, abs=0.5)
        assert not axis.bias_steps
        assert axis.now is not None
        assert abs(axis.now.bias) < 4 * axis.now.bias_std
        assert axis.result.samples < SAMPLES - 3000
    (file,) = document([report])["files"]
    said = file["axes"]["gyro_x"]
    assert len(said["bias_steps"]) == 0
    assert said["motion"][0].keys() == {"begin_s", "end_s", "by", "largest", "unit"}
    assert said["now"]["bias_s"] == 1.0


@pytest.mark.slow
def test_a_tilt_that_only_the_accelerometer_shows_is_motion_of_the_gyroscope(tmp_path: Path) -> None:
    """A tilt that only the accelerometer shows counts as motion of the gyroscope, even if the accelerometer
    itself is not identified. In the API, the accelerometer is always identified.
    """
    accel = still()
    accel[20_000:21_000, 0] += np.linspace(0, 2, 1000)
    accel[21_000:, 0] += 2
    path = recorded(tmp_path, white(6, 3), accel)
    (report,) = identify_all([Request((path,))], settings(), Here())
    assert list(report.axes) == ["gyro_x", "gyro_y", "gyro_z"]
    by_api = fltea.open(path, axes=["gyro_x"]).identify()
    for axis in (*report.axes.values(), by_api["gyro_x"]):
        (span,) = axis.motion
        assert span.by == "accel"
        assert (span.begin_s, span.end_s) == (pytest.approx(200, abs=2), pytest.approx(210, abs=2))


@pytest.mark.slow
def test_the_api_tells_the_same_as_the_command(tmp_path: Path) -> None:
    y = white(7, 3)
    y[40_000:, 1] += 0.1
    path = recorded(tmp_path, y, still())
    (report,) = identify_all([Request((path,), accel=True)], settings(0), Here())
    by_api = fltea.open(path).identify()
    for name, axis in report.axes.items():
        assert isinstance(axis, AxisReport)
        found = by_api[name]
        assert (found.bias_steps, found.motion) == (axis.bias_steps, axis.motion)
        assert found.verdict == axis.result.verdict.kind
        assert len(found.bias_steps) == (name == "gyro_y")
    assert "step of +0." in by_api["gyro_y"]._repr_html_()
    assert "Bias(1 s) at the end: 0." in by_api["gyro_y"]._repr_html_()


def test_a_filter_of_white_noise_with_steps_needs_more_than_N() -> None:
    """In an earlier version, the filter claimed that its bias was known exactly."""
    rng = np.random.default_rng(1)
    y = np.cumsum(rng.random(30_000) < 0.0005) % 2 * 3 * SIGMA + SIGMA * rng.standard_normal(30_000)
    found = identified(y)
    assert found.result.verdict.kind == "white"
    assert found.result.verdict.next == EXPECT_STEPS
    assert found.filter is not None
    assert found.filter.bias_std > SIGMA / math.sqrt(30_000)


def test_too_many_steps_for_a_spectrum_between_them_are_told_beside_the_first_look() -> None:
    rng = np.random.default_rng(14)
    found = identified(SIGMA * rng.standard_normal(3000) + (np.arange(3000) // 40 % 2))
    assert len(found.bias_steps) > 8
    assert found.result.longest_stretch > 2000
    assert any(
        "every 0.800 s" in data_check.text for data_check in found.data_checks if data_check.kind == "comb"
    )
    (text,) = (text for text in told(found) if text.startswith("Popcorn noise"))
    assert text.endswith("All figures include the steps: there are too few samples between them.")


@given(
    n=st.integers(40, 400),
    steps=st.lists(st.integers(1, 39), max_size=4, unique=True),
    spans=st.lists(st.tuples(st.integers(0, 300), st.integers(1, 60)), max_size=3),
    gaps=st.dictionaries(st.integers(1, 39), st.integers(0, 9), max_size=3),
)
def test_what_is_left_out_takes_its_time(
    n: int, steps: list[int], spans: list[tuple[int, int]], gaps: dict[int, int]
) -> None:
    at = np.array(sorted(gaps), dtype=np.int64)
    own = Gaps(at, np.array([gaps[one] for one in sorted(gaps)], dtype=np.int64))
    out = LeftOut(
        tuple((begin, min(begin + count, n)) for begin, count in sorted(spans)), tuple(sorted(steps))
    )
    series = Series(np.arange(n, dtype=float), GYRO_UNIT, None, own)
    found = without(series, out)
    moved = {k for begin, end in out.moved for k in range(begin, end)}
    kept = [k for k in range(n) if k not in moved]
    assert found.y.tolist() == kept
    assert (np.diff(found.gaps.at) > 0).all()
    broken = {*steps, *(one for one, lost in gaps.items() if lost == 0)}
    for k, missing in zip(found.gaps.at.tolist(), found.gaps.missing.tolist(), strict=True):
        before, after = kept[k - 1], kept[k]
        if missing == 0:
            assert any(before < one <= after for one in broken)
        else:
            lost = sum(count for one, count in gaps.items() if before < one <= after)
            assert missing == after - before - 1 + lost


@pytest.mark.parametrize("name", ["mpu6050_sunsided_10min.npz", "mpu6050_tomisuarez_100s.npz"])
def test_real_sensors_at_rest_neither_step_nor_move(recordings: Path, name: str) -> None:
    for found in fltea.open(recordings / name).identify().values():
        assert (found.bias_steps, found.motion) == ((), ())
