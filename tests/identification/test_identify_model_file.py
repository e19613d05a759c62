"""Identified models: to a file and back, their noise, and Kalibr's imu.yaml."""

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest
import yaml
from fltea.documents.imu_yaml import Inflation
from fltea.identification.allan import allan
from fltea.identification.model_file import NoiseModels, imu_yaml_of, read_models, write_models
from fltea.identification.noise_model import (
    AR1,
    AR2,
    AxisModel,
    Fractional,
    Resonance,
    TwoAR1,
    White,
    draw,
    identified,
    model_spectrum,
)
from fltea.identification.simulation_file import write_model_simulation
from fltea.recording.csv_file import read_csv
from fltea.recording.npz_file import read_npz
from fltea.records.errors import FlteaError, UsageError
from fltea.spectrum.lines import Peak
from fltea.spectrum.periodogram import binned, periodogram
from fltea.spectrum.rivals import contest, fit_all
from fltea.spectrum.verdict import VerdictKind
from hypothesis import given, settings
from hypothesis import strategies as st
from identify_support import H, ar, long_recursion, recursion, white

KINDS = {
    "white": White(R_dps2=0.04),
    "ar1": AR1(R_dps2=0.01, phi=0.95, s2_dps2=0.002),
    "ar1_blue": AR1(R_dps2=0.01, phi=-0.7, s2_dps2=0.02),
    "ar2": AR2(R_dps2=0.01, phi1=1.2, phi2=-0.8, s2_dps2=0.01),
    "two_ar1": TwoAR1(R_dps2=0.01, phi_slow=0.99, s2_slow_dps2=1e-4, phi_fast=0.5, s2_fast_dps2=0.02),
    "fractional": Fractional(R_dps2=0.02, alpha=0.6, f=-3.0, Q=0.15),
    "long_memory": Fractional(R_dps2=0.0, alpha=0.4, f=0.0, Q=1.0),
}
LINE = Resonance(frequency_hz=31.4, width_hz=0.8, variance_dps2=0.01)
MODELS = NoiseModels(
    100.0,
    H,
    "rest.npz",
    {"gyro_x": AxisModel(KINDS["fractional"], (LINE,)), "gyro_y": AxisModel(KINDS["white"])},
)
positive = st.floats(1e-12, 1e6)
pole = st.floats(-0.999999, 0.999999)
kinds = st.one_of(
    st.builds(White, R_dps2=positive),
    st.builds(AR1, R_dps2=positive, phi=pole, s2_dps2=positive),
    st.builds(AR2, R_dps2=positive, phi1=st.floats(-0.1, 0.1), phi2=st.floats(-0.8, 0.8), s2_dps2=positive),
    st.builds(
        TwoAR1, R_dps2=positive, phi_slow=pole, s2_slow_dps2=positive, phi_fast=pole, s2_fast_dps2=positive
    ),
    st.builds(
        Fractional, R_dps2=positive, alpha=st.floats(0.01, 1.99), f=st.floats(-0.99, -1e-9), Q=positive
    ),
)
lines = st.builds(
    Resonance, frequency_hz=st.floats(1e-3, 49.9), width_hz=st.floats(1e-4, 50), variance_dps2=positive
)
axis_models = st.builds(AxisModel, kinds, st.lists(lines, max_size=3).map(tuple))


@settings(max_examples=30)
@given(axis_models, axis_models, st.text(max_size=20))
def test_round_trip(x: AxisModel, y: AxisModel, source: str) -> None:
    models = NoiseModels(100.0, H, source, {"gyro_x": x, "gyro_y": y}, {"accel_z": y})
    assert msgspec.json.decode(msgspec.json.encode(models), type=NoiseModels) == models


def test_file(tmp_path: Path) -> None:
    path = tmp_path / "m.json"
    write_models(path, MODELS)
    assert read_models(path) == MODELS
    assert list(tmp_path.iterdir()) == [path]
    written = json.loads(path.read_text())
    assert written["axes"]["gyro_x"]["noise"] == {
        "kind": "fractional",
        "R_dps2": 0.02,
        "alpha": 0.6,
        "f": -3.0,
        "Q": 0.15,
    }
    assert (written["format"], written["version"], written["h_s"]) == ("fltea-noise-model", 3, 0.01)


