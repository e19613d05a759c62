"""Tests of the Python API: its results equal those of the commands, misuse is reported, and importing it is
quick.
"""

import inspect
import math
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import fltea
import numpy as np
import pytest
from fltea.api import series
from fltea.api._check import PARAMETERS, in_python
from fltea.documents.chart import Curve, log_log
from fltea.identification.axis import AxisResult
from fltea.identification.forecast import Drive, Goal
from fltea.identification.load import Request, load
from fltea.recording.reading import Answer
from fltea.settings.how import How
from fltea.settings.setting import declared
from msgspec.structs import replace

from tests.rig.identify_files import LSB_PER_DPS, RATE_HZ, counts, identify_axis, npz

NOISE = np.random.default_rng(4).standard_normal(3000)


def by_spectrum(found: AxisResult) -> AxisResult:
    """Return the result of an axis without the fields to which the tracker contributes."""
    return replace(found, verdict=None, level=None, drift_rate=None)


def test_an_array_gets_the_verdict_of_the_command() -> None:
    found, own = fltea.identify(NOISE, 100.0, unit="m/s²"), identify_axis(NOISE, 0.01)
    assert (found.verdict, found.null_p) == ("white", own.null.p_value)
    assert found.text.startswith(f"{own.verdict.what} {own.verdict.why} A filter needs only its density N: ")
    assert (found.R.value, found.alpha.value, found.unit) == (None, None, "m/s²")
    assert (found.samples, found.duration_s) == (3000, 30.0)
    assert by_spectrum(found.details) == by_spectrum(own)
    assert found.std == own.std
    assert own.level.N.value == found.allan.N
    assert found.allan.adev[0] == pytest.approx(1.0, rel=0.1)
    assert np.median(found.spectrum.density) == pytest.approx((2 / 100) ** 0.5, rel=0.1)


def test_a_forecast_answers_how_long_to_rest_and_to_drive() -> None:
    asked = [Goal(within=50.0, t_s=60.0), Drive(within=10.0, rest_s=30.0)]
    forecast = fltea.identify(NOISE, 100.0, unit="deg/s", forecast=asked).forecast
    assert (forecast.goal, forecast.drive) == tuple(asked)
    alone = [fltea.identify(NOISE, 100.0, unit="deg/s", forecast=one).forecast for one in asked]
    assert (forecast.rest_s, forecast.drive_s) == (alone[0].rest_s, alone[1].drive_s)
    assert 0 < forecast.drive_s < 3600


def test_options_leave_bands_out() -> None:
    y = NOISE + np.sin(2 * np.pi * 20 * np.arange(3000) / 100)
    assert fltea.identify(y, 100.0, unit="deg/s").verdict == "line"
    assert fltea.identify(y, 100.0, unit="deg/s", notch_hz=[(19, 21)]).verdict == "white"


@pytest.mark.parametrize(
    ("unit", "shown", "one"),
    [
        ("rad/s", "deg/s", math.degrees(1)),
        ("mdps", "deg/s", 1e-3),
        ("deg/h", "deg/s", 1 / 3600),
        ("lsb:16.4", "deg/s", 1 / 16.4),
        ("g", "m/s²", 9.80665),
        ("m/s^2", "m/s²", 1.0),
    ],
)
def test_figures_are_in_two_units_whatever_the_samples_are_in(unit: str, shown: str, one: float) -> None:
    found = fltea.identify(NOISE + 5, 100.0, unit=unit, lsb=0.001)
    own = identify_axis((NOISE + 5) * one, 0.01, 0.001 * one)
    assert (found.unit, found.mean, found.std) == (shown, own.mean, own.std)
    assert own.level.N.value == found.allan.N
    live = fltea.Live(100.0, "a", unit=unit)
    told = live.add(NOISE + 5)
    np.testing.assert_allclose((told.rate + told.bias)[1000:], (NOISE[1000:] + 5) * one, rtol=1e-12)
    assert (live.unit, live.fit()["a"].unit) == (shown, shown)
    noise = fltea.simulate(600, alpha=0.5, f=-1.0, Q=0.0, R=1.0, unit=unit, window=1, warmup=0)
    assert noise.y.std() == pytest.approx(1.0, rel=0.1)
    assert (noise.identify().unit, noise.identify().std) == (shown, pytest.approx(noise.y.std(ddof=1) * one))


