"""Tests of `fltea identify` as a user runs it: table, JSON, files, exit codes."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from fltea.cli.identify_options import parse_notch
from fltea.identification.model_file import read_models
from fltea.records.errors import UsageError
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.bag_support import even, write_bag
from tests.rig.host_support import fltea, fltea_here
from tests.rig.identify_files import counts, npz
from tests.rig.identify_support import ar, white

FAST = ("--jobs", "1", "--startup", "100", "--window", "100", "--shuffles", "5")


def strict(text: str) -> dict[str, Any]:
    def refuse(name: str) -> float:
        raise AssertionError(f"{name} is not JSON")

    found: dict[str, object] = json.loads(text, parse_constant=refuse)
    return found


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write two axes: white noise, and white noise with a spectral line at 20 Hz."""
    raw = counts(3000, 2)
    raw[:, 1] += np.rint(10 * np.sin(2 * np.pi * 20 * np.arange(3000) / 100)).astype(np.int32)
    return npz(tmp_path_factory.mktemp("command") / "rest.npz", raw)


def here(*arguments: object, exit_code: int = 0) -> tuple[str, str]:
    """Run the command in this process, which has loaded all modules. Return its stdout and stderr."""
    done = fltea_here("identify", *arguments, *FAST, columns=300)
    assert done.returncode == exit_code, done.stderr
    assert "Traceback" not in done.stderr
    return done.stdout, done.stderr


def test_json(recording: Path) -> None:
    """stdout has only the JSON, and stderr nothing."""
    done = fltea("identify", recording, "--json", *FAST)
    assert (done.returncode, done.stderr) == (0, "")
    (file,) = strict(done.stdout)["files"]
    assert file["file"] == str(recording)
    assert list(file["axes"]) == ["gyro_x", "gyro_y"]
    for axis in file["axes"].values():
        assert {"alpha", "alpha_std", "f", "f_std", "R", "R_from"} <= set(axis["fltea"])
        assert 0 <= axis["null"]["p_value"] <= 1
        assert axis["null"]["shuffled"]["copies"] == 5
        assert {"F", "alpha", "f", "s2", "R", "arfima"} == set(axis["order"])
        said = {"kind", "text", "what", "why", "next", "rules", "odds", "has_order", "order"}
        assert said == set(axis["verdict"])
        assert axis["unit"] == "deg/s"
        assert axis["allan"]["N"]["value"] == pytest.approx(16 / 131 / 10, rel=0.1)
        assert axis["fltea"]["variant"] == "joint"
        assert axis["fltea"]["settings"]["window"] == 100
        assert isinstance(axis["fltea"]["converged"], bool)
        assert isinstance(axis["fltea"]["alpha_drift"], float)
    assert file["axes"]["gyro_x"]["verdict"]["kind"] == "white"
    assert file["axes"]["gyro_x"]["order"]["alpha"]["value"] is None
    assert file["axes"]["gyro_y"]["verdict"]["kind"] == "line"
    assert "line" in [data_check["kind"] for data_check in file["axes"]["gyro_y"]["data_checks"]]


def test_every_data_check_is_told(tmp_path: Path) -> None:
    """The three axes have different faults.

    The first axis has drift, torn reads and a resonance, the second has coarse counts, and the third has
    outliers and a spectral line.

    Samples are repeated on all axes.
    """
    n = 6000
    k = np.arange(n)
    x = 16 * white(n, 1, 1)[0] + 40 + k * (48 / n) + 3 * ar((2 * 0.97 * np.cos(1.2), -(0.97**2)), n, 1, 2)[0]
    x[1000::2000] += 256
    z = 16 * white(n, 1, 4)[0] + 10 * np.sin(2 * np.pi * 20 * k / 100)
    z[500::1500] += 500
    raw = np.rint(np.stack([x, 0.8 * white(n, 1, 3)[0], z], axis=1)).astype(np.int32)
    raw[31::40] = raw[30::40]
    path = npz(tmp_path / "bad.npz", raw, t_host_s=k / 99)
    (file,) = strict(here(path, "--json")[0])["files"]
    assert {data_check["kind"] for data_check in file["data_checks"]} == {"repeated", "sample rate"}
    assert file["clock_ppm"] == pytest.approx(-10_000, rel=0.05)
    found = {
        name: {data_check["kind"]: data_check["text"] for data_check in axis["data_checks"]}
        for name, axis in file["axes"].items()
    }
    assert set(found["gyro_x"]) == {"short", "offset", "drift", "torn reads", "resonance"}
    assert set(found["gyro_y"]) == {"short", "quantisation"}
    assert set(found["gyro_z"]) == {"short", "outliers", "line"}
    assert "3 jumps of ±256 LSB" in found["gyro_x"]["torn reads"]
    assert "σ is 0.8" in found["gyro_y"]["quantisation"]
    assert "20 Hz" in found["gyro_z"]["line"]