def bad(**changes: object) -> str:
    whole = msgspec.to_builtins(MODELS)
    noise = {key: value for key, value in changes.items() if key in whole["axes"]["gyro_x"]["noise"]}
    whole["axes"]["gyro_x"]["noise"] |= noise
    return json.dumps(whole | {key: value for key, value in changes.items() if key not in noise})


def only(axis: str, kind: str, **parameters: float) -> dict[str, object]:
    return {axis: {"noise": {"kind": kind, "R_dps2": 1.0, **parameters}}}


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "is no noise model"),
        ("[]", "is no noise model"),
        ("{}", "--export-model"),
        ("\x00\xff", "is no noise model"),
        ('{"format": "other", "version": 1}', "--export-model"),
        (bad(version=4), "version 4; this fltea reads versions 1 to 3"),
        (bad(version="1"), "is no noise model"),
        (bad(kind="pink"), "pink"),
        (bad(alpha=2.0), r"alpha must be in \[0, 2\)"),
        (bad(alpha="x"), "float"),
        (bad(f=3.0), "gyro_x: α = 0.6, f = 3 is not stationary"),
        (bad(R_dps2=-1.0), "R_dps2 is a variance"),
        (bad(Q=-1.0), "Q is a variance"),
        (bad(h_s=0.02), "h_s"),
        (bad(rate_hz=0.0), "rate_hz must be > 0"),
        (bad(axes={}), "axes are gyro_x"),
        (bad(accel_axes=only("gyro_x", "white")), "accel_axes are accel_x"),
        (bad(axes=only("gyro_z", "white")), "got gyro_z"),
        (bad(axes=only("gyro_x", "ar1", phi=1.0, s2_dps2=1.0)), "phi"),
        (bad(axes=only("gyro_x", "ar2", phi1=0.6, phi2=0.5, s2_dps2=1.0)), "not stationary"),
        (bad(extra=1), "extra"),
    ],
)
def test_bad_files(text: str, word: str, tmp_path: Path) -> None:
    path = tmp_path / "m.json"
    path.write_bytes(text.encode("latin-1" if "\x00" in text else "utf-8"))
    with pytest.raises(UsageError, match=word) as caught:
        read_models(path)
    assert str(path) in str(caught.value)


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        read_models(tmp_path / "none.json")
    with pytest.raises(FlteaError, match="cannot be written"):
        write_models(tmp_path / "none" / "m.json", MODELS)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", KINDS)
def test_noise_has_the_spectrum_of_its_model(name: str) -> None:
    model = AxisModel(KINDS[name], (LINE,))
    n, series = 4096, 60
    rng = np.random.default_rng(1)
    drawn = np.array([draw(model, H, n, rng)[0] for _ in range(series)])
    data = binned(periodogram(drawn, H))
    fine = periodogram(drawn[0], H)
    expected = binned(fine._replace(power=model_spectrum(model, fine.lam, H))).power[0]
    use = data.lam > 0.02  # below, what leaks from the lowest frequencies of a record counts
    off = (data.power.mean(axis=0) / expected - 1)[use] * np.sqrt(series * data.counts[use])
    assert np.abs(off).max() < 6
    assert abs(off.mean()) < 1


def test_noise_is_that_of_the_recursion() -> None:
    """The same as from an independent generator in the time domain."""
    n, series = 1024, 40
    states = recursion(0.6, -3.0, n, series, 1, warmup=1000) * np.sqrt(0.15) * H**0.6
    rng = np.random.default_rng(2)
    drawn = np.array([draw(AxisModel(KINDS["fractional"]), H, n, rng)[1] for _ in range(series)])
    data, other = binned(periodogram(drawn, H)), binned(periodogram(states, H))
    ratio = data.power.mean(axis=0) / other.power.mean(axis=0)
    off = np.log(ratio) * np.sqrt(series * data.counts / 2)
    assert np.abs(off).max() < 4.5
    assert abs(off.mean()) < 1


