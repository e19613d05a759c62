"""Tests of the command line as users see it: help, exit codes, mistakes and the command run."""

import re
import subprocess
import sys
from pathlib import Path

import fltea as package
import numpy as np
import pytest
import typer.main
from fltea.cli.app import app
from fltea.records.records import Epoch, Error, Estimate, Stats
from fltea.wire import layout as wire

from tests.rig.host_support import FAST, PATIENCE_S, QUICK, fltea, fltea_here, strict_records

COMMANDS = typer.main.get_command(app).commands


def plain(text: str) -> str:
    """Return a text without the lines drawn around help and error messages."""
    return re.sub(r"[\s│]+", " ", text)


# --- help and version ---


@pytest.mark.parametrize("width", [80, 140])
@pytest.mark.parametrize("command", [None, *COMMANDS])
def test_help_tells_exit_codes_and_every_flag(command: str | None, width: int) -> None:
    result = fltea_here(*([command] if command else []), "--help", columns=width)
    assert (result.returncode, result.stderr) == (0, "")
    text = plain(result.stdout)
    is_ended = command in ("run", "record", "fleet", "inspect")
    ended = ", also by Ctrl-C or SIGTERM" if is_ended else ""
    assert f"Exit codes: 0: ended as asked{ended}. 1: failed while running. 2: the command line" in text
    when = "before it had begun" if is_ended else "before the end"
    assert f"130, 143: interrupted by Ctrl-C or SIGTERM {when}." in text
    if command is None:
        flags = ["--version", "--help", "-h", *COMMANDS]
    else:
        flags = [
            flag for parameter in COMMANDS[command].params if not parameter.hidden for flag in parameter.opts
        ]
        assert f"fltea {command} " in text.partition("For example:")[2]
    for flag in flags:
        assert not flag.startswith("-") or re.search(rf"(?<![\w-]){flag}(?![\w-])", text), flag


def test_short_help_and_no_arguments() -> None:
    assert fltea_here("run", "-h").stdout == fltea_here("run", "--help").stdout
    result = fltea_here()
    assert result.returncode == 2
    assert "fltea [OPTIONS] COMMAND" in plain(result.stdout + result.stderr)


def test_version() -> None:
    result = fltea("--version")
    assert result.returncode == 0
    assert (
        result.stdout
        == f"fltea {package.__version__}, protocol {wire.PROTOCOL_MAJOR}.{wire.PROTOCOL_MINOR}\n"
    )


def test_installed_command_is_the_module() -> None:
    command = Path(sys.executable).with_name("fltea")
    if not command.exists():
        pytest.skip(f"{command} is not installed")
    installed = subprocess.run([command, "--version"], capture_output=True, text=True, timeout=PATIENCE_S)
    assert installed.stdout == fltea("--version").stdout


# --- mistakes ---

USAGE = {
    "no such command": (["walk"], "walk"),
    "no such flag": (["run", "--colour"], "--colour"),
    "flag without value": (["run", "--source"], "--source"),
    "no length": (["run", "--window", "x"], "estimator.window must be a whole number| or a time such as"),
    "too many words": (["run", "rest.npz"], "rest.npz"),
    "no such source": (["run", "-s", "coap:x"], "'coap:' is not a kind of source"),
    "no such file": (["run", "-s", "replay:none.npz"], "none.npz: there is no such file"),
    "no such folder": (["run", "-s", "replay:/none/x.csv"], "/none/x.csv: there is no such file"),
    "bad query": (["run", "-s", "synthetic:?alfa=1"], "alfa|Known keys: alpha"),
    "1200 baud": (["run", "-s", "/dev/ttyACM0", "--baud", "1200"], "1200 baud is refused"),
    "no such scheme": (["run", "-s", "ftp://x"], "ftp://x"),
    "bad bias": (["run", "--bias", "much"], "estimator.bias must be |got 'much'"),
    "no start within the guard": (
        ["run", "--set", "estimator.joint.beta0=2"],
        "estimator.joint.beta0 must be",
    ),
    "bad R": (["run", "--r", "0.1,x"], "estimator.R must be |got [0.1, 'x']"),
    "no source": (["run", "-s", ""], "--source: say where it is"),
    "no folder to record to": (["record", ""], "record.folder must be the name of a folder"),
    "no channels": (["run", "--channels", ""], "channels must name at least one axis"),
    "unknown setting": (["run", "--set", "estimator.order.Q=1"], "estimator.order.Q: there is no such|Q0"),
    "no setting": (["run", "--set", "estimator"], "--set estimator: give PATH=VALUE"),
    "no configuration": (["run", "--config", "none.toml"], "none.toml: cannot be read"),
    "CSV flags": ([*FAST, "--units", "dps"], "are for recordings"),
    "nothing to inspect": (["inspect"], "FILE"),
    "no such capture": (["inspect", "none.bin"], "none.bin: there is no such file or port"),
    "nothing to write": (["simulate"], "FILE"),
    "bad ending": (["simulate", "noise.txt"], "noise.txt: give a name that ends in"),
    "no samples": (["simulate", "noise.csv", "-n", "0"], "--samples ≥ 1"),
    "bad range": (["simulate", "noise.csv", "-n", "5", "--q", "-1"], "Q is a variance"),
}