def test_from_a_bag_to_imu_yaml_with_its_topic(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "drive.bag", {"/cam/imu": even(900)}, words=["/chatter"])
    assert "200 Hz, 900 samples, 4.5 s" in here(bag, "--imu-yaml", tmp_path / "imu.yaml")[0]
    found = yaml.safe_load((tmp_path / "imu.yaml").read_text())
    assert (found["rostopic"], found["update_rate"]) == ("/cam/imu", 200)
    assert found["gyroscope_noise_density"] == pytest.approx(1e-3 / np.sqrt(200), rel=0.2)
    assert "accelerometer_noise_density" in found


def test_both_sensors_in_one_command(tmp_path: Path) -> None:
    """For imu.yaml the accelerometer is identified, too, except an axis that is constant.

    All written files have both sensors, the gyroscope and the accelerometer.
    """
    accel = counts(900, seed=3)
    accel[:, 1] = 0
    path = npz(tmp_path / "a.npz", counts(900), accel_raw=accel, accel_lsb_per_g=16384.0)
    imu, model, filter_ = (tmp_path / name for name in ("imu.yaml", "model.json", "filter.json"))
    files = ("--imu-yaml", imu, "--export-model", model, "--gauss-markov", filter_)
    out, _ = here(path, *files, "--inflate", "5,10", "--details")
    for text in ("accel_x: white", "accel_z: white", "N [deg/√h]", "N [m/s²/√Hz]"):
        assert text in out
    assert "accel_y" not in out
    entry = re.search(
        r"^accelerometer_noise_density: +(\S+) .* of accel_[xz]; 5 times", imu.read_text(), re.M
    )
    assert float(entry[1]) == pytest.approx(5 * 16 * 9.80665 / 16384 / 10, rel=0.1)
    assert list(read_models(model).accel_axes) == ["accel_x", "accel_z"]
    found = json.loads(filter_.read_text())["accel_axes"]["accel_z"]
    assert found["N"]["value"] == pytest.approx(16 * 9.80665 / 16384 / 10, rel=0.1)
    out, _ = here(path, "--channels", "accel_x", "--details")
    assert "gyro_x" not in out
    assert "over last third" in out
    assert "FLTEA joint, guard consistent, window 100 samples, start-up" in out


def test_table_files_and_notch(recording: Path, tmp_path: Path) -> None:
    """With the spectral line left out (--notch), both axes are white. The written models and imu.yaml satisfy
    the programs that read them.
    """
    model, yaml = tmp_path / "model.json", tmp_path / "imu.yaml"
    flags = ("--notch", "20±0.5", "--variant", "triple", "--export-model", model, "--imu-yaml", yaml)
    out, _ = here(recording, *flags, "--details")
    first_lines = re.findall(
        r"gyro_[xy]: white · N [\d.]+ deg/√h \([\d.]+ … [\d.]+\) · K at most [\d.e+]+ deg/h/√h"
        r" · B at most [\d.]+ deg/h · Bias\(1 s\) ",
        out,
    )
    assert len(first_lines) == 2, out
    assert out.count("\n  White noise. The null test does not reject") == 2
    for text in ("3,000 samples, 30.0 s", "FLTEA triple α", "FLTEA joint α", "shuffled gives", "undefined"):
        assert text in out
    # the variant that was requested comes first
    assert out.index("FLTEA triple α") < out.index("FLTEA joint α")
    assert "too short to separate a fractional order" in out
    assert list(read_models(model).axes) == ["gyro_x", "gyro_y"]
    assert "gyroscope_noise_density:" in yaml.read_text()


def test_what_was_found_is_told_before_a_file_fails(recording: Path, tmp_path: Path) -> None:
    """The work took minutes, so a mistyped name of the model's file must not lose its results."""
    flags = ("--channels", "gyro_x", "--export-model", tmp_path / "no" / "model.json")
    out, err = here(recording, *flags, exit_code=1)
    assert "gyro_x: white ·" in out
    assert "model.json: cannot be written" in err


def test_how_long_to_rest_and_to_drive(recording: Path) -> None:
    """Both questions, `--rest-for` and `--drive-for`, are answered together, in words and as JSON. Either
    option includes the forecast.
    """
    out, err = here(recording, "--rest-for", "2@60", "--drive-for", "1@30", "--channels", "gyro_x")
    assert err == ""
    assert re.search(
        r"gyro_x, forecast: .* Rest for .*: the heading is good to ± 2° \(95 %, 1\.96 σ\)\s+60 s", out
    )
    assert "After a rest of 30 s the heading is good to ± 1° (95 %, 1.96 σ) for " in out
    assert "heading after" in out
    out, _ = here(recording, "--drive-for", "1@30", "--channels", "gyro_x", "--json")
    forecast = strict(out)["files"][0]["axes"]["gyro_x"]["forecast"]
    assert forecast["drive"] == {"within": 1.0, "rest_s": 30.0}
    assert 0 < forecast["drive_s"] < 3600
    assert (forecast["goal"], forecast["rest_s"]) == (None, None)
    assert forecast["judged"]


