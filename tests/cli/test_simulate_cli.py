"""Tests of `fltea simulate`.

The file that it writes can be replayed, a second file has the true values, and a file is either complete or
does not exist.
"""

import csv
from pathlib import Path

import numpy as np
import pytest
from fltea.identification.simulation_file import write_simulation
from fltea.recording.csv_file import open_csv
from fltea.recording.npz_file import open_npz
from fltea.records.errors import FlteaError, UsageError
from fltea.sources.replay import ReplaySource
from fltea.sources.synthetic import NoiseSettings

from tests.rig.blocks import samples_of
from tests.rig.host_support import QUICK, fltea_here, strict_records

USUAL = {"n": 200, "lsb_per_dps": 0.0, "window": 100, "alpha_end": 0.3, "axes": 3}


def simulated(out: Path, **changes: object) -> Path:
    told = USUAL | changes
    alpha_end, axes = told.pop("alpha_end"), told.pop("axes")
    write_simulation(out, NoiseSettings(**told), alpha_end, axes)
    return out


def gyro(path: Path) -> list[tuple[float, ...]]:
    return [raw.gyro for raw in samples_of(ReplaySource(path).events())]


def columns(path: Path) -> dict[str, list[float]]:
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: [float(row[name]) for row in rows] for name in rows[0]}


def test_csv_and_npz_hold_the_same_samples(tmp_path: Path) -> None:
    text, packed = simulated(tmp_path / "a.csv"), simulated(tmp_path / "a.npz")
    assert gyro(text) == gyro(packed)  # both files contain the same samples, to the last bit
    assert open_csv(text).whole().rate_hz == pytest.approx(open_npz(packed).whole().rate_hz) == 100.0
    assert open_npz(packed).whole().lsb_per_dps is None


def test_without_options_the_noise_is_the_usual_one(tmp_path: Path) -> None:
    done = fltea_here("simulate", tmp_path / "a.npz", "--samples", "200")
    assert done.returncode == 0, done.stderr
    expected = simulated(tmp_path / "b.npz", window=3000)
    assert (tmp_path / "a.npz").read_bytes() == expected.read_bytes()


def test_truth_stands_beside_the_samples(tmp_path: Path) -> None:
    text = columns(simulated(tmp_path / "a.csv", R=0.0))
    with np.load(simulated(tmp_path / "a.npz", R=0.0)) as packed:
        for i, axis in enumerate(("gyro_x", "gyro_y", "gyro_z")):
            assert (
                text[f"true_state_{axis}_dps"]
                == text[f"{axis}_dps"]
                == packed["true_state_dps"][:, i].tolist()
            )
        assert set(text["true_alpha"]) == {0.3}
        assert packed["true_alpha"].tolist() == text["true_alpha"]


@pytest.mark.parametrize("suffix", ["csv", "npz"])
def test_same_seed_same_file(suffix: str, tmp_path: Path) -> None:
    first, again, other = (
        simulated(tmp_path / f"{name}.{suffix}", seed=seed).read_bytes()
        for name, seed in (("a", 1), ("b", 1), ("c", 2))
    )
    assert first == again != other


def test_quantised_samples_are_counts(tmp_path: Path) -> None:
    options = {"lsb_per_dps": 16.4, "offset_dps": -3.3}
    packed = open_npz(simulated(tmp_path / "a.npz", **options)).whole()
    assert packed.lsb_per_dps == 16.4
    assert (packed.gyro == np.round(packed.gyro)).all()
    text = open_csv(simulated(tmp_path / "a.csv", **options)).whole()
    assert text.gyro == pytest.approx(packed.gyro / 16.4, abs=1e-12)
    assert text.gyro.mean() == pytest.approx(-3.3, abs=0.2)


def test_range_is_kept(tmp_path: Path) -> None:
    found = open_npz(
        simulated(tmp_path / "a.npz", lsb_per_dps=131.0, range_dps=250.0, offset_dps=400.0)
    ).whole()
    assert set(found.gyro.ravel()) == {250 * 131}


def test_variable_order_is_written(tmp_path: Path) -> None:
    found = columns(simulated(tmp_path / "a.csv", alpha=0.2, alpha_end=0.6, axes=1))
    assert found["true_alpha"] == pytest.approx(np.linspace(0.2, 0.6, 200))
    assert found["true_alpha"][0] == 0.2
    assert found["true_alpha"][-1] == 0.6
    assert "gyro_y_dps" not in found


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_number_of_axes(axes: int, tmp_path: Path) -> None:
    assert {len(sample) for sample in gyro(simulated(tmp_path / "a.csv", axes=axes))} == {axes}


BAD = [
    ({"n": 0}, "--samples ≥ 1"),
    ({"axes": 0}, "--axes 1 to 3"),
    ({"axes": 4}, "--axes 1 to 3"),
    ({"rate_hz": 0.0}, "--rate > 0"),
    ({"rate_hz": -1.0}, "--rate > 0"),
    ({"rate_hz": float("nan")}, "h must be > 0"),
    ({"alpha": float("nan")}, "--alpha has to be a finite number"),
    ({"alpha_end": float("inf")}, "--alpha-end has to be a finite number"),
    ({"offset_dps": float("nan")}, "--offset has to be a finite number"),
    ({"f": 1000.0}, "runs away where f is positive"),
    ({"alpha_end": 2.5}, "alpha = 2.5: such noise runs away"),
    ({"window": 0}, "window must be at least 1"),
    ({"lsb_per_dps": -1.0}, "lsb_per_dps must be > 0"),
    ({"lsb_per_dps": 16.4, "range_dps": 0.0}, "full_scale_dps must be > 0"),
    ({"n": 10**15}, "allocate"),
]


@pytest.mark.parametrize(("changes", "word"), BAD)
def test_impossible_parameters_leave_nothing_behind(changes: dict, word: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError) as caught:
        simulated(tmp_path / "a.csv", **changes)
    assert word in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a", "a.txt", "a.csv.gz", ".csv", "a.NPY"])
def test_other_endings_are_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"give a name that ends in \.csv or \.npz"):
        simulated(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_folder_that_is_none(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for folder in ("none", "file"):
        with pytest.raises(FlteaError, match="cannot be written"):
            simulated(tmp_path / folder / "a.csv")
    (tmp_path / "a.csv").mkdir()
    with pytest.raises(FlteaError, match="cannot be written"):
        simulated(tmp_path / "a.csv")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "file"]


@pytest.mark.parametrize("name", ["noise.csv", "varying.npz"])
def test_command_writes_what_run_reads(name: str, tmp_path: Path) -> None:
    flags = ["--alpha", "0.2", "--alpha-end", "0.6", "--lsb", "16.4", "-n", "300", "--window", "100"]
    result = fltea_here("simulate", tmp_path / name, *flags, "--axes", "2", "--offset", "1.5", "--seed", "4")
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    run = fltea_here("run", "-s", f"replay:{tmp_path / name}", "--once", *QUICK)
    assert (run.returncode, run.stderr) == (0, "")
    last = strict_records(run.stdout)[-1]
    assert last.sample_counts.delivered == 300
    assert [*last.axes] == ["gyro_x", "gyro_y"]
    assert last.axes["gyro_x"].bias == pytest.approx(1.5, abs=0.2)


@pytest.mark.parametrize("lsb", ["0", "nan"])
def test_no_count_a_degree_is_an_error(lsb: str, tmp_path: Path) -> None:
    result = fltea_here("simulate", tmp_path / "a.csv", "--lsb", lsb, "-n", "10")
    assert (result.returncode, result.stdout) == (2, "")
    assert "--lsb has to be above 0" in result.stderr
