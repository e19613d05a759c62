"""Composite models where they are used: files, noise that is drawn, tables, JSON, imu.yaml."""

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest
import yaml
from composite_noise import Truth, noise
from fltea.identification.allan import allan
from fltea.identification.findings import document, side_by_side
from fltea.identification.load import Request
from fltea.identification.model_file import NoiseModels, imu_yaml_of, read_models, write_models
from fltea.identification.navigation_file import write_navigation
from fltea.identification.noise_model import (
    AxisModel,
    CompositeNoise,
    GaussMarkovPart,
    White,
    composite_noise,
    draw,
    draws,
    identified,
    model_spectrum,
)
from fltea.identification.run import AxisReport, identify_all
from fltea.identification.sums import examined
from fltea.identification.workers import Here
from fltea.records.errors import FlteaError
from fltea.spectrum.composite import Composite, composite
from fltea.spectrum.composite_intervals import Estimate
from host_support import fltea
from identify_files import settings
from identify_support import H

APART = Truth(0.005, ((0.03, 1.0), (0.03, 0.05)), K=0.01)
PARTS = (GaussMarkovPart(0.03, 1.0), GaussMarkovPart(0.03, 0.05))
NOISE = CompositeNoise(R_dps2=0.0025, gauss_markov=PARTS, K_dps_per_sqrt_s=0.01, Q_deg=2e-4)


@pytest.fixture(scope="module")
def found() -> Composite:
    seen = examined(noise(APART, 200_000, H, 3), H)
    return composite(seen.fits.data, H, 200_000, seen.fits.sums)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """gyro_x with two parts and quantisation noise, gyro_y white."""
    y = np.stack(
        [noise(APART._replace(K=0.0, Q=5e-4), 60_000, H, 3), noise(Truth(0.005), 60_000, H, 4)], axis=1
    )
    path = tmp_path_factory.mktemp("composite") / "rest.npz"
    raw = np.rint(y * 5000).astype(np.int32)
    np.savez(path, gyro_raw=raw, lsb_per_dps=5000.0, fs_hz=100.0)
    return path