def test_a_bad_file_among_others(recording: Path, tmp_path: Path) -> None:
    """The other files are identified. The failure is reported in its place among them and again at the end,
    and the exit code is 2.
    """
    bad = tmp_path / "bad.npz"
    bad.write_bytes(b"PK no")
    out, err = here(tmp_path / "away.npz", recording, bad, "--channels", "gyro_x", exit_code=2)
    for text in ("away.npz: there is no such file.", "gyro_x: white ·"):
        assert text in out
    assert [line.startswith("fltea: error: ") for line in err.splitlines()] == [True, True]


@pytest.mark.parametrize("name", ["away.npz", "bad.npz", "short.npz"])
def test_of_a_refused_recording_there_is_no_report(name: str, recording: Path, tmp_path: Path) -> None:
    """If all recordings are refused, no report is written. An earlier version wrote an empty page.

    If there is another recording as well, the report has both: of the refused one only its name and error.
    """
    (tmp_path / "bad.npz").write_bytes(b"PK no")
    npz(tmp_path / "short.npz", counts(20, 1))
    out = tmp_path / "out"
    for others in ((), (recording,)):
        command = (tmp_path / name, *others, "--channels", "gyro_x")
        _, without = here(*command, exit_code=2)
        _, err = here(*command, "--report", out, exit_code=2)
        if not others:
            assert err == without
            assert list(out.iterdir()) == []
    assert err.endswith(without)
    assert f"fltea: wrote {out / 'report.html'} and " in err
    page = (out / "report.html").read_text()
    assert f"<h2>{recording}</h2>" in page
    assert name in page
    assert len(list(out.glob("rest_gyro_x_*.svg"))) == len(list(out.glob("*.svg"))) > 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["away.npz"], "no such file"),
        (["rest.npz", "--inflate", "5"], "give one of them"),
        (["rest.npz", "--imu-yaml", "i.yaml", "--inflate", "0.5"], "1 or more"),
        (["rest.npz", "--notch", "five"], "give a band in Hz"),
        (["rest.npz", "--drive-for", "30"], "--drive-for 1@30 asks for how long"),
        (
            ["rest.npz", "--drive-for", "1@30", "--out", "v.parquet"],
            "--drive-for and --out do not go together",
        ),
        (["rest.npz", "--from-hz", "-1"], "from_hz must be a frequency"),
        (["rest.npz", "--from-hz", "49.9"], "are needed"),
        (["rest.npz", "--variant", "quadruple"], 'must be "joint" or "triple"'),
        (["rest.npz", "--channels", "gyro_x,gyro_q"], "there is no gyro_q"),
        (["rest.npz", "--startup", "2950"], "start-up window takes 2950"),
        (["rest.npz", "rest.npz", "--export-model", "m.json"], "only for a single recording"),
        (["rest.npz", "--report", "/proc/no"], "cannot be written to"),
        (["rest.npz", "--set", "estimator.bias=[0.1]"], "has 1 numbers"),
    ],
)
def test_mistakes(
    arguments: list[str], message: str, recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For any mistake, the command prints one line and returns exit code 2."""
    monkeypatch.chdir(recording.parent)
    done = fltea_here("identify", *arguments, "--jobs", "1", "--shuffles", "0")
    assert (done.returncode, message in done.stderr, "Traceback" in done.stderr) == (2, True, False)


@given(
    st.decimals(1, 40, places=2), st.decimals("0.01", "0.9", places=2), st.sampled_from(["±", "+-", "+/-"])
)
def test_notch_around(middle: object, half: object, sign: str) -> None:
    low, high = parse_notch(f"{middle}{sign}{half}")
    assert low == pytest.approx(float(middle) - float(half))
    assert high == pytest.approx(float(middle) + float(half))


def test_notch_between() -> None:
    assert parse_notch("30.9-31.9") == parse_notch(" 30.9 – 31.9 ") == (30.9, 31.9)
    assert parse_notch("0.1±0.5") == (0.0, 0.6)
    for text in ("31", "32-31", "31±0", "-1-2", "1e3-2", "a-b", ""):
        with pytest.raises(UsageError, match="--notch"):
            parse_notch(text)


def test_why_the_only_recording_failed_is_said_once(tmp_path: Path) -> None:
    (tmp_path / "rest.csv").write_text("time,p,q\n0,1,2\n1,2,1\n")
    done = fltea_here("identify", f"{tmp_path}/rest.csv", "--columns", "p,q")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("nothing says the unit of p, q") == 1
