"""No output of a command replaces what it is made of, another output, or a file that was not meant."""

import os
from pathlib import Path

import numpy as np
import pytest
from fltea.cli.app import app
from fltea.records.errors import UsageError
from typer.main import get_command

from tests.rig.bag_support import even, write_bag
from tests.rig.host_support import fltea_here

FILES = ("--export-model", "--imu-yaml", "--gauss-markov", "--allan-csv")
ROWS = "time_s,gyro_x_dps\n" + "".join(f"{k / 100},{k * 7 % 11}\n" for k in range(600))


def refused(said: str, *command: str | Path) -> None:
    done = fltea_here(*command)
    assert done.returncode == UsageError.exit_code, done.stderr
    assert said in done.stderr


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "in" / "rest.csv"
    path.parent.mkdir()
    path.write_text(ROWS)
    return path


@pytest.mark.parametrize("flag", FILES)
@pytest.mark.parametrize("through", ["name", "link", "hard link", "folder"])
def test_a_recording_is_not_replaced(flag: str, through: str, recording: Path, tmp_path: Path) -> None:
    named = out = recording
    if through == "link":
        out = tmp_path / "out.csv"
        out.symlink_to(recording)
    elif through == "hard link":
        out = tmp_path / "out.csv"
        os.link(recording, out)
    elif through == "folder":
        named = write_bag(tmp_path / "rest.db3", {"/imu": even(50)})
        (out,) = named.glob("*.db3")
    before = out.read_bytes()
    refused(f"{flag} {out}: is the recording itself", "identify", named, flag, out)
    assert out.read_bytes() == before


def test_a_configuration_and_another_output_are_not_replaced(recording: Path, tmp_path: Path) -> None:
    config, out = tmp_path / "fltea.toml", tmp_path / "out"
    config.write_text("")
    refused(
        f"--imu-yaml {config}: is the configuration itself",
        "identify",
        recording,
        "--config",
        config,
        "--imu-yaml",
        config,
    )
    assert config.read_text() == ""
    refused("is the file of --imu-yaml, too", "identify", recording, "--imu-yaml", out, "--allan-csv", out)
    assert not out.exists()


def test_an_export_does_not_replace_its_recording_even_if_forced(recording: Path) -> None:
    refused(f"--to {recording}: is the recording itself", "export", recording, "--to", recording, "--force")
    assert recording.read_text() == ROWS


def test_identify_replaces_earlier_files_as_its_help_says(tmp_path: Path) -> None:
    """They are results, written again when the recording is identified again with other options."""
    recording = tmp_path / "rest.csv"
    np.savetxt(recording, np.random.default_rng(5).normal(size=(3000, 1)), header="gyro_x_dps", comments="")
    options = get_command(app).commands["identify"].params  # type: ignore[attr-defined]
    helps = {option.opts[0]: option.help for option in options if "--" in option.opts[0]}
    command: list[str | Path] = ["identify", recording, "--rate", "100", "--shuffles", "0", "--jobs", "1"]
    for flag in FILES:
        assert "Replaces an existing file" in helps[flag], flag
        (tmp_path / flag).write_text("of yesterday")
        command += [flag, tmp_path / flag]
    done = fltea_here(*command)
    assert done.returncode == 0, done.stderr
    assert not [flag for flag in FILES if (tmp_path / flag).read_text() == "of yesterday"]


def test_a_simulation_replaces_a_file_only_if_asked(recording: Path, tmp_path: Path) -> None:
    """A name that is thought to be the input would cost a recording."""
    command = ["simulate", recording, "-n", "20", "--window", "20"]
    refused(f"{recording}: exists already; give another name, or --force", *command)
    model = tmp_path / "model.csv"
    model.write_text("{}")
    refused(f"{model}: is the model itself", "simulate", model, "--model", model, "--force")
    assert (recording.read_text(), model.read_text()) == (ROWS, "{}")
    assert fltea_here(*command, "--force").returncode == 0
    assert recording.read_text() != ROWS


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("link", "is a link; name the file that it leads to: "),
        ("pipe", "is a pipe"),
        ("none", "No such file"),
        ("folder", "is a folder"),
    ],
)
def test_a_history_that_cannot_be_exported_is_said_to_be_what_it_is(
    kind: str, said: str, tmp_path: Path
) -> None:
    """That none is named would be untrue."""
    history = tmp_path / "fleet.db"
    match kind:
        case "link":
            (tmp_path / "real.db").touch()
            history.symlink_to(tmp_path / "real.db")
        case "pipe":
            os.mkfifo(history)
        case "folder":
            history.mkdir()
    command = ["fleet", "--history", history, "--export", tmp_path / "out.parquet"]
    refused(f"--history {history}: {said if kind != 'none' else 'cannot be read (No such file'}", *command)


FOLDERS = {
    "--report": ["identify", "RECORDING", "--rate", "100", "--report", "FOLDER"],
    "--out": ["identify", "RECORDING", "--jobs", "1", "--out", "FOLDER"],
    "record": ["record", "-s", "synthetic:?n=100", "FOLDER"],
}


@pytest.mark.parametrize("flag", FOLDERS)
def test_a_folder_may_be_a_link_to_a_folder(flag: str, recording: Path, tmp_path: Path) -> None:
    """It may be on a larger disk. A link to nothing is refused, and is said to be one."""
    link, real = tmp_path / "out.parquet", tmp_path / "real"
    link.symlink_to(real)
    command = [{"RECORDING": recording, "FOLDER": link}.get(word, word) for word in FOLDERS[flag]]
    done = fltea_here(*command)
    assert done.returncode in (1, 2)
    assert "link to nothing" in done.stderr
    real.mkdir()
    assert fltea_here(*command).returncode == 0
    assert link.is_symlink()
    assert list(real.iterdir())
