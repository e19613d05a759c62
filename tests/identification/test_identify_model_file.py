"""Tests that identified models are written to files and read again, and that noise is simulated from them."""

import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from fltea.identification.axis import IdentifyOptions, analyse
from fltea.identification.load import GYRO_UNIT, Series
from fltea.identification.model_file import NoiseModels, read_models, write_json
from fltea.identification.noise_model import AxisModel, Lorentzian, draw, draws, model_spectrum, modelled
from fltea.identification.simulation_file import write_model_simulation
from fltea.noise.filters import HighPass, LowPass, Mean, Notch, Sharpening
from fltea.noise.parts import AnyPart, Floor, Order, Quantisation, Relaxation, Rise, Walk, White
from fltea.recording.csv_file import open_csv
from fltea.recording.npz_file import open_npz
from fltea.records.errors import FlteaError, UsageError
from fltea.sources.synthetic import NoiseSettings
from fltea.spectrum.periodogram import binned, periodogram
from fltea.spectrum.spectral_lines import Peak
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from tests.rig.host_support import QUICK, fltea, strict_records
from tests.rig.identify_one import identify_series
from tests.rig.identify_support import H, ar, white
from tests.rig.model_support import EXAMPLES
from tests.rig.model_support import PARTS as ANY

OPTIONS = IdentifyOptions(shuffles=0)
PARTS: dict[str, tuple[AnyPart, ...]] = {
    # the spectrum of a walk has a test of its own, since the periodogram of a walk is wrong by leakage
    **{kind: (White(0.1), part) for kind, part in EXAMPLES.items() if not part.has("no high-pass")},
    "white": (White(0.04),),
    "relaxations": (White(0.01), Relaxation(0.05, 1.0), Relaxation(0.1, 0.02)),
    "quantised": (White(0.001), Relaxation(0.05, 0.1), Quantisation(3e-4)),
    "rise, sharpened": (White(0.01), Rise(0.03, 0.7), Sharpening(0.1)),
    "filtered": (White(0.04), Relaxation(0.1, 0.5), LowPass(20.0, 2.0), Floor(0.001)),
    "coupled": (White(0.04), Relaxation(0.1, 0.1), HighPass(0.5, 2.0)),
    "mean, notch": (White(0.04), Mean(3), Notch(10.0, 3.0), Floor(0.01)),
    "order": (White(0.02), Order(0.6, -3.0, 0.15)),
    "long memory": (White(0.0), Order(0.4, 0.0, 1.0)),
}
LINE = Lorentzian(frequency_hz=31.4, width_hz=0.8, variance=0.01)
MODELS = NoiseModels(
    100.0, H, "rest.npz", {"gyro_x": AxisModel(PARTS["order"], (LINE,)), "gyro_y": AxisModel(PARTS["white"])}
)
positive = st.floats(1e-12, 1e6)
lines = st.builds(
    Lorentzian, frequency_hz=st.floats(1e-3, 49.9), width_hz=st.floats(1e-4, 50), variance=positive
)
axis_models = st.builds(
    AxisModel,
    st.lists(st.one_of(*ANY.values()), max_size=3).map(lambda found: (White(1.0), *found)),
    st.lists(lines, max_size=3).map(tuple),
    st.floats(0, 1e3),
)


@settings(max_examples=30, deadline=None)
@given(axis_models, axis_models, st.text(max_size=20))
def test_round_trip(x: AxisModel, y: AxisModel, source: str) -> None:
    models = NoiseModels(100.0, H, source, {"gyro_x": x, "gyro_y": y}, {"accel_z": y})
    assert msgspec.json.decode(msgspec.json.encode(models), type=NoiseModels) == models


@pytest.mark.parametrize("kind", EXAMPLES)
def test_each_part_is_in_a_file(kind: str, tmp_path: Path) -> None:
    models = NoiseModels(100.0, H, "rest.npz", {"gyro_x": AxisModel((White(1.0), EXAMPLES[kind]))})
    write_json(tmp_path / "m.json", models)
    assert read_models(tmp_path / "m.json") == models


def test_file(tmp_path: Path) -> None:
    path = tmp_path / "m.json"
    write_json(path, MODELS)
    assert read_models(path) == MODELS
    assert list(tmp_path.iterdir()) == [path]
    written = json.loads(path.read_text())
    assert written["axes"]["gyro_x"]["parts"] == [
        {"part": "white", "R": 0.02},
        {"part": "order", "alpha": 0.6, "f": -3.0, "Q": 0.15},
    ]
    assert (written["format"], written["version"], written["h_s"]) == ("fltea-noise-model", 5, 0.01)


def bad(**changes: object) -> str:
    return json.dumps(msgspec.to_builtins(MODELS) | changes)


