"""Tests of files for other programs: the file for a navigation filter and imu.yaml agree with all other
outputs.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from fltea.api.recording import open as open_recording
from fltea.api.series import identify
from fltea.documents.imu_yaml import AxisNoise, Inflation, Shown, imu_yaml
from fltea.identification.axis import IdentifyOptions
from fltea.identification.axis_report import AxisReport, FileReport
from fltea.identification.findings import _axis, document, side_by_side
from fltea.identification.kalibr import axis_noise
from fltea.identification.load import GYRO_UNIT, Request, Series
from fltea.identification.model_file import read_models
from fltea.identification.navigation_file import NavigationAxis, navigation_axis
from fltea.identification.navigation_filter import slope_of
from fltea.identification.noise_model import AxisModel, draw, model_spectrum
from fltea.identification.run import identify_all
from fltea.identification.workers import Here
from fltea.noise.filters import HighPass, LowPass, Notch, Sharpening
from fltea.noise.parts import AnyPart, Order, Quantisation, Relaxation, Walk, White
from fltea.settings.how import How
from hypothesis import HealthCheck, example, given
from hypothesis import settings as random
from hypothesis import strategies as st

from tests.rig.host_support import fltea, fltea_here
from tests.rig.identify_files import QUICK, settings
from tests.rig.identify_one import identify_series
from tests.rig.identify_support import H, Truth, composite, long_recursion, white
from tests.rig.model_support import EXAMPLES

NAVIGABLE = Truth(0.005, ((0.03, 1.0), (0.03, 0.05)), K=0.01)
OPTIONS = IdentifyOptions(QUICK, shuffles=0)


def saved(path: Path, *axes: np.ndarray) -> Path:
    raw = np.rint(np.stack(axes, axis=1) * 5000).astype(np.int32)
    np.savez(path, gyro_raw=raw, lsb_per_dps=5000.0, fs_hz=100.0)
    return path


@pytest.fixture(scope="module")
def known() -> AxisReport:
    return identify_series(Series(composite(NAVIGABLE, 200_000, H, 3), GYRO_UNIT, None), H, OPTIONS, False)


def entry_of(axis: AxisReport) -> NavigationAxis:
    assert axis.filter is not None
    return navigation_axis(axis.result, axis.unit, axis.filter)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a recording with three kinds of noise. gyro_x has two noise parts and quantisation noise, gyro_y
    is white, and gyro_z is noise of fractional order.
    """
    n = 60_000
    return saved(
        tmp_path_factory.mktemp("exports") / "rest.npz",
        composite(NAVIGABLE._replace(K=0.0, Q=5e-4), n, H, 3),
        composite(Truth(0.005), n, H, 4),
        0.02 * long_recursion(0.6, -0.19, n, 2) + 0.05 * white(n, 1, 9)[0],
    )


@pytest.fixture(scope="module")
def report(recording: Path) -> FileReport:
    (found,) = identify_all([Request((recording,))], settings(shuffles=0), Here())
    return found


def test_what_a_filter_reads(known: AxisReport) -> None:
    found = entry_of(known)
    assert found.N.low < 0.005 < found.N.high
    slow, fast = found.gauss_markov
    assert slow.tau_s.value == pytest.approx(1.0, rel=0.3)
    assert fast.tau_s.value == pytest.approx(0.05, rel=0.2)
    assert found.K.value == pytest.approx(0.01, rel=0.3)
    assert (found.others, found.without_order) == ((), None)
    for state in (slow, fast):
        assert state.sigma.value == pytest.approx(0.03, rel=0.1)
        variance, tau = (state.sigma.value or 0) ** 2, state.tau_s.value or 1
        assert state.q == pytest.approx(2 * variance / tau)
        assert state.phi == pytest.approx(np.exp(-H / tau))
        assert state.s2 == pytest.approx(variance * (1 - state.phi**2))
    assert pytest.approx(found.N.value, rel=0.05) == found.filter.N
    assert pytest.approx(found.K.value, rel=0.05) == found.filter.K
    for state, plain in zip(found.gauss_markov, found.filter.gauss_markov, strict=True):
        assert plain.sigma == pytest.approx(state.sigma.value, rel=0.05)
        assert plain.tau_s == state.tau_s.value