def test_whole_counts_are_a_resolution_and_other_numbers_are_not() -> None:
    for y, lsb in ((np.rint(0.2 * NOISE), 1 / 131), (0.2 * NOISE, None)):
        found = fltea.identify(y, 100.0, unit="lsb:131")
        alone = [fltea.identify(y * (1 / 131), 100.0, unit="dps", lsb=one) for one in (1 / 131, None)]
        assert alone[0] != alone[1]
        assert found == alone[lsb is None]


def test_a_unit_that_is_not_said_is_asked_for_with_what_each_would_mean() -> None:
    # white noise with N = 0.4 deg/√h plus a mean of 0.3 deg/s, converted to rad/s
    y = np.radians(0.3 + 0.4 / 60 * 10 * NOISE)
    with pytest.raises(ValueError, match="nothing says the unit of the samples") as error:
        fltea.identify(y, 100.0)
    said = str(error.value)
    assert re.search(r"unit='rad/s' +N in deg/√h 0\.4\d?; mean in deg/s 0\.3\n", said)
    assert re.search(r"unit='deg/s' +N in deg/√h 0\.007\d?; mean in deg/s 0\.005\d\n", said)
    assert "--" not in said
    for call in (lambda: fltea.Live(100.0), lambda: fltea.Live(100.0, unit=None)):
        with pytest.raises(ValueError, match=r"unit='rad/s', unit='deg/s' .* accelerometer .* unit='g'\.$"):
            call()
    with pytest.raises(TypeError, match="unit"):
        fltea.simulate(600, alpha=0.5, f=-1.0, Q=0.1, R=0.0)


@pytest.mark.parametrize("unit", ["furlongs", "", "lsb:0", "rad", 9.81])
def test_a_unit_that_is_none_is_refused(unit: Any) -> None:
    for call in (
        lambda: fltea.identify(NOISE, 100.0, unit=unit),
        lambda: fltea.Live(100.0, unit=unit),
        lambda: fltea.simulate(600, alpha=0.5, f=-1.0, Q=0.1, R=0.0, unit=unit),
    ):
        with pytest.raises(ValueError, match=r"for a gyroscope deg/s, .* got ") as error:
            call()
        assert "--" not in str(error.value)


def test_every_name_of_the_api_can_be_called() -> None:
    assert fltea.identify(NOISE, 100.0, unit="deg/s").verdict == "white"
    assert set(fltea.__all__) <= set(dir(fltea))
    assert all(callable(getattr(fltea, name)) for name in set(fltea.__all__) - {"__version__"})
    with pytest.raises(AttributeError, match="no attribute 'Identity'"):
        _ = fltea.Identity


def test_import_is_light() -> None:
    program = "import sys, fltea; sys.exit(int('numpy' in sys.modules or 'fltea.api' in sys.modules))"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