def only(axis: str, **part: object) -> dict[str, object]:
    return {axis: {"parts": [{"part": "white", "R": 1.0}, part]}}


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "is no noise model"),
        ("[]", "is no noise model"),
        ("{}", "--export-model"),
        ("\x00\xff", "is no noise model"),
        ('{"format": "other", "version": 1}', "--export-model"),
        (bad(version=6), "version 6; this fltea reads versions 4 to 5"),
        (bad(version="1"), "is no noise model"),
        (bad(axes=only("gyro_x", part="pink")), "pink"),
        (bad(axes=only("gyro_x", part="order", alpha=2.0, f=-1.0, Q=1.0)), "not stationary"),
        (bad(axes=only("gyro_x", part="order", alpha="x", f=-1.0, Q=1.0)), "float"),
        (bad(axes=only("gyro_x", part="order", alpha=0.6, f=3.0, Q=1.0)), "gyro_x: α = 0.6, f = 3 is not"),
        (bad(axes=only("gyro_x", part="white", R=-1.0)), "R must be 0 or more"),
        (bad(axes=only("gyro_x", part="relaxation", sigma=-1.0, tau_s=1.0)), "sigma must be 0 or more"),
        (bad(axes=only("gyro_x", part="relaxation", sigma=1.0, tau_s=0.0)), "a relaxation cannot have"),
        (bad(axes=only("gyro_x", part="walk", K=-1.0)), "K must be"),
        (bad(axes={"gyro_x": {"parts": [], "offset_walk": -1.0}}), "offset_walk must be 0 or more"),
        (bad(h_s=0.02), "h_s"),
        (bad(rate_hz=0.0), "rate_hz must be > 0"),
        (bad(axes={}), "axes must be the first of gyro_x"),
        (bad(accel_axes=only("gyro_x", part="white", R=1.0)), "accel_axes must be among accel_x"),
        (bad(axes=only("gyro_z", part="white", R=1.0)), "got gyro_z"),
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
        write_json(tmp_path / "none" / "m.json", MODELS)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", PARTS)
def test_noise_has_the_spectrum_of_its_model(name: str) -> None:
    model = AxisModel(PARTS[name], (LINE,))
    n, series = 4096, 60
    rng = np.random.default_rng(1)
    drawn = np.array([draw(model, H, n, rng)[0] for _ in range(series)])
    data = binned(periodogram(drawn, H))
    fine = periodogram(drawn[0], H)
    expected = binned(fine._replace(power=model_spectrum(model, fine.lam, H))).power[0]
    # at lower frequencies, the periodogram is wrong by leakage from the lowest frequencies
    use = data.lam > 0.02
    off = (data.power.mean(axis=0) / expected - 1)[use] * np.sqrt(series * data.counts[use])
    assert np.abs(off).max() < 6
    assert abs(off.mean()) < 1


def test_a_walk_goes_as_far_as_a_walk_does() -> None:
    """The distance of a simulated random walk from its start has the right variance, up to the record's end.

    Periodic noise with the walk's spectrum would have only three quarters of this variance at the end.
    """
    n = 1 << 14
    many = draws(AxisModel((Walk(1.0),)), H, n, np.random.default_rng(2))
    steps = np.array([(y[-1] - y[0], y[1000] - y[0]) for y, _ in (next(many) for _ in range(600))])
    expected = np.array([n - 1, 1000]) * H
    np.testing.assert_allclose(steps.var(axis=0) / expected, 1, atol=4 * np.sqrt(2 / 600))


@pytest.mark.parametrize("name", ["white", "AR(1)", "AR(2)", "order"])
def test_a_model_has_the_spectrum_of_what_was_identified(name: str) -> None:
    n = 20_000
    y = {
        "white": lambda: white(n, 1, 1)[0],
        "AR(1)": lambda: ar((0.9,), n, 1, 2)[0] + white(n, 1, 3)[0],
        "AR(2)": lambda: ar((1.5, -0.9), n, 1, 14)[0] + white(n, 1, 15)[0],
        "order": lambda: draw(AxisModel(PARTS["order"]), H, n, np.random.default_rng(3))[0],
    }[name]()
    analysis = analyse(y, H)
    peak = Peak("line", 20.0, 0.1, 0.01, 5.0, (19.0, 21.0))
    model = modelled(analysis.figures.model, (peak,), 2.0, H)
    assert model.resonances == (Lorentzian(20.0, 0.1, 0.04),)
    data = analysis.summed.seen.evidence.candidates.data
    off = (data.power[0] / model_spectrum(AxisModel(model.parts), data.lam, H) - 1) * np.sqrt(data.counts)
    assert np.abs(off[data.counts >= 8]).max() < 5
    assert abs(off.mean()) < 0.3


@pytest.mark.parametrize("suffix", ["csv", "npz"])
def test_simulation_file(suffix: str, tmp_path: Path) -> None:
    write_json(tmp_path / "m.json", MODELS)
    out = tmp_path / f"a.{suffix}"
    usual = NoiseSettings(n=500, lsb_per_dps=0.0, offset_dps=1.5, seed=3)
    write_model_simulation(out, tmp_path / "m.json", usual)
    found = open_csv(out).whole() if suffix == "csv" else open_npz(out).whole()
    assert found.rate_hz == pytest.approx(100)
    expected = draw(MODELS.axes["gyro_y"], H, 500, np.random.default_rng((3, 1)))[0] + 1.5
    assert found.gyro[:, 1].tolist() == expected.tolist()
    write_model_simulation(out, tmp_path / "m.json", replace(usual, lsb_per_dps=16.4))
    found = open_csv(out).whole() if suffix == "csv" else open_npz(out).whole()
    counted = found.gyro if suffix == "npz" else found.gyro * 16.4
    assert counted[:, 1] == pytest.approx(np.rint(expected * 16.4), abs=1e-9)


