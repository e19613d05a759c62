"""`fltea identify` as a user has it: table, JSON, files, exit codes."""

import json
from pathlib import Path

import numpy as np
import pytest
from fltea.cli_identify import parse_notch
from fltea.errors import UsageError
from fltea.identify.model_file import read_models
from host_support import fltea
from hypothesis import given
from hypothesis import strategies as st
from identify_files import counts, npz

FAST = ("--jobs", "1", "--startup", "100", "--window", "100", "--shuffles", "5")


def strict(text: str) -> dict[str, object]:
    def refuse(name: str) -> float:
        raise AssertionError(f"{name} is not JSON")

    found: dict[str, object] = json.loads(text, parse_constant=refuse)
    return found


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two axes: white noise, and white noise with a line at 20 Hz."""
    raw = counts(3000, 2)
    raw[:, 1] += np.rint(10 * np.sin(2 * np.pi * 20 * np.arange(3000) / 100)).astype(np.int32)
    return npz(tmp_path_factory.mktemp("command") / "rest.npz", raw)


def test_json(recording: Path) -> None:
    """As the issue has it; on stdout nothing else, on stderr nothing."""
    done = fltea("identify", recording, "--json", *FAST)
    assert (done.returncode, done.stderr) == (0, "")
    (file,) = strict(done.stdout)["files"]
    assert file["file"] == str(recording)
    assert list(file["axes"]) == ["gyro_x", "gyro_y"]
    for axis in file["axes"].values():
        assert {"alpha", "alpha_std", "f", "f_std"} <= set(axis["fltea"])
        assert 0 <= axis["null"]["p_value"] <= 1
        assert axis["null"]["shuffled"]["copies"] == 5
        assert {"F", "alpha", "f", "R"} <= set(axis["whittle"])
        assert {"kind", "text", "rules"} == set(axis["verdict"])
        assert axis["unit"] == "deg/s"
        assert axis["allan"]["N_deg_per_sqrt_s"]["value"] == pytest.approx(16 / 131 / 10, rel=0.1)
        assert axis["fltea"]["variant"] == "joint"
    assert file["axes"]["gyro_x"]["verdict"]["kind"] == "white"
    assert file["axes"]["gyro_x"]["whittle"]["alpha"]["low"] is None
    assert file["axes"]["gyro_y"]["verdict"]["kind"] == "filter or resonance"
    assert "line" in [trap["kind"] for trap in file["axes"]["gyro_y"]["traps"]]


def test_table_files_and_notch(recording: Path, tmp_path: Path) -> None:
    """With the line left out both are white; models and imu.yaml are what their readers want."""
    model, yaml = tmp_path / "model.json", tmp_path / "imu.yaml"
    done = fltea(
        "identify", recording, "--notch", "20±0.5", "--variant", "triple", "--export-model", model,
        "--imu-yaml", yaml, *FAST,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.count(": white. White noise: no order can be told from it") == 2
    for text in ("3,000 samples, 30.0 s", "FLTEA triple α", "FLTEA joint α", "shuffled gives", "undefined"):
        assert text in done.stdout
    assert done.stdout.index("FLTEA triple α") < done.stdout.index("FLTEA joint α")  # the one asked for first
    assert "too short to tell fractional noise" in done.stdout
    assert list(read_models(model).axes) == ["gyro_x", "gyro_y"]
    assert "gyroscope_noise_density:" in yaml.read_text()


def test_a_bad_file_among_others(recording: Path, tmp_path: Path) -> None:
    """The others are identified; what failed is told, in its place and at the end; exit 2."""
    bad = tmp_path / "bad.npz"
    bad.write_bytes(b"PK no")
    done = fltea("identify", tmp_path / "away.npz", recording, bad, *FAST)
    assert done.returncode == 2
    assert "away.npz: there is no such file." in done.stdout
    assert "gyro_x: white." in done.stdout
    assert "Summary" in done.stdout
    assert done.stdout.count("failed") == 2
    lines = done.stderr.splitlines()
    assert len(lines) == 2
    assert all(line.startswith("fltea: error: ") for line in lines)
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["away.npz"], "no such file"),
        (["rest.npz", "--notch", "five"], "give a band in Hz"),
        (["rest.npz", "--from-hz", "-1"], "from_hz is a frequency"),
        (["rest.npz", "--from-hz", "49.9"], "are needed"),
        (["rest.npz", "--variant", "quadruple"], "not one of the words"),
        (["rest.npz", "--channels", "gyro_x,gyro_q"], "there is no gyro_q"),
        (["rest.npz", "--startup", "2950"], "start-up window takes 2950"),
        (["rest.npz", "rest.npz", "--export-model", "m.json"], "are for one recording"),
        (["rest.npz", "--report", "/proc/no"], "cannot be written to"),
        (["rest.npz", "--set", "estimator.bias=[0.1]"], "has 1 numbers"),
    ],
)
def test_mistakes(
    arguments: list[str],
    message: str,
    recording: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """One line and exit 2, whatever the mistake."""
    from fltea import cli

    monkeypatch.chdir(recording.parent)
    monkeypatch.setattr("sys.argv", ["fltea", "identify", *arguments, "--jobs", "1", "--shuffles", "0"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert message in said
    assert "Traceback" not in said


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