def test_the_noise_that_is_drawn() -> None:
    model = AxisModel(msgspec.structs.replace(NOISE, K_dps_per_sqrt_s=0.0))
    rng, n = np.random.default_rng(1), 4096
    total = np.mean([np.abs(np.fft.rfft(draw(model, H, n, rng)[0])) ** 2 / n for _ in range(200)], axis=0)
    lam = 2 * np.pi * np.arange(n // 2 + 1) / n
    ratio = (total[10:-1] / model_spectrum(model, lam[10:-1], H))[:2034].reshape(-1, 18).mean(axis=1)
    assert np.abs(ratio - 1).max() < 5 / np.sqrt(200 * 18)


@pytest.mark.parametrize("mean_of", [1, 4])
def test_a_walk_goes_as_far_as_a_walk_does(mean_of: int) -> None:
    """Over the whole record too, of which a circle alone would have three quarters."""
    model = AxisModel(CompositeNoise(R_dps2=0.0, K_dps_per_sqrt_s=1.0))
    n = 1 << 14
    many = draws(model, H, n, np.random.default_rng(2), mean_of)
    steps = np.array([(y[-1] - y[0], y[1000] - y[0]) for y, _ in (next(many) for _ in range(600))])
    expected = np.array([n - 1, 1000]) * H * mean_of
    np.testing.assert_allclose(steps.var(axis=0) / expected, 1, atol=4 * np.sqrt(2 / 600))


def test_files_of_all_versions(tmp_path: Path) -> None:
    models = NoiseModels(100.0, H, "rest.npz", {"gyro_x": AxisModel(NOISE)})
    path = tmp_path / "m.json"
    write_models(path, models)
    assert read_models(path) == models
    assert json.loads(path.read_text())["version"] == 3
    path.write_text(
        json.dumps(
            {k: v for k, v in msgspec.to_builtins(models).items() if k != "accel_axes"} | {"version": 2}
        )
    )
    assert read_models(path) == models
    old = NoiseModels(100.0, H, "rest.npz", {"gyro_x": AxisModel(White(R_dps2=0.04))})
    path.write_text(json.dumps(msgspec.to_builtins(old) | {"version": 1}))
    assert read_models(path) == old


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"K_dps_per_sqrt_s": -1.0}, "K_dps"),
        ({"Q_deg": -1.0}, "Q_deg"),
        ({"R_dps2": -1.0}, "R_dps2"),
    ],
)
def test_noise_that_cannot_be(changes: dict[str, float], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        CompositeNoise(**{"R_dps2": 1.0} | changes)
    for part in ((-1.0, 1.0), (1.0, 0.0), (1.0, float("inf"))):
        with pytest.raises(ValueError, match="must be"):
            GaussMarkovPart(*part)


def test_two_parts_alone_stay_two_ar1() -> None:
    """They are the same model, which earlier versions read."""
    seen = examined(noise(APART._replace(K=0.0), 60_000, H, 3), H)
    two = composite(seen.fits.data, H, 60_000, seen.fits.sums)
    assert two.name == "white + 2 Gauss–Markov"
    model = identified(seen.evidence.contest, "relaxations", (), 1.0, H, two)
    assert model.noise.__struct_config__.tag == "two_ar1"


def test_it_is_the_model_where_its_bic_is_lowest(found: Composite) -> None:
    seen = examined(noise(APART, 200_000, H, 3), H)
    model = identified(seen.evidence.contest, "relaxations", (), 1.0, H, found)
    assert model.noise == composite_noise(found, H)
    lam = np.geomspace(1e-3, 3, 20)
    np.testing.assert_allclose(model_spectrum(model, lam, H), found.spectrum(lam))
    fractional = identified(seen.evidence.contest, "fractional", (), 1.0, H, found)
    assert not isinstance(fractional.noise, CompositeNoise)


def test_what_a_filter_reads(found: Composite, tmp_path: Path) -> None:
    path = tmp_path / "navigation.json"
    write_navigation(path, {"gyro_x": found}, 100.0, "rest.npz")
    read = json.loads(path.read_text())
    assert (read["format"], read["version"], read["h_s"]) == ("fltea-navigation-model", 2, 0.01)
    axis = read["axes"]["gyro_x"]
    assert axis["N_deg_per_sqrt_h"] == pytest.approx(60 * found.N.value)
    slow, fast = axis["gauss_markov"]
    assert slow["tau_s"]["value"] > fast["tau_s"]["value"]
    for state in (slow, fast):
        variance, tau = state["sigma_dps"]["value"] ** 2, state["tau_s"]["value"]
        assert state["q_dps2_per_s"] == pytest.approx(2 * variance / tau)
        assert state["phi"] == pytest.approx(np.exp(-H / tau))
        assert state["s2_dps2"] == pytest.approx(variance * (1 - state["phi"] ** 2))
    with pytest.raises(FlteaError, match="cannot be written"):
        write_navigation(tmp_path / "no" / "a.json", {"gyro_x": found}, 100.0, "rest.npz")


def test_kalibr_gets_from_the_model_what_the_curve_does_not_show(found: Composite) -> None:
    curve = allan(noise(APART, 200_000, H, 3), H)
    hidden = msgspec.structs.replace(curve.K, value=None, reason="hidden")
    curve = msgspec.structs.replace(curve, K=hidden)
    assert "gyroscope_random_walk" not in yaml.safe_load(imu_yaml_of({"gyro_x": curve}, 100.0, "rest.npz"))
    text = imu_yaml_of({"gyro_x": curve}, 100.0, "rest.npz", composites={"gyro_x": found})
    assert found.K is not None
    assert yaml.safe_load(text)["gyroscope_random_walk"] == pytest.approx(np.radians(found.K.value))
    assert "from the composite model" in text
    unknown = msgspec.structs.replace(found, K=Estimate(found.K.value, None, None))
    text = imu_yaml_of({"gyro_x": curve}, 100.0, "rest.npz", composites={"gyro_x": unknown})
    assert "gyroscope_random_walk" not in yaml.safe_load(text)


def test_tables_and_json(recording: Path) -> None:
    (report,) = identify_all([Request((recording,))], settings(shuffles=0), Here())
    axes = {name: axis for name, axis in report.axes.items() if isinstance(axis, AxisReport)}
    assert len(axes) == 2
    rows = dict(side_by_side(axes))
    assert rows["composite model"][1] == "white"
    assert rows["  Gauss–Markov 1 τ [s]"][0] != ""
    assert rows["  Gauss–Markov 1 τ [s]"][1] == ""
    labels = [label for label, _ in side_by_side(axes)]
    assert (
        labels.index("composite model")
        < labels.index("  Gauss–Markov 1 τ [s]")
        < labels.index("Allan N [deg/√h]")
    )
    told = document([report])["files"][0]["axes"]["gyro_y"]["composite"]
    assert told["name"] == "white"
    assert told["N"]["low"] < 0.005 < told["N"]["high"]
    assert told["drift_rate"]["low"] < 0 < told["drift_rate"]["high"]
    json.dumps(told, allow_nan=False)


@pytest.mark.slow
def test_there_and_back(recording: Path, tmp_path: Path) -> None:
    """Noise that is drawn of an exported model has that model."""
    model, navigation = tmp_path / "m.json", tmp_path / "n.json"
    flags = ["--shuffles", "0", "--channels", "gyro_x", "--export-model", model, "--gauss-markov", navigation]
    done = fltea("identify", recording, *flags)
    assert (done.returncode, done.stderr) == (0, "")
    assert "composite model" in done.stdout
    assert read_models(model).axes["gyro_x"].noise.__struct_config__.tag == "composite"
    done = fltea("simulate", tmp_path / "a.npz", "--model", model, "-n", "60000", "--seed", "4")
    assert (done.returncode, done.stderr) == (0, "")
    again = fltea("identify", tmp_path / "a.npz", "--shuffles", "0", "--json")
    before = json.loads(navigation.read_text())["axes"]["gyro_x"]
    after = json.loads(again.stdout)["files"][0]["axes"]["gyro_x"]["composite"]
    assert after["name"] == before["model"]
    for one, other in zip(before["gauss_markov"], after["gauss_markov"], strict=True):
        assert other["sigma"]["value"] == pytest.approx(one["sigma_dps"]["value"], rel=0.4)
        assert other["tau_s"]["value"] == pytest.approx(one["tau_s"]["value"], rel=0.6)