def test_white_noise_that_a_fast_part_took_in_is_not_near_nothing() -> None:
    """The fit may describe white noise as a very fast relaxation, and give N = 1e-8.

    With this N, a filter would expect errors that are a million times too small. So the file has null for N,
    and the density that was measured.
    """
    y = composite(Truth(0.0, ((0.05, 0.0055),)), 60_000, H, 1)
    found = identify_series(Series(y, GYRO_UNIT, None), H, OPTIONS, False)
    entry = entry_of(found)
    assert entry.N.value is None
    assert entry.knee_hz == pytest.approx(1 / (2 * np.pi * 0.0055), rel=0.5)
    # By hand: a relaxation has the power density 2 σ² τ at frequency 0, and half of that at its corner
    # frequency. The square root of this half is σ √τ.
    assert entry.knee_density == pytest.approx(0.05 * np.sqrt(0.0055), rel=0.5)
    assert "cannot be told from other fast noise" in found.result.level.reason
    shown = axis_noise(found).N
    assert shown.value == entry.filter.N == pytest.approx(0.05 * np.sqrt(2 * 0.0055), rel=0.1)
    assert "cannot be told from it" in shown.remark


def test_tables_and_json(report: FileReport) -> None:
    axes = {name: axis for name, axis in report.axes.items() if isinstance(axis, AxisReport)}
    rows = dict(side_by_side({name: axes[name] for name in ("gyro_x", "gyro_y")}))
    assert rows["made of"][1] == "white"
    assert rows["  relaxation 1 τ [s]"][0] != ""
    assert rows["  relaxation 1 τ [s]"][1] == ""
    assert rows["order α"][1] == "undefined"
    labels = list(rows)
    assert labels.index("made of") < labels.index("  relaxation 1 τ [s]") < labels.index("innovations' NIS")
    told = document([report])["files"][0]["axes"]["gyro_y"]
    assert told["level"]["N"]["low"] < 0.005 < told["level"]["N"]["high"]
    assert told["drift_rate"]["low"] < 0 < told["drift_rate"]["high"]
    assert {one["value"] for name, one in told["order"].items() if name != "arfima"} == {None}
    json.dumps(told, allow_nan=False)


@pytest.mark.parametrize("axis", ["gyro_x", "gyro_y", "gyro_z"])
def test_one_result_wherever_it_is_read(axis: str, report: FileReport) -> None:
    found = report.axes[axis]
    assert_one_result(found)


def assert_one_result(found: AxisReport) -> None:
    """Check that the text, the table, the JSON, the model, the curve and the filter of a result have the same
    noise parts, N, K and order.
    """
    r = found.result
    assert found.model.parts == r.models[r.stands].parts
    named = {str(part.__struct_config__.tag): part for part in found.model.parts}
    told = {part.part: part.values for part in r.parts}
    assert set(named) == set(told)
    for kind, part in named.items():
        if [one.part for one in r.parts].count(kind) == 1:
            assert {name: one.value for name, one in told[kind].items()} == pytest.approx(
                {name: getattr(part, name) for name in told[kind]}
            )
    assert found.allan is not None
    for name in ("N", "K"):
        one = getattr(r.level, name)
        curve = getattr(found.allan, name)
        assert (one.value, one.low, one.high) == (curve.value, curve.low, curve.high)
        assert getattr(entry_of(found), name) == one
    noise = axis_noise(found)
    assert r.level.N.value is None or noise.N.value == r.level.N.value
    assert found.walk is not None
    assert found.tracked is not None
    assert (noise.K.value is not None) == (found.walk.said == "walks")
    if r.level.K.value is not None and not slope_of(found.tracked.system).any():
        assert noise.K.value == r.level.K.value
    if r.level.N.value is not None and not {"resonance", "alternating"} & set(named):
        level = sum(named[kind].R for kind in ("white", "floor") if kind in named)
        assert r.level.N.value**2 / H == pytest.approx(level)
    if not r.verdict.has_order:
        assert {value.value for value in (r.order.alpha, r.order.f, r.order.F, r.order.R)} == {None}
    elif r.order.alpha.value is not None:
        assert f"order of {r.order.alpha.value:.2f}" in r.verdict.text
    rows = dict(side_by_side({"gyro_x": found}))
    assert rows["made of"] == [r.made_of]
    (shown,) = rows["order α"]
    defined = r.order.alpha.value is not None and None not in (r.order.alpha.low, r.order.alpha.high)
    assert (shown == "undefined") != defined
    if defined and r.order.alpha.value is not None:
        assert shown.startswith(f"{r.order.alpha.value:.2f}")


