"""`fltea simulate --model`: noise of identified models, from the command line."""

from pathlib import Path

import numpy as np
from fltea.identification.model_file import NoiseModels, write_models
from fltea.identification.noise_model import AR1, AxisModel, White
from host_support import QUICK, fltea, strict_records

MODELS = NoiseModels(
    200.0,
    0.005,
    "rest.npz",
    {"gyro_x": AxisModel(White(R_dps2=0.04)), "gyro_y": AxisModel(AR1(R_dps2=0.0, phi=0.9, s2_dps2=0.1))},
)


def test_it_writes_what_run_reads(tmp_path: Path) -> None:
    write_models(tmp_path / "m.json", MODELS)
    flags = ["--model", tmp_path / "m.json", "-n", "800", "--lsb", "131", "--offset", "1.5", "--seed", "4"]
    done = fltea("simulate", tmp_path / "a.npz", *flags)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    with np.load(tmp_path / "a.npz") as found:
        assert found["gyro_raw"].shape == (800, 2)
        assert found["fs_hz"] == 200.0
        assert "true_alpha" not in found
        white, coloured = found["gyro_raw"].T / 131
    assert 0.18 < white.std() < 0.22
    assert np.corrcoef(coloured[1:], coloured[:-1])[0, 1] > 0.8
    assert abs(white.mean() - 1.5) < 0.05
    run = fltea("run", "-s", f"replay:{tmp_path / 'a.npz'}", "--once", *QUICK)
    assert (run.returncode, run.stderr) == (0, "")
    assert strict_records(run.stdout)[-1].samples.delivered == 800


def test_flags_that_the_model_takes_the_place_of(tmp_path: Path) -> None:
    write_models(tmp_path / "m.json", MODELS)
    done = fltea(
        "simulate", tmp_path / "a.npz", "--model", tmp_path / "m.json", "--alpha-end", "0.3", "--q", "1"
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert "leave out --alpha-end, --q." in done.stderr
    assert not (tmp_path / "a.npz").exists()
