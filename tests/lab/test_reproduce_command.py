"""Tests of `fltea reproduce` and `fltea bench` as users call them."""

import csv
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea.lab import bench as bench_estimator
from fltea.lab.reproduce import open_choices, timing
from fltea.lab.reproduce.scenarios import example

from tests.rig.host_support import fltea_here

Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def fltea(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Call:
    """Return a function that runs fltea in an empty folder, and returns exit code, stdout and stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> tuple[int, str, str]:
        done = fltea_here(*arguments)
        return done.returncode, done.stdout, done.stderr

    return call


def numbers(value: Any) -> list[Any]:
    """Return every value in a JSON document that is not a text, a list or an object."""
    if isinstance(value, dict):
        return [n for v in value.values() for n in numbers(v)]
    if isinstance(value, list):
        return [n for v in value for n in numbers(v)]
    return [] if isinstance(value, str) else [value]


def test_json_is_one_object_of_the_documented_form(fltea: Call, tmp_path: Path) -> None:
    code, out, _ = fltea(
        "reproduce", "--table", "2", "--table", "3", "--table", "5", "--seeds", "3", "--json"
    )
    assert code == 0
    assert out.count("\n") == 1
    result = json.loads(out)
    assert list(result) == ["tables", "exchange"]
    assert result["exchange"]["inference"] == "too few seeds"
    assert list(result["tables"]) == ["2", "3", "5"]
    assert [row["L"] for row in result["tables"]["2"]] == [4000, 3000, 2500, 2000]
    assert [(row["example"], row["L"]) for row in result["tables"]["3"]] == [
        (2, 4000),
        (2, 2000),
        (3, 4000),
        (3, 2000),
    ]
    assert [row["axis"] for row in result["tables"]["5"]] == ["x", "y", "z"]
    for rows in result["tables"].values():
        for row in rows:
            assert row["seeds"] == 3
            assert 0 <= row["not_finite"] + row["far_off"] <= 3
            for name in ("state", "parameter", "order"):
                assert list(row[name]) == ["median", "p05", "p95", "paper", "percentile"]
                assert 0 <= row[name]["percentile"] <= 100
                assert row[name]["p05"] <= row[name]["median"] <= row[name]["p95"]
            assert (row["variant"], row["guard"]) == ("triple", "off")
    assert all(n is None or np.isfinite(n) for n in numbers(result))
    assert "in place of a recording" in result["tables"]["5"][0]["data"]
    assert not list(tmp_path.iterdir())


def test_a_table_for_people_says_what_went_in(fltea: Call) -> None:
    code, out, _ = fltea("reproduce", "-t", "3", "--seeds", "2", "--amplitude", "0.5", "--guard", "faithful")
    assert code == 0
    assert "Table 3" in out
    assert "saw-tooth ±0.5, 1 Hz" in out
    assert "Variant triple, guard faithful" in out
    assert "1663" in out
    assert "example 3, exchanged" in out
    assert "Are tables 3 and 4 exchanged in print? Too few seeds to tell" in out


def test_the_same_seeds_give_the_same_tables(fltea: Call) -> None:
    first, again = (fltea("reproduce", "-t", "4", "--seeds", "2", "--json")[1] for _ in range(2))
    assert first == again


def test_table_1_times_engine_and_reference(fltea: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "example", lambda number, sawtooth: example(number, sawtooth, 200))
    rows = json.loads(fltea("reproduce", "--table", "1", "--json")[1])["tables"]["1"]
    assert [row["paper_s"] for row in rows] == [230.75, 218.76, 195.30, 183.55]
    for row in rows:
        assert all(row[key] > 0 for key in ("direct_s", "compressed_s", "reference_s"))


def test_readings_are_told_as_json_and_for_people(fltea: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    compare = open_choices.compare
    monkeypatch.setattr(
        open_choices, "compare", lambda seeds, told: compare(seeds, told, open_choices.CHOICES[:2], 60)
    )
    code, out, _ = fltea("reproduce", "--readings", "--seeds", "2", "--json")
    assert code == 0
    rows = json.loads(out)["readings"]
    assert [row["seeds"] for row in rows] == [2, 2]
    assert "| saw-tooth ±1.2 | 0 + 0: " in fltea("reproduce", "--readings", "--seeds", "2")[1]


@pytest.mark.slow
def test_figures_are_drawn_and_not_blank(fltea: Call, tmp_path: Path) -> None:
    image = pytest.importorskip("matplotlib.image")
    wanted = ["2", "13", "6.2"]
    flags = [flag for figure in wanted for flag in ("--figure", figure)]
    code, out, err = fltea("reproduce", *flags, "--seeds", "2", "--out", "pictures")
    assert code == 0, err
    assert out.strip() == ""
    names = ["figure-02", "figure-13", "section-6.2"]
    assert sorted(path.stem for path in (tmp_path / "pictures").iterdir()) == names
    for name in names:
        pixels = image.imread(tmp_path / "pictures" / f"{name}.png")[..., :3]
        assert pixels.shape[0] > 400
        assert pixels.shape[1] > 800
        # some pixels are dark, so the page of the PDF shows a curve
        assert 0.001 < np.mean(pixels.min(axis=-1) < 0.9) < 0.9
        coloured = np.ptp(pixels, axis=-1) > 0.2
        assert coloured.sum() > 500


def test_a_folder_gets_a_line_a_seed(fltea: Call, tmp_path: Path) -> None:
    _, out, _ = fltea("reproduce", "--table", "4", "--table", "6.2", "--seeds", "3", "--out", "all")
    assert sorted(path.name for path in (tmp_path / "all").iterdir()) == [
        "section-6.2.csv",
        "table-04.csv",
        "tables.md",
    ]
    assert (tmp_path / "all/tables.md").read_text() == out
    with (tmp_path / "all/table-04.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["run"], row["L"], row["seed"]) for row in rows] == [
        (example, L, s) for example in "32" for L in ("4000", "2000") for s in "012"
    ]
    assert {row["not_finite"] for row in rows} | {row["far_off"] for row in rows} <= {"True", "False"}
    with (tmp_path / "all/section-6.2.csv").open() as file:
        assert {row["run"] for row in csv.DictReader(file)} == {"white", "fractional"}


def test_a_recording_is_used_and_named(fltea: Call, tmp_path: Path) -> None:
    noise = np.random.default_rng(1).normal(0.5, 0.1, (3000, 1))
    np.savez(tmp_path / "rest.npz", gyro_dps=noise, fs_hz=100.0)
    code, out, _ = fltea("reproduce", "--table", "5", "--recording", "rest.npz", "--json")
    assert code == 0
    rows = json.loads(out)["tables"]["5"]
    assert [(row["axis"], row["seeds"]) for row in rows] == [("x", 1)]
    assert rows[0]["data"] == "recording rest.npz, 100 Hz, R = its variance"
    code, _, err = fltea("reproduce", "--figure", "16", "--recording", "rest.npz")
    assert (code, "no y axis" in err) == (2, True)


def test_real_recordings_run(fltea: Call, recordings: Path) -> None:
    file = recordings / "mpu6050_tomisuarez_100s.npz"
    rows = json.loads(fltea("reproduce", "-t", "5", "--recording", str(file), "--json")[1])["tables"]["5"]
    assert [(row["not_finite"], row["far_off"]) for row in rows] == [(0, 0)] * 3


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--table", "7"], "tables 1 to 5"),
        (["--table", "two"], "tables 1 to 5"),
        (["--figure", "1"], "diagram"),
        (["--figure", "11"], "photograph"),
        (["--figure", "21"], "2 to 10 and 12 to 20"),
        (["--table", "2", "--period", "0"], "period"),
        (["--table", "2", "--amplitude", "nan"], "amplitude"),
        (["--table", "2", "--recording", "rest.npz"], "table 5"),
        (["--table", "5", "--recording", "rest.npz"], "no such file"),
        (["--table", "5", "--rate", "100"], "--recording"),
        (["--table", "2", "--out", "/dev/null/here"], "cannot be written"),
        (["--table", "2", "--seeds", "0"], "seeds"),
        (["--table", "2", "--guard", "some"], "guard"),
        (["--variant", "quadruple"], "variant"),
        (["--readings", "--table", "3"], "own cases"),
        (["--readings", "--amplitude", "2"], "own cases"),
        (["--readings", "--score"], "own cases"),
    ],
)
def test_bad_requests_end_with_2_and_the_reason(fltea: Call, arguments: list[str], reason: str) -> None:
    code, out, err = fltea("reproduce", *arguments)
    assert code == 2
    assert out == ""
    assert reason in err
    assert "Traceback" not in err


def test_without_matplotlib_tables_work_and_figures_say_what_to_do(
    fltea: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    code, _, err = fltea("reproduce", "--figure", "2")
    assert code == 2
    assert "pip install -e '.[plot]'" in err
    assert fltea("reproduce", "--table", "4", "--seeds", "1")[0] == 0


def test_bench_reports_every_figure(fltea: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    measure = bench_estimator.measure
    monkeypatch.setattr(bench_estimator, "measure", lambda repetitions: measure(repetitions, scale=0.002))
    code, out, _ = fltea("bench", "estimator", "--json", "--repetitions", "1")
    assert code == 0
    result = json.loads(out)
    speed = result["axis_steps_per_s"]
    assert {"engine_compressed", "engine_direct", "reference", "filterpy_ukf"} < set(speed)
    assert list(speed["engine_compressed_lanes"]) == [str(2**i) for i in range(11)]
    windows = ["1000", "10000", "100000", "1000000", "unlimited"]
    assert list(result["ns_per_step_by_window"]) == windows
    assert list(result["bytes_per_lane"]) == windows
    assert result["paper_samples_per_s"] == pytest.approx(17.33, abs=0.01)
    assert set(result["ratios"]) == set(bench_estimator.TARGETS)
    assert all(n is None or n > 0 for n in numbers(result))
    text = bench_estimator.text(result)
    assert "numpy reference" in text
    assert "at least 100" in text


def test_bench_does_without_filterpy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "filterpy.kalman", None)
    result = bench_estimator.measure(1, scale=0.001)
    assert result["axis_steps_per_s"]["filterpy_ukf"] is None
    assert result["ratios"]["compressed_over_filterpy"] is None
    assert "-e '.[bench]'" in bench_estimator.text(result)


def test_bench_knows_one_thing(fltea: Call) -> None:
    assert fltea("bench", "decoder")[0] == 2