@pytest.mark.parametrize("kind", EXAMPLES)
def test_all_say_the_same_of_each_part(kind: str) -> None:
    y = draw(AxisModel((White(1.0), EXAMPLES[kind])), H, 6000, np.random.default_rng(1))[0]
    found = identify_series(Series(y, GYRO_UNIT, None), H, OPTIONS, False)
    assert_one_result(found)
    told = json.loads(json.dumps(_axis(found), allow_nan=False))
    assert [part["part"] for part in told["model"]["parts"]] == [part.tag() for part in found.model.parts]


def random_parts(share: st.SearchStrategy[float]) -> st.SearchStrategy[tuple[AnyPart, ...]]:
    """Return a strategy that draws models: white noise of variance 1 and one or two further noise parts.

    In some models, all noise parts pass a filter.
    """
    beside = st.one_of(
        st.builds(Relaxation, sigma=share, tau_s=st.floats(0.02, 3.0)),
        st.builds(Walk, K=st.floats(0.05, 0.5)),
        st.builds(Order, alpha=st.floats(0.3, 0.7), f=st.floats(-2.0, -0.5), Q=st.floats(1.0, 10.0)),
        st.builds(Quantisation, Q=st.floats(0.002, 0.01)),
    )
    filters = st.one_of(
        st.builds(LowPass, corner_hz=st.floats(10, 40), poles=st.floats(1.5, 4.0)),
        st.builds(HighPass, corner_hz=st.floats(0.5, 3.0), poles=st.floats(1.0, 2.0)),
        st.builds(Sharpening, s=st.floats(-0.2, 0.2)),
        st.builds(Notch, frequency_hz=st.floats(5, 40), width_hz=st.floats(2, 8)),
    )
    return st.tuples(st.lists(beside, max_size=2), st.lists(filters, max_size=1)).map(
        lambda found: (White(1.0), *found[0], *found[1])
    )