@pytest.mark.parametrize(
    ("y", "rate_hz", "told"),
    [
        (np.zeros((600, 3)), 100.0, r"one axis, \(n,\), got shape \(600, 3\)"),
        ([0.0, np.nan, np.inf], 100.0, r"2 values that are not finite, the first at \[1\]"),
        (["a"], 100.0, "numbers"),
        (NOISE, 0.0, "sampling rate"),
        (NOISE, float("nan"), "sampling rate"),
        (np.ones(3000), 100.0, "constant"),
        (NOISE[:10], 100.0, "samples"),
    ],
)
def test_misuse_is_told(y: object, rate_hz: float, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        fltea.identify(y, rate_hz, unit="deg/s")


def test_live_takes_arrays_of_any_length() -> None:
    whole, parts = (fltea.Live(100.0, ["a", "b"], unit="deg/s") for _ in range(2))
    y = np.random.default_rng(1).standard_normal((2000, 2))
    whole.add(y)
    for begin, end in ((0, 1), (1, 1), (1, 700), (700, 2000)):
        parts.add(y[begin:end])
    assert parts.samples == whole.samples == 2000
    found, same = whole.fit(last=True), parts.fit(last=True)
    assert list(found) == ["a", "b"]
    assert dict(found) == dict(same)
    assert found["a"].verdict == "white"
    assert found["a"].allan.tau_s[0] == pytest.approx(0.01)
    assert 49 < found["a"].spectrum.hz[-1] <= 50
    parts.skip(500)
    parts.add(y)
    assert parts.fit(curves=False)["a"].breaks["gaps"] == 1


def test_rates_less_their_bias_integrate_to_a_heading_that_is_as_far_off_as_is_said() -> None:
    axes, rest, turn = 24, 6000, 3000
    rng = np.random.default_rng(1)
    walk = np.cumsum(rng.normal(0, 0.0005, (rest + turn, axes)), axis=0)
    y = 0.5 + walk + rng.normal(0, 0.14, walk.shape)
    rate = 20 * np.sin(np.arange(turn) / 100)[:, None]
    live = fltea.Live(100.0, [str(axis) for axis in range(axes)], unit="deg/s")
    still = live.add(y[:rest])
    np.testing.assert_allclose(still.rate, y[:rest] - still.bias)
    assert not still.moving.any()
    assert all(math.isnan(std) for std in live.heading_std(30.0).values())
    live.fit(curves=False)
    moved = live.add(y[rest:] + rate, at_rest=False)
    assert moved.moving.mean() > 0.95
    assert (np.diff(moved.bias_std[100:], axis=0) >= 0).all(), "of a prediction"
    off = (moved.rate - rate).sum(axis=0) / 100
    said = np.array([*live.heading_std(30.0).values()])
    # with 24 axes, this root mean square of error / σ is within these limits in 99.8 % of cases
    assert 0.6 < np.sqrt(np.mean((off / said) ** 2)) < 1.4
    assert (moved.bias_std[-1] > moved.bias_std[100]).all()
    assert (live.samples, live.fit(curves=False)["0"].left_out["lost"]) == (rest, turn)


def test_samples_of_one_axis_come_back_in_their_shape() -> None:
    live = fltea.Live(100.0, "a", unit="rad/s")
    whole, parts = live.add(NOISE[:700]), fltea.Live(100.0, "a", unit="rad/s")
    assert all(column.shape == (700,) for column in whole)
    cut = [parts.add(NOISE[begin:end]) for begin, end in ((0, 0), (0, 1), (1, 700))]
    np.testing.assert_array_equal(np.concatenate([one.bias_std for one in cut]), whole.bias_std)
    for t_s in (0, math.inf, math.nan):
        with pytest.raises(ValueError, match="t_s must be a time"):
            live.heading_std(t_s)


def test_steps_and_motion_are_found_by_samples_and_by_the_accelerometer() -> None:
    rng = np.random.default_rng(2)
    y, accel = rng.normal(0, 0.1, (20_000, 3)), rng.normal(0, 0.02, (20_000, 3))
    accel[:, 2] += 9.8
    y[12_000:, 1] += 0.2
    accel[15_000:16_000, 0] += np.linspace(0, 2, 1000)
    accel[16_000:, 0] += 2
    live = fltea.Live(100.0, unit="deg/s")
    live.add(y[:6000])
    live.fit(curves=False)
    found = live.add(y[6000:], accel_ms2=accel[6000:])
    (step,) = live.steps
    assert step.axis == "gyro_y"
    assert abs(step.sample - 12_000) < 10
    assert abs(step.size - 0.2) < 3 * step.size_std
    moving = found.moving[:, 0]
    assert moving[9200:9900].all()
    assert not moving[:9000].any()
    assert not moving[10_100:].any()
    assert (found.moving == moving[:, None]).all()
    assert abs(found.bias[-1, 1] - 0.2) < 3 * found.bias_std[-1, 1]
    with pytest.raises(ValueError, match="row for each row of y"):
        live.add(y[:10], accel_ms2=accel[:9])


def test_a_far_offset_is_believed_of_who_says_that_the_sensor_is_at_rest() -> None:
    y = np.random.default_rng(3).normal(0, 0.1, (9000, 1))
    y[6000:] += 10
    found = {}
    for at_rest in (None, True):
        live = fltea.Live(100.0, "x", unit="deg/s")
        live.add(y[:6000])
        live.fit(curves=False)
        found[at_rest] = live.add(y[6000:], at_rest=at_rest)
    assert found[None].moving[32:].all()
    assert abs(found[None].bias[-1, 0]) < 0.1
    assert not found[True].moving[-1000:].any()
    assert abs(found[True].bias[-1, 0] - 10) < 0.1


def test_misuse_of_live_is_told_and_takes_nothing() -> None:
    live = fltea.Live(100.0, "a", unit="deg/s")
    for y, told in (([[1.0, 2.0]], "for each axis"), ([1.0, np.nan], "skip"), (1.0, "for each axis")):
        with pytest.raises(ValueError, match=told):
            live.add(y)
    with pytest.raises(ValueError, match="1 or more"):
        live.skip(0)
    for axes in ([], ["a", "a"]):
        with pytest.raises(ValueError, match="different names"):
            fltea.Live(100.0, axes, unit="deg/s")
    with pytest.raises(ValueError, match="memory must be a time"):
        fltea.Live(100.0, unit="deg/s", memory="soon")
    assert live.samples == 0
    assert live.fit()["a"].verdict == "too few samples"


def test_a_recording_is_its_axes(tmp_path: Path) -> None:
    raw = counts(1500)
    found = fltea.open(npz(tmp_path / "a<b>.npz", raw), axes=["gyro_y", "gyro_x"])
    assert list(found) == ["gyro_y", "gyro_x"]
    np.testing.assert_array_equal(found["gyro_y"], raw[:, 1] / LSB_PER_DPS)
    assert (found.rate_hz, found.units["gyro_x"], found.counts.used) == (RATE_HZ, "deg/s", 1500)
    report = found.identify()
    alone = fltea.identify(found["gyro_x"], RATE_HZ, unit="deg/s", axis="gyro_x", lsb=1 / LSB_PER_DPS)
    # Fields that contain the random walk of the offset may differ between an axis of a file and the same axis
    # alone: the axes of a file may share one figure for this random walk.
    of_walk = ("now", "walk", "filter", "text", "details", "allan", "allan_curve")
    by_walk = dict.fromkeys(of_walk)
    both = report["gyro_x"], alone
    assert replace(both[0], **by_walk) == replace(both[1], **by_walk)
    assert by_spectrum(both[0].details) == by_spectrum(both[1].details)
    assert both[0].allan_curve.B == both[1].allan_curve.B
    assert "a&lt;b&gt;.npz" in found._repr_html_()
    assert found.to_pandas().shape == (1500, 2)
    assert list(report.to_pandas().index) == ["gyro_y", "gyro_x"]
    with pytest.raises(KeyError, match="gyro_y, gyro_x"):
        _ = found["gyro_z"]


def test_all_stretches_count_and_time_goes_on_in_gaps(tmp_path: Path) -> None:
    """A gap of 300 samples makes two stretches without a gap. `fltea identify` reports the same."""
    raw, seq = counts(2500), np.arange(2500) + np.where(np.arange(2500) >= 1000, 300, 0)
    path = npz(tmp_path / "a.npz", raw, time_s=seq / RATE_HZ, seq=seq, accel_raw=raw, accel_lsb_per_g=16384.0)
    found = fltea.open(path)
    assert list(found)[3:] == ["accel_x", "accel_y", "accel_z"]
    assert (found.counts.used, found.counts.lost, found.units["accel_x"]) == (2500, 300, "m/s²")
    np.testing.assert_allclose(found.time_s, seq / RATE_HZ)
    y = load(Request((path,))).axes["gyro_x"]
    report = fltea.open(path, axes=["gyro_x"]).identify()
    own = identify_axis(y.y, 1 / RATE_HZ, y.lsb, None, y.gaps)
    assert by_spectrum(report["gyro_x"].details) == by_spectrum(own)
    assert "300 lost in 1 gaps" in found._repr_html_()


def test_a_recording_in_parquet(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow", reason="the extra notebook is not installed")
    found = fltea.open(npz(tmp_path / "a.npz", counts(600)))
    found.to_parquet(tmp_path / "a.parquet")
    table = pandas.read_parquet(tmp_path / "a.parquet")
    assert list(table.columns) == ["time_s", "gyro_x_dps", "gyro_y_dps", "gyro_z_dps"]
    np.testing.assert_array_equal(table["gyro_y_dps"], found["gyro_y"])
    np.testing.assert_allclose(np.diff(table["time_s"]), 1 / RATE_HZ)


def test_a_recording_tells_how_it_was_read_in_the_words_of_a_call(tmp_path: Path) -> None:
    loaded = load(Request((npz(tmp_path / "a.npz", counts(600)),)))
    said = (Answer("unit", "rad/s", "given", "--units"), Answer("columns", "gx, <b>", "stated", "the names"))
    found = fltea.Recording("a.npz", SimpleNamespace(**{**loaded._asdict(), "h": loaded.h, "reading": said}))
    assert [str(one) for one in found.reading] == ["rad/s (given: units)", "gx, <b> (stated: the names)"]
    shown = found._repr_html_()
    assert "<tr><th>unit</th><td>rad/s (given: units)</td></tr>" in shown
    assert "gx, &lt;b&gt; (stated" in shown


def test_what_a_call_says_of_a_recording_is_how_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Request] = []
    monkeypatch.setattr("fltea.api.recording.load", lambda one: asked.append(one) or load(Request(one.paths)))
    path = npz(tmp_path / "a.npz", counts(600))
    fltea.open(path, units="rad/s", accel_units="g", topic="1/2", overrule=True)
    fltea.open(path, columns=["a", 2], time_column=3, time_unit="ms", rate_hz=50)
    assert [one.how for one in asked] == [
        How(units="rad/s", accel_units="g", topic="1/2", overrule=True),
        How(columns=["a", "2"], time_column="3", time_unit="ms", rate_hz=50),
    ]


def test_a_library_that_is_missing_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    found = fltea.open(npz(tmp_path / "a.npz", counts(600)))
    for library, call in (
        ("pandas", found.to_pandas),
        ("pyarrow", lambda: found.to_parquet(tmp_path / "b.parquet")),
    ):
        monkeypatch.setitem(sys.modules, library, None)
        with pytest.raises(fltea.UsageError, match=f"{library}, which is not installed.*notebook"):
            call()
    assert not (tmp_path / "b.parquet").exists()


def test_a_recording_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(fltea.UsageError, match="no such file"):
        fltea.open(tmp_path / "none.npz")
    with pytest.raises(fltea.UsageError, match="accel_x"):
        fltea.open(npz(tmp_path / "a.npz", counts(600)), axes=["accel_x"])
    with pytest.raises(ValueError, match="sampling rate"):
        fltea.open(tmp_path / "a.csv", rate_hz=-1.0)


def test_simulated_noise_is_that_of_its_seed() -> None:
    def draw(seed: int) -> fltea.Simulated:
        return fltea.simulate(600, alpha=0.5, f=-1.0, Q=0.1, R=0.0, unit="deg/s", warmup=100, seed=seed)

    a, b, c = draw(1), draw(1), draw(2)
    np.testing.assert_array_equal(a.y, b.y)
    # samples and state are equal, because with R = 0 there is no white noise
    np.testing.assert_array_equal(a.y, a.state)
    assert (a.y != c.y).all()
    assert list(a.to_pandas().columns) == ["y", "state"]
    with pytest.raises(ValueError, match="1 or more"):
        fltea.simulate(0, alpha=0.5, f=-1.0, Q=0.1, R=0.0, unit="deg/s")


@pytest.mark.parametrize(
    ("alpha", "f", "rate_hz", "told"),
    [
        (2.5, -1.0, 100.0, "alpha = 2.5: such noise runs away"),
        (0.5, 1.0, 100.0, "f = 1: noise runs away where f is positive"),
        (0.5, -15.0, 100.0, "runs away below f = -14.1"),
    ],
)
def test_noise_that_runs_away_is_refused(alpha: float, f: float, rate_hz: float, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        fltea.simulate(3000, rate_hz, alpha=alpha, f=f, Q=1.0, R=0.0, unit="deg/s")


@pytest.mark.parametrize(("alpha", "f"), [(0.5, -14.0), (1.0, -199.0), (1.8, -5e3), (1.0, 0.0), (1.99, -1.0)])
def test_noise_within_the_bound_does_not_run_away(alpha: float, f: float) -> None:
    """The noise grows at most like a random walk. On average, a random walk moves twice as far in four times
    the time. The test allows a factor of 8.
    """
    y = fltea.simulate(8000, alpha=alpha, f=f, Q=1.0, R=0.0, unit="deg/s", warmup=0).y
    assert np.abs(y).max() < 8 * np.abs(y[:2000]).max()


def test_errors_name_what_a_call_takes(tmp_path: Path) -> None:
    def told(text: str, **how: object) -> str:
        (tmp_path / "a.csv").write_text(text)
        with pytest.raises(fltea.UsageError) as error:
            fltea.open(tmp_path / "a.csv", **how)
        return str(error.value)

    rows = "0.1,0.2,0.3\n0.2,0.1,0.2\n" * 30
    different = "".join(f"{y:.4f},{y * y:.4f},{y**3:.4f}\n" for y in NOISE[:60])
    call = f"fltea.open({str(tmp_path / 'a.csv')!r}, columns=[?, ?, ?], units=?, rate_hz=?)"
    assert call in told(different)
    assert len(fltea.open(tmp_path / "a.csv", columns=[1, 2, 3], rate_hz=100, units="dps")) == 3
    assert told(rows, units="foo").startswith("units foo: ")
    for text in (rows, "gx,gy,gz\n" + rows, "a,b,c\n" + rows):
        assert "--" not in told(text)
    with pytest.raises(ValueError, match=r"\(from_hz, notch_hz\)"):
        fltea.identify(NOISE[:100], 100.0, unit="deg/s")


def test_flags_become_parameters() -> None:
    assert in_python("give it: --rate 100.") == "give it: rate_hz=100."
    assert in_python("--columns gx,gy,gz --units deg/s") == "columns=['gx', 'gy', 'gz'], units='deg/s'"
    assert in_python("--time-column NAME --time-unit ms (it has") == (
        "time_column='NAME', time_unit='ms' (it has"
    )
    assert (
        in_python("such as --topic /imu/data, --time-unit says")
        == "such as topic='/imu/data', time_unit says"
    )
    assert in_python("--rate-like --samples") == "--rate-like --samples"
    assert in_python("--columns ?,?,? --units ? --rate ?") == "columns=[?, ?, ?], units=?, rate_hz=?"
    assert in_python("--sensor 1/2: or --topic sensor_gyro:1") == "topic='1/2': or topic='sensor_gyro:1'"
    assert in_python("add --accel-units m/s^2 --overrule.") == "add accel_units='m/s^2', overrule=True."
    assert in_python("--units deg/h, or --accel-units mm/s^2, or mg") == (
        "units='deg/h', or accel_units='mm/s^2', or mg"
    )
    assert in_python("--columns 'gyro x,gyro y' --units says") == "columns=['gyro x', 'gyro y'], units says"
    assert in_python("  --units lsb:65.5  N in") == "  units='lsb:65.5'  N in"
    assert in_python("--sensor AA:BB, or --units dps: N") == "topic='AA:BB', or units='dps': N"
    assert in_python("/data/--rate.csv:1: Give --rate.") == "/data/--rate.csv:1: Give rate_hz."
    assert in_python(
        "x: fltea identify './a b.csv' --sensor 'id=a b' --columns 1,b --rate ? --overrule\n."
    ) == ("x: fltea.open('./a b.csv', topic='id=a b', columns=[1, 'b'], rate_hz=?, overrule=True)\n.")
    assert in_python("see fltea identify, with --rate ?") == "see fltea identify, with rate_hz=?"
    assert {flag for one in declared(How()) for flag in one.setting.flags} <= set(PARAMETERS)
    takes = {*inspect.signature(fltea.open).parameters, *inspect.signature(fltea.identify).parameters}
    assert set(PARAMETERS.values()) <= takes


def test_a_notebook_is_shown_words_figures_and_curves() -> None:
    found = fltea.identify(NOISE, 100.0, unit="deg/s", axis="<gyro>")
    shown = found._repr_html_()
    assert "<strong>&lt;gyro&gt;: white</strong>" in shown
    assert "undefined" in shown  # white noise has no order
    assert f"σ = {found.std:.3g} deg/s" in shown
    assert shown.count("<svg") == 2
    ElementTree.fromstring(shown.replace("<br>", "<br/>"))
    table = found.to_pandas()
    assert table.loc["<gyro>", "verdict"] == "white"
    assert table.loc["<gyro>", "R_low"] == found.R.low


def test_a_chart_of_anything() -> None:
    assert log_log("t", "x", "y", [Curve([1.0], [float("nan")], "data")]) == ""
    shown = log_log(
        "t", "x", "y", [Curve([0.0, 1.0, 1e9], [1.0, 2.0, float("inf")], "data", [0.0] * 3, [9.0] * 3)]
    )
    assert "nan" not in shown
    assert "inf" not in shown
    ElementTree.fromstring(shown)


def test_what_is_called_says_what_it_takes() -> None:
    assert list(inspect.signature(series.identify).parameters)[:2] == ["y", "rate_hz"]
    assert fltea.identify is series.identify


def test_figures_of_an_axis_are_those_of_the_command_in_the_units_of_data_sheets() -> None:
    y = 0.3 + 0.05 * NOISE  # white noise of 0.05 deg/s at 100 Hz has N = 0.005 deg/s/√Hz, which is 0.3 deg/√h
    found = fltea.identify(y, 100.0, unit="deg/s")
    level, curve = found.details.level, found.allan_curve
    assert (
        found.N.interval
        == fltea.Quantity(level.N.value * 60, level.N.low * 60, level.N.high * 60, None, "deg/√h").interval
    )
    assert found.N.to("deg/s/√Hz").value == pytest.approx(0.005, rel=0.05)
    assert found.N.unit == "deg/√h"
    assert (found.B.unit, found.B.value, found.B.at_most) == ("deg/h", None, curve.B.at_most * 3600)
    assert (found.K.unit, found.K.value, found.K.at_most) == ("deg/h/√h", None, level.K_at_most * 216000)
    assert found.bias.low < 0.3 < found.bias.high
    assert found.bias.value == found.now.bias
    table = found.to_pandas().iloc[0]
    assert (table["N"], table["N_low"], table["K_at_most"]) == (level.N.value, level.N.low, level.K_at_most)
    with pytest.raises(ValueError, match="got 'furlong'"):
        found.N.to("furlong")
    accel = fltea.identify(y, 100.0, unit="g")
    assert (accel.N.unit, accel.B.unit, accel.K.unit) == ("m/s²/√Hz", "m/s²", "m/s²/√s")
    assert accel.N.to("µg/√Hz").value == pytest.approx(5000, rel=0.05)


def test_what_there_is_no_curve_or_bias_of_is_not_known() -> None:
    """There is no Allan deviation if all stretches are too short, and no bias for bad data. Figures from them
    are then "not known".
    """
    whole = fltea.identify(NOISE, 100.0, unit="deg/s")
    found = replace(whole, allan_curve=None, now=None)
    assert str(found.B) == str(found.bias) == "not known"
    assert (found.B.unit, found.bias.unit, found.N) == ("deg/h", "deg/s", whole.N)
    assert found.to_pandas().iloc[0]["B_at_most"] is None


def test_a_drawing_is_that_of_the_notebook_and_goes_to_a_file(tmp_path: Path) -> None:
    found = fltea.identify(NOISE, 100.0, unit="deg/s", axis="<gyro>")
    drawing = found.plot()
    charts = re.findall(r"<svg.*?</svg>", found._repr_html_(), re.DOTALL)
    assert re.findall(r"<svg.*?</svg>", drawing._repr_html_(), re.DOTALL) == charts
    drawing.save(tmp_path / "axis.svg")
    root = ElementTree.parse(tmp_path / "axis.svg").getroot()
    placed = [one.get("x") for one in root if one.tag.endswith("svg")]
    assert placed == ["0", "420"]
    assert (root.get("width"), root.get("height")) == ("840", "260")
    with pytest.raises(ValueError, match=r"ends in \.svg"):
        drawing.save(tmp_path / "axis.png")
    with pytest.raises(fltea.FlteaError, match="cannot be written"):
        drawing.save(tmp_path / "nowhere" / "axis.svg")