def test_the_variance_of_a_line() -> None:
    model = AxisModel(White(R_dps2=0.0), (LINE,))
    rng = np.random.default_rng(1)
    y = np.array([draw(model, H, 20_000, rng)[0] for _ in range(10)])
    assert y.var() == pytest.approx(LINE.variance_dps2, rel=0.15)


@pytest.mark.parametrize("kind", ["white", "ar1", "ar2", "fractional"])
def test_a_model_is_found_again_in_its_noise(kind: str) -> None:
    y = {
        "white": lambda: white(20_000, 1, 1)[0],
        "ar1": lambda: ar((0.9,), 20_000, 1, 2)[0] + white(20_000, 1, 3)[0],
        "ar2": lambda: ar((1.5, -0.9), 20_000, 1, 14)[0] + white(20_000, 1, 15)[0],
        "fractional": lambda: long_recursion(0.6, -0.19, 8000, 6),
    }[kind]()
    p = periodogram(y, H)
    peak = Peak("line", 20.0, 0.1, 0.01, 5.0, (19.0, 21.0))
    model = identified(contest(p, fit_all(p)), "undecided", (peak,), 2.0, H)
    assert type(model.noise).__struct_config__.tag == kind
    assert model.resonances == (Resonance(20.0, 0.1, 0.04),)
    data = binned(p)
    expected = model_spectrum(AxisModel(model.noise), data.lam, H)
    off = (data.power[0] / expected - 1) * np.sqrt(data.counts)
    assert np.abs(off[data.counts >= 8]).max() < 5
    assert abs(off.mean()) < 0.3
    if isinstance(model.noise, Fractional):
        assert model.noise.alpha == pytest.approx(0.6, abs=0.15)
        assert model.noise.Q * H ** (2 * model.noise.alpha) == pytest.approx(1.0, rel=0.4)


@pytest.mark.parametrize(
    ("verdict", "kind"),
    [
        ("resonance", "ar2"),
        ("drift", "ar2"),
        ("fractional", "fractional"),
        ("undecided", "fractional"),
    ],
)
def test_a_resonance_is_not_given_as_fractional(verdict: VerdictKind, kind: str) -> None:
    """The fractional model has one with α = 1.9, too, and may win by a hair: its rival is what it is."""
    p = periodogram(ar((1.5, -0.9), 3000, 1, 14)[0], H)
    found = contest(p, fit_all(p))
    assert found.best_rival == "ar2"
    won = msgspec.structs.replace(found, best="fractional")
    assert identified(won, verdict, (), 1.0, H).noise.__struct_config__.tag == kind


@pytest.mark.parametrize("suffix", ["csv", "npz"])
def test_simulation_file(suffix: str, tmp_path: Path) -> None:
    write_models(tmp_path / "m.json", MODELS)
    out = tmp_path / f"a.{suffix}"
    usual = {"n": 500, "range_dps": 2000.0, "offset_dps": 1.5, "seed": 3}
    write_model_simulation(out, tmp_path / "m.json", lsb_per_dps=None, **usual)
    found = read_csv(out) if suffix == "csv" else read_npz(out)
    assert found.rate_hz == pytest.approx(100)
    expected = draw(MODELS.axes["gyro_y"], H, 500, np.random.default_rng((3, 1)))[0] + 1.5
    assert found.gyro[:, 1].tolist() == expected.tolist()
    write_model_simulation(out, tmp_path / "m.json", lsb_per_dps=16.4, **usual)
    found = read_csv(out) if suffix == "csv" else read_npz(out)
    counted = found.gyro if suffix == "npz" else found.gyro * 16.4
    assert counted[:, 1] == pytest.approx(np.rint(expected * 16.4), abs=1e-9)


@pytest.mark.parametrize(
    ("changes", "word"), [({"n": 0}, "--samples"), ({"offset_dps": float("nan")}, "--offset")]
)
def test_simulation_that_cannot_be(changes: dict[str, object], word: str, tmp_path: Path) -> None:
    write_models(tmp_path / "m.json", MODELS)
    usual = {"n": 10, "lsb_per_dps": None, "range_dps": 2000.0, "offset_dps": 0.0, "seed": 1}
    with pytest.raises(UsageError, match=word):
        write_model_simulation(tmp_path / "a.csv", tmp_path / "m.json", **usual | changes)
    with pytest.raises(UsageError, match=r"\.csv or \.npz"):
        write_model_simulation(tmp_path / "a.txt", tmp_path / "m.json", **usual)