@random(max_examples=12, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(random_parts(st.floats(0.1, 2.0)), st.integers(0, 10**6))
@example((White(1.0), Walk(0.2), LowPass(10.0, 2.0)), 2)
@example((White(1.0), Walk(0.2), LowPass(20.0, 2.0)), 2)
def test_all_say_the_same_of_any_noise(parts: tuple[AnyPart, ...], seed: int) -> None:
    """Text, table, JSON and model agree. In an earlier version, one said α = 0.40, another 0.72."""
    y = draw(AxisModel(parts), H, 6000, np.random.default_rng(seed))[0]
    found = identify_series(Series(y, GYRO_UNIT, None), H, OPTIONS, False)
    assert_one_result(found)
    told = json.loads(json.dumps(_axis(found), allow_nan=False))
    assert told["order"]["alpha"]["value"] == found.result.order.alpha.value
    assert [part["part"] for part in told["model"]["parts"]] == [
        str(part.__struct_config__.tag) for part in found.model.parts
    ]


LEVELS = {
    "gyro_x": AxisNoise(Shown(0.01), Shown(None, "no walk")),
    "gyro_y": AxisNoise(Shown(0.02), Shown(None, "no walk")),
}


def test_imu_yaml() -> None:
    """The figures in imu.yaml are those of the worst axis. An unknown value is written as a comment, and
    hostile names do no harm.
    """
    hostile = 'a: b # "c'
    assert yaml.safe_load(imu_yaml(LEVELS, 100.0, "rest.npz", rostopic=hostile))["rostopic"] == hostile
    assert "\nx:" not in imu_yaml(LEVELS, 100.0, "rest.npz", rostopic="/imu\nx: 1")
    text = imu_yaml(LEVELS, 99.32, "rest\n.npz", rostopic="/imu7")
    found = yaml.safe_load(text)
    assert set(found) == {"gyroscope_noise_density", "update_rate", "rostopic"}
    assert found["gyroscope_noise_density"] == pytest.approx(np.radians(0.02))
    assert (found["update_rate"], found["rostopic"]) == (99.32, "/imu7")
    assert "of gyro_y" in text
    assert "# gyroscope_random_walk:  # rad/s^2/sqrt(Hz); not known: no walk" in text
    assert "# accelerometer_noise_density:" in text


def test_imu_yaml_of_both_sensors() -> None:
    """The four noise figures of imu.yaml are in the units of Kalibr.

    Inflation (`--inflate`) multiplies the noise densities by one factor, and the random walks by another.
    """
    gyro = {"gyro_x": AxisNoise(Shown(0.02), Shown(0.5))}
    accel = {"accel_y": AxisNoise(Shown(0.03), Shown(0.05))}
    found = yaml.safe_load(imu_yaml(gyro, 100.0, "rest.npz", accel=accel))
    assert len(found) == 6
    assert found["accelerometer_noise_density"] == pytest.approx(0.03)
    assert found["accelerometer_random_walk"] == pytest.approx(0.05)
    assert found["gyroscope_random_walk"] == pytest.approx(np.radians(0.5), rel=1e-5)
    text = imu_yaml(gyro, 100.0, "rest.npz", accel=accel, inflation=Inflation(5.0, 10.0))
    assert "# Inflated: noise densities 5 times and random walks 10 times" in text
    assert f"5 times the measured {found['accelerometer_noise_density']:.6e}" in text
    larger = yaml.safe_load(text)
    for key, value in found.items():
        factor = 5 if "density" in key else 10 if "walk" in key else 1
        assert larger[key] == (pytest.approx(factor * value, rel=1e-5) if factor > 1 else value)
    only = imu_yaml({}, 100.0, "rest.npz", accel=accel)
    assert "# gyroscope_noise_density:  # rad/s/sqrt(Hz); not known: no axis was analysed" in only


def sound_and_bad(folder: Path) -> Path:
    """Write a table of three axes. gyro_z was rounded to steps of 0.01 rad/s, which is 5.7 times its σ, and
    the other axes are sound.
    """
    y = 0.1 * white(3000, 3, 1).T
    y[:, 2] = np.degrees(np.round(np.radians(y[:, 2] + 0.3), 2))
    np.savetxt(folder / "rest.csv", y, "%.9g", ",", header="gyro_x_dps,gyro_y_dps,gyro_z_dps", comments="")
    return folder / "rest.csv"


@pytest.mark.parametrize("flag", ["--export-model", "--imu-yaml", "--gauss-markov"])
def test_nothing_is_written_of_bad_data(flag: str, tmp_path: Path) -> None:
    """No file is written from bad data. In an earlier version, an imu.yaml was written from pure rounding,
    although a data check said "bad".
    """
    command = ("identify", sound_and_bad(tmp_path), "--rate", "100", "--shuffles", "0", "--jobs", "1")
    done = fltea_here(*command, flag, tmp_path / "out", columns=300)
    assert done.returncode == 1
    assert f"the data are bad, so the output of {flag} is withheld. gyro_z: σ is" in done.stderr
    assert "write more of them" in done.stderr
    assert "--channels gyro_x,gyro_y" in done.stderr
    assert not (tmp_path / "out").exists()
    assert done.stdout.index("bad: gyro_z: ") < done.stdout.index("gyro_x: "), "the mark comes first"
    assert "gyro_z: " in done.stdout
    done = fltea_here(*command, flag, tmp_path / "out", "--channels", "gyro_x,gyro_y")
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "out").exists()


