"""Tests of the Python API: its results equal those of the commands, misuse is reported, and importing it is
quick.
"""

import inspect
import math
import re
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import fltea
import numpy as np
import pytest
from fltea.api import series
from fltea.api._check import PARAMETERS, in_python
from fltea.documents.chart import Curve, log_log
from fltea.identification.forecast import Drive, Goal
from fltea.settings.how import How
from fltea.settings.setting import declared
from msgspec.structs import replace

from tests.rig.api_support import NOISE, by_spectrum
from tests.rig.identify_files import identify_axis


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
    """The noise grows at most like a random walk. In four times the time, a random walk gets twice as far on
    average. The test allows that it gets 8 times as far.
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