@pytest.mark.parametrize("name", USAGE)
def test_mistake_is_named_and_ends_with_2(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    arguments, words = USAGE[name]
    command, *rest = arguments
    result = fltea_here(command, *(["--once"] if command == "run" else []), *rest)
    assert result.returncode == 2
    assert result.stdout == ""
    assert "Traceback" not in result.stderr
    for word in words.split("|"):
        assert word in plain(result.stderr)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("flag", "reason"),
    [("--bias", "estimator: bias needs"), ("--r", "estimator: R needs one value, or 3")],
)
def test_wrong_count_of_axes_shows_with_the_first_sample(flag: str, reason: str) -> None:
    result = fltea_here(*FAST, "--once", flag, "1,2")
    assert result.returncode == 2
    assert result.stderr.startswith(f"fltea: error: {reason}")
    assert len(strict_records(result.stdout)) == 1


def test_failure_while_running_ends_with_1() -> None:
    result = fltea_here("run", "-s", "serial:/dev/none", "--once", *QUICK)
    assert result.returncode == 1
    assert "there is no port /dev/none" in result.stderr
    assert "Traceback" not in result.stderr
    strict_records(result.stdout)


@pytest.mark.parametrize(
    "arguments",
    [("walk",), ("run", "--once", "--window", "-1"), ("run", "--help")],
    ids=["usage", "ours", "help"],
)
def test_a_process_ends_as_within_this_one(arguments: tuple[str, ...]) -> None:
    """Most tests run commands within the test's own process. This test shows that users, who start another
    process, see the same.
    """
    result, here = fltea(*arguments), fltea_here(*arguments)
    assert (result.returncode, result.stdout, result.stderr) == (here.returncode, here.stdout, here.stderr)


# --- the command run ---


def test_run_to_the_end() -> None:
    result = fltea_here(*FAST, "--once", "--set", "estimator.window=200")
    assert (result.returncode, result.stderr) == (0, "")
    records = strict_records(result.stdout)
    assert [record.seq for record in records if isinstance(record, Estimate)] == list(range(500, 700))
    assert isinstance(records[-1], Stats)
    assert records[-1].sample_counts.delivered == 700


def test_same_command_same_output() -> None:
    first, again = (run(*FAST, "--once", "--samples", *QUICK).stdout for run in (fltea, fltea_here))
    assert first == again