@pytest.mark.parametrize(
    ("name", "changes", "word"),
    [
        ("a.csv", {"n": 0}, "--samples"),
        ("a.csv", {"offset_dps": float("nan")}, "--offset"),
        ("a.txt", {}, r"\.csv or \.npz"),
    ],
)
def test_simulation_that_cannot_be(name: str, changes: dict[str, Any], word: str, tmp_path: Path) -> None:
    write_json(tmp_path / "m.json", MODELS)
    usual = NoiseSettings(n=10, lsb_per_dps=0.0)
    with pytest.raises(UsageError, match=word):
        write_model_simulation(tmp_path / name, tmp_path / "m.json", replace(usual, **changes))
    accel = NoiseModels(100.0, H, "rest.npz", {}, {"accel_z": AxisModel(PARTS["white"])})
    write_json(tmp_path / "accel.json", accel)
    assert read_models(tmp_path / "accel.json") == accel
    with pytest.raises(UsageError, match="no gyroscope axis"):
        write_model_simulation(tmp_path / "a.npz", tmp_path / "accel.json", usual)


def test_the_command_writes_what_run_reads(tmp_path: Path) -> None:
    coloured = AxisModel((White(0.0), Relaxation(0.7, 0.05)))
    write_json(
        tmp_path / "m.json",
        NoiseModels(200.0, 0.005, "rest.npz", {"gyro_x": AxisModel(PARTS["white"]), "gyro_y": coloured}),
    )
    flags = ["--model", tmp_path / "m.json", "-n", "800", "--lsb", "131", "--offset", "1.5", "--seed", "4"]
    done = fltea("simulate", tmp_path / "a.npz", *flags)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    with np.load(tmp_path / "a.npz") as found:
        assert found["gyro_raw"].shape == (800, 2)
        assert found["fs_hz"] == 200.0
        assert "true_alpha" not in found
        flat, slow = found["gyro_raw"].T / 131
    assert 0.18 < flat.std() < 0.22
    assert np.corrcoef(slow[1:], slow[:-1])[0, 1] > 0.8
    assert abs(flat.mean() - 1.5) < 0.05
    run = fltea("run", "-s", f"replay:{tmp_path / 'a.npz'}", "--once", *QUICK)
    assert (run.returncode, run.stderr) == (0, "")
    assert strict_records(run.stdout)[-1].sample_counts.delivered == 800
    done = fltea(
        "simulate", tmp_path / "b.npz", "--model", tmp_path / "m.json", "--alpha-end", "0.3", "--q", "1"
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert "leave out --alpha-end, --q." in done.stderr
    assert not (tmp_path / "b.npz").exists()


@pytest.mark.slow
def test_the_offset_walks_in_a_simulation_as_in_the_forecast() -> None:
    """The spectrum does not show the random walk of the offset. So the model has it beside its noise parts.

    Simulated recordings include this walk. So their forecasts agree with that of the original recording.
    """
    y = draw(AxisModel((White(0.01), Walk(0.0007))), H, 60_000, np.random.default_rng(2))[0]
    found = identify_series(Series(y, GYRO_UNIT, None), H, OPTIONS, False)
    assert "walk" not in found.result.made_of
    assert found.model.offset_walk == pytest.approx(0.0007, rel=0.5)
    assert found.now is not None
    stds = []
    for seed in range(6):
        again = draw(found.model, H, 60_000, np.random.default_rng((3, seed)))[0]
        now = identify_series(Series(again, GYRO_UNIT, None), H, OPTIONS, False).now
        assert now is not None
        stds.append(now.heading_std)
    assert np.median(stds) == pytest.approx(found.now.heading_std, rel=0.3)


def test_a_file_without_a_walk_of_the_offset_is_read(tmp_path: Path) -> None:
    text = msgspec.json.decode(bad(version=4).encode())
    for axis in text["axes"].values():
        axis.pop("offset_walk")
    (tmp_path / "m.json").write_bytes(msgspec.json.encode(text))
    assert read_models(tmp_path / "m.json").axes["gyro_x"].offset_walk == 0.0


def test_an_offset_that_walks_within_bounds_is_in_the_file_and_in_the_noise(tmp_path: Path) -> None:
    relaxation = Relaxation(0.05, 10.0)
    model = AxisModel((White(0.01),), offset_relaxation=relaxation)
    write_json(tmp_path / "m.json", NoiseModels(1 / H, H, "a", {"gyro_x": model}, {}))
    again = read_models(tmp_path / "m.json").axes["gyro_x"]
    assert again == model
    lam = np.geomspace(1e-4, np.pi, 20)
    parts = AxisModel((White(0.01), relaxation))
    np.testing.assert_allclose(model_spectrum(again, lam, H), model_spectrum(parts, lam, H))