def test_imu_yaml() -> None:
    y = white(20_000, 2, 1) * [[0.1], [0.2]]
    walk = np.cumsum(white(20_000, 1, 2)[0]) * 0.5 * np.sqrt(H)
    both = {"gyro_x": allan(y[0], H), "gyro_y": allan(y[1], H)}
    hostile = 'a: b # "c'
    assert yaml.safe_load(imu_yaml_of(both, 100.0, "rest.npz", rostopic=hostile))["rostopic"] == hostile
    assert "\nx:" not in imu_yaml_of(both, 100.0, "rest.npz", rostopic="/imu\nx: 1")
    text = imu_yaml_of(both, 99.32, "rest\n.npz", rostopic="/imu7")
    found = yaml.safe_load(text)
    assert set(found) == {"gyroscope_noise_density", "update_rate", "rostopic"}
    assert found["gyroscope_noise_density"] == pytest.approx(np.radians(0.2 * 0.1), rel=0.03)
    assert (found["update_rate"], found["rostopic"]) == (99.32, "/imu7")
    assert "of gyro_y" in text
    assert "# gyroscope_random_walk:  # rad/s^2/sqrt(Hz); not known: the curve does not rise" in text
    assert "# accelerometer_noise_density:" in text
    both["gyro_z"] = allan(y[0] + walk, H)
    found = yaml.safe_load(imu_yaml_of(both, 100.0, "rest.npz"))
    assert found["gyroscope_random_walk"] == pytest.approx(np.radians(0.5), rel=0.3)
    assert found["gyroscope_noise_density"] == pytest.approx(np.radians(0.2 * 0.1), rel=0.03)


def test_imu_yaml_of_both_sensors() -> None:
    """Four entries in the units of Kalibr, and what inflation makes of them."""
    y = white(20_000, 1, 1)[0]
    walk = np.cumsum(white(20_000, 1, 2)[0]) * 0.5 * np.sqrt(H)
    curves = {"gyro_x": allan(y + walk, H), "accel_y": allan(9.8 + 0.2 * y + 0.1 * walk, H, "m/s²")}
    found = yaml.safe_load(imu_yaml_of(curves, 100.0, "rest.npz"))
    assert len(found) == 6
    assert found["accelerometer_noise_density"] == pytest.approx(0.2 * 0.1, rel=0.05)
    assert found["accelerometer_random_walk"] == pytest.approx(0.05, rel=0.3)
    assert found["gyroscope_random_walk"] == pytest.approx(np.radians(0.5), rel=0.3)
    text = imu_yaml_of(curves, 100.0, "rest.npz", inflation=Inflation(5.0, 10.0))
    assert "# Inflated: noise densities 5 times and random walks 10 times" in text
    assert f"5 times the measured {found['accelerometer_noise_density']:.6e}" in text
    larger = yaml.safe_load(text)
    for key, value in found.items():
        factor = 5 if "density" in key else 10 if "walk" in key else 1
        assert larger[key] == (pytest.approx(factor * value, rel=1e-5) if factor > 1 else value)
    only = imu_yaml_of({"accel_y": curves["accel_y"]}, 100.0, "rest.npz")
    assert "# gyroscope_noise_density:  # rad/s/sqrt(Hz); not known: no axis was analysed" in only


def test_a_model_of_an_accelerometer_is_not_simulated(tmp_path: Path) -> None:
    models = NoiseModels(100.0, H, "rest.npz", {}, {"accel_z": AxisModel(KINDS["white"])})
    write_models(tmp_path / "m.json", models)
    assert read_models(tmp_path / "m.json") == models
    with pytest.raises(UsageError, match="no axis of a gyroscope"):
        write_model_simulation(
            tmp_path / "a.npz", tmp_path / "m.json", n=9, lsb_per_dps=None, range_dps=1, offset_dps=0, seed=1
        )