def test_flags_reach_the_estimator(tmp_path: Path) -> None:
    (tmp_path / "fltea.toml").write_text("[estimator]\nwindow = 99\nstartup = 77\n[link]\nmax_gap = 5\n")
    flags = ["--config", tmp_path / "fltea.toml", "-L", "40", "--bias", "-0.1,0,0.2", "--r", "0.02,0.03,0.04"]
    result = fltea_here(*FAST, "--once", *flags, "--set", "estimator.order.alpha0=0.5")
    assert (result.returncode, result.stderr) == (0, "")
    records = strict_records(result.stdout)
    info = next(record.estimator for record in records if isinstance(record, Epoch))
    assert (info.window, info.startup_samples) == (40, 0)
    assert (info.bias, info.R) == ((-0.1, 0.0, 0.2), (0.02, 0.03, 0.04))
    estimates = [record for record in records if isinstance(record, Estimate)]
    assert len(estimates) == 700
    assert estimates[0].axes["gyro_x"].fltea.alpha == pytest.approx(0.5, abs=0.2)


def test_error_records_go_to_stderr_too(tmp_path: Path) -> None:
    (tmp_path / "rest.csv").write_text("gyro_x_dps\n" + "1\n" * 200)
    result = fltea_here("run", "-s", f"replay:{tmp_path}/rest.csv", "--rate", "100", "--once", *QUICK)
    assert result.returncode == 0
    errors = [record for record in strict_records(result.stdout) if isinstance(record, Error)]
    assert [error.kind for error in errors] == ["constant_axis"]
    assert result.stderr == f"fltea: constant_axis: {errors[0].message}\n"


def test_a_width_of_nothing_is_not_known() -> None:
    """An earlier version printed nothing with COLUMNS=0, although its exit code was 0."""
    result = fltea_here(*FAST, "--once", "--format", "table", *QUICK, columns=0)
    assert (result.returncode, result.stderr) == (0, "")
    assert "gyro_z" in result.stdout
    assert "Usage:" in fltea_here("--help", columns=0).stdout


@pytest.mark.parametrize("width", [80, 140])
def test_table_off_a_terminal_is_printed_once_at_the_end(width: int) -> None:
    result = fltea_here(*FAST, "--once", "--format", "table", *QUICK, columns=width)
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.count("synthetic:?n=700") == 1
    assert "\x1b" not in result.stdout
    for part in ("state [deg/s]", "; bias ", "f [s^-α]", "sample 699  delivered 700  lost 0"):
        assert part in result.stdout
    for axis in ("gyro_x", "gyro_y", "gyro_z"):
        number = r"\s+[+-]?\d+\.\d+"
        row = rf"{axis} {number} ±{number}( \*)? {number} ±{number} {number} {number} "
        assert re.search(row, result.stdout)


HEAVY = {
    *(
        "asyncio",
        "dask",
        "email",
        "fontTools",
        "http.client",
        "IPython",
        "matplotlib",
        "mcap",
        "nats",
        "tornado",
    ),
    *("paho", "pandas", "PIL", "prometheus_client", "pyarrow", "rich", "scipy", "smbus2", "sqlite3", "ssl"),
    *("fltea.api", "fltea.archive", "fltea.cluster", "fltea.fleet", "fltea.lab", "fltea.machine"),
    *(
        "fltea.service.ingest",
        "fltea.sinks.mqtt",
        "fltea.sinks.page",
        "fltea.sinks.table",
        "fltea.sources.iio",
    ),
    *("fltea.recording.csv_file", "fltea.sources.synthetic", "fltea.sources.text_lines"),
}


def test_a_replay_imports_nothing_that_it_does_not_need(tmp_path: Path) -> None:
    gyro = np.random.default_rng(1).normal(0, 3, (600, 3)).round().astype(np.int16)
    np.savez(tmp_path / "rest.npz", gyro_raw=gyro, lsb_per_dps=16.4, fs_hz=100.0)
    arguments = ["run", "-s", f"replay:{tmp_path / 'rest.npz'}", "--once", "--format", "ndjson"]
    command = [sys.executable, "-X", "importtime", "-m", "fltea", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert '"class":"estimate"' in done.stdout
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    # fltea imports the module of an output by a computed name, and `-X importtime` does not list such
    # imports. So the test looks for fltea.sinks.json_lines, which the module of the NDJSON output imports.
    assert {"fltea.stream.pipeline", "fltea.sinks.json_lines"} <= imported
    assert sorted(HEAVY & imported) == []