@pytest.mark.slow
def test_no_figure_goes_on_from_an_axis_that_is_bad(tmp_path: Path) -> None:
    """Comparison with a data sheet, forecast and heading do not use the bad axis.

    The sound axes have these results.
    """
    path = sound_and_bad(tmp_path)
    command = ("identify", path, "--rate", "100", "--shuffles", "0", "--jobs", "1", "--report", tmp_path)
    done = fltea_here(*command, "--sheet", "MPU-9250", "--forecast", "--json")
    assert done.returncode == 1
    assert "the output of --sheet, --forecast is withheld. gyro_z: σ is" in done.stderr
    assert "--channels" not in done.stderr
    axes = json.loads(done.stdout)["files"][0]["axes"]
    for name, one in axes.items():
        assert (one["withheld"] != "") == (name == "gyro_z")
        assert {one["sheet"] is None, one["forecast"] is None, one["now"] is None} == {name == "gyro_z"}
    page = (tmp_path / "report.html").read_text()
    assert page.index("gyro_z: σ is") < page.index("<b>gyro_x:")
    done = fltea_here(*command)
    assert done.returncode == 0, "nothing that was asked for is withheld"
    found = open_recording(path, rate_hz=100.0).identify(forecast=True)
    assert (found["gyro_z"].forecast, found["gyro_z"].now) == (None, None)
    assert "too few decimals" in found["gyro_z"].withheld
    assert "Bad data." in found["gyro_z"]._repr_html_()
    assert found["gyro_x"].forecast is not None
    assert found["gyro_x"].withheld == ""


def test_what_is_wrong_with_all_of_a_recording_withholds(tmp_path: Path) -> None:
    """If the rows of two sensors alternate, a data check reports a fault of the whole recording.

    Because of this fault, no axis is written to files.
    """
    y = 0.1 * white(3000, 2, 1).T + np.resize([0.2, -0.2], 3000)[:, None]
    np.savetxt(tmp_path / "a.csv", y, "%.9g", ",", header="gyro_x_dps,gyro_y_dps", comments="")
    (found,) = identify_all(
        [Request((tmp_path / "a.csv",), how=How(rate_hz=100.0))], settings(shuffles=0), Here()
    )
    assert found.recording is not None
    assert [
        data_check.kind for data_check in found.recording.data_checks if data_check.severity == "bad"
    ] == ["alternates"]
    for axis in found.axes.values():
        assert isinstance(axis, AxisReport)
        assert "--sensor 1/2" in axis.withheld
    y[:, 1] = 0
    series = identify(y[:, 0], 100.0, unit="deg/s", forecast=True)
    assert series.forecast is None
    assert "sensors by turns" in series.withheld


@pytest.mark.slow
def test_there_and_back(recording: Path, tmp_path: Path) -> None:
    """Noise simulated from an exported model is identified as that model."""
    model, navigation = tmp_path / "m.json", tmp_path / "n.json"
    flags = ["--shuffles", "0", "--channels", "gyro_x", "--export-model", model, "--gauss-markov", navigation]
    done = fltea("identify", recording, *flags)
    assert (done.returncode, done.stderr) == (0, "")
    lam = np.geomspace(0.01, np.pi, 30)
    expected = model_spectrum(read_models(model).axes["gyro_x"], lam, H)
    done = fltea("simulate", tmp_path / "a.npz", "--model", model, "-n", "60000", "--seed", "4")
    assert (done.returncode, done.stderr) == (0, "")
    again = tmp_path / "again.json"
    done = fltea("identify", tmp_path / "a.npz", "--shuffles", "0", "--json", "--export-model", again)
    found = model_spectrum(read_models(again).axes["gyro_x"], lam, H)
    np.testing.assert_allclose(np.log(found / expected), 0, atol=0.3)
    before: dict[str, Any] = json.loads(navigation.read_text())["axes"]["gyro_x"]
    after = json.loads(done.stdout)["files"][0]["axes"]["gyro_x"]
    assert after["level"]["N"]["value"] == pytest.approx(before["N"]["value"], rel=0.1)
