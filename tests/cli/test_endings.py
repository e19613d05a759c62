"""Tests of how commands end: by signals, closed pipes and full disks, and at the end of their input."""

import os
import select
import signal
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from fltea.records.records import Epoch, Fit, Hello, Sample, Stats
from fltea.wire import layout as wire
from fltea.wire.messages import encode

from tests.rig.host_support import FAST, PATIENCE_S, QUICK, strict_records, wait_until

SAMPLE = wire.Sample(1, 2, 3, 4, 5, 6, 7, 0)


def started(*arguments: str | Path, stdout: Any = subprocess.PIPE, **options: Any) -> Any:
    command = [sys.executable, "-m", "fltea", *arguments]
    return subprocess.Popen(command, stdout=stdout, stderr=subprocess.PIPE, **options)


def capture(tmp_path: Path, frames: int) -> Path:
    path = tmp_path / "capture.bin"
    path.write_bytes(b"\0" + b"".join(encode(SAMPLE, k, 10_000 * k) for k in range(frames)))
    return path


def ended_by(number: int, process: subprocess.Popen[bytes]) -> bytes:
    """Send a signal to a running command, and return the rest of its output.

    Check that the exit code is 0, and that nothing is on stderr.
    """
    process.send_signal(number)
    output, errors = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, errors) == (0, b"")
    return output


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_a_run_with_0_and_a_whole_line(number: signal.Signals) -> None:
    with started("run", "-s", "synthetic:", "--samples", "--format", "ndjson", *QUICK) as process:
        first = process.stdout.readline()
        records = strict_records(first + ended_by(number, process))
    assert isinstance(records[-1], Stats)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_a_wait_between_rare_samples(number: signal.Signals) -> None:
    with started("run", "-s", "synthetic:?rate_hz=0.001&f=-0.1", *QUICK) as process:
        # the two lines are the records `hello` and `epoch`; a second sample would come only after 1,000 s
        lines = [process.stdout.readline() for _ in range(2)]
        records = strict_records(b"".join(lines) + ended_by(number, process))
    assert [type(one) for one in records] == [Hello, Epoch, Fit, Stats]


INTERRUPTED = """
import os, sys
from unittest import mock
from fltea.cli.app import main
number, place, *arguments = sys.argv[1:]
sys.argv = ["fltea", *arguments]
def stopped(*given, **named):
    os.kill(os.getpid(), int(number))
with mock.patch(place, side_effect=stopped):
    main()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("out", [False, True], ids=["one", "table"])
def test_a_signal_that_interrupts_gives_its_exit_code(
    out: bool, number: signal.Signals, tmp_path: Path
) -> None:
    """The command handles SIGTERM, too, since it has processes to end."""
    (tmp_path / "rest.csv").write_text("gyro_x_dps\n" + "1\n2\n" * 100)
    command = ["identify", str(tmp_path / "rest.csv"), "--jobs", "1"]
    command += ["--out", str(tmp_path / "v.parquet")] if out else ["--rate", "100"]
    place = "fltea.cluster.run.run" if out else "fltea.identification.run.identify_all"
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED, str(int(number)), place, *command], capture_output=True, text=True
    )
    assert (done.returncode, "Traceback" in done.stderr) == (128 + number, False), done.stderr


LOADING = """
import importlib, os, runpy, signal, sys
entry = sys.argv.pop(1)
def stop(event, arguments):
    if event == "import" and arguments[0] == "typer":
        os.kill(os.getpid(), signal.SIGINT)
sys.addaudithook(stop)
module, _, function = entry.partition(":")
if function:
    getattr(importlib.import_module(module), function)()
else:
    runpy.run_module(module, run_name="__main__")
"""
"""Run the command by one of its entry points; Ctrl-C comes while it loads its modules."""

ENTRIES = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]["scripts"]


@pytest.mark.parametrize("entry", [ENTRIES["fltea"], "fltea"])
def test_ctrl_c_while_the_program_loads(entry: str) -> None:
    command = [sys.executable, "-c", LOADING, entry, "devices"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


def piped(text: str) -> tuple[int, bytes, bytes]:
    """Return exit code, output and errors of a run whose samples come through a pipe."""
    flags = ["--once", "--samples", "--columns", "gx", "--units", "dps"]
    flags += ["--time-column", "t_ms", "--startup", "50"]
    with started("run", "-s", "stdin:", *flags, "--format", "ndjson", stdin=subprocess.PIPE) as process:
        output, errors = process.communicate(text.encode(), timeout=PATIENCE_S)
    return process.returncode, output, errors


def test_lines_through_a_pipe_become_samples_and_losses_are_published() -> None:
    values = [(k * 7919 % 101 - 50) / 50 for k in range(400)]
    lines = [f"{k * 10},{value}\n" for k, value in enumerate(values) if k not in (300, 301)]
    lines.insert(200, "reset?\x1b[2J\n")
    code, output, errors = piped("IMU ready\nt_ms,gx\n" + "".join(lines))
    assert code == 0, errors
    assert b"bad_lines" in errors
    assert b"\x1b" not in errors
    records = strict_records(output)
    assert next(one for one in records if isinstance(one, Hello)).rate_hz == 100.0
    assert sum(isinstance(one, Sample) for one in records) == 398
    stats = records[-1]
    assert (stats.sample_counts.delivered, stats.sample_counts.lost, stats.sample_counts.gaps) == (398, 2, 1)
    assert stats.link.bad_frames == {"before_header": 1, "text": 1}


def test_an_input_without_samples_ends_with_2() -> None:
    code, _, errors = piped("a\nb\n")
    assert code == 2
    assert b"no sample was in it" in errors
    assert b"Traceback" not in errors


@pytest.mark.parametrize("form", ["ndjson", "table"])
def test_without_once_a_recording_stays_until_a_signal(form: str, tmp_path: Path) -> None:
    (tmp_path / "rest.csv").write_text("gyro_x_dps\n" + "1\n2\n" * 100)
    flags = ["--rate", "100", "--format", form, *QUICK]
    with started("run", "-s", f"{tmp_path}/rest.csv", *flags) as process:
        assert b"the recording has ended" in process.stderr.readline()
        assert process.poll() is None
        output = ended_by(signal.SIGTERM, process)
    if form == "ndjson":
        assert strict_records(output)[-1].sample_counts.delivered == 200
    else:
        assert output.count(b"delivered 200") == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_an_inspection_with_its_sum(number: signal.Signals) -> None:
    with started("inspect", "-", stdin=subprocess.PIPE) as process:
        process.stdin.write(b"\0" + encode(SAMPLE, 1, 2))
        process.stdin.flush()
        assert process.stdout.readline().startswith(b"SAMPLE")
        assert ended_by(number, process) == b"29 bytes, 1 good frames\n"


def written(command: str, folder: Path, frames: int = 9000) -> list[str | Path]:
    """Return the arguments of a command that writes to stdout. Each command ends by itself, except for
    "at its own pace", which simulates a sensor in real time without an end.
    """
    match command:
        case "inspect":
            return ["inspect", capture(folder, frames)]
        case "at its own pace":
            return ["run", "-s", "synthetic:", "--samples", *QUICK]
    return [*FAST, "--once", "--samples", "--format", command, *QUICK]


@pytest.mark.slow
def test_a_pipe_that_nobody_reads_is_named_and_another_signal_ends_the_wait() -> None:
    with started(
        "run", "-s", "synthetic:?rate_hz=1000", "--samples", "--format", "ndjson", *QUICK
    ) as process:
        writer = os.open(f"/proc/self/fd/{process.stdout.fileno()}", os.O_WRONLY | os.O_NONBLOCK)
        wait_until(lambda: not select.select([], [writer], [], 0)[1], "a full pipe")
        os.close(writer)
        process.send_signal(signal.SIGTERM)
        assert b"waits for stdout" in process.stderr.readline()
        process.send_signal(signal.SIGTERM)
        assert b"stdout did not end" in process.stderr.readline()
        assert process.wait(PATIENCE_S) == 0


@pytest.mark.parametrize("command", ["ndjson", "at its own pace", "inspect"])
def test_closed_pipe_ends_quietly(command: str, tmp_path: Path) -> None:
    with started(*written(command, tmp_path)) as process:
        assert process.stdout.readline()
        process.stdout.close()
        assert process.wait(PATIENCE_S) == 0
        assert process.stderr.read() == b""


@pytest.mark.parametrize("command", ["table", "inspect", "ndjson"])
def test_pipe_closed_from_the_start_ends_quietly(command: str, tmp_path: Path) -> None:
    """The command may notice that the pipe is closed only at its end, since some commands write nothing
    before.
    """
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "wb") as closed:
        process = started(*written(command, tmp_path, 1), stdout=closed)
        assert process.communicate(timeout=PATIENCE_S)[1] == b""
    assert process.returncode == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this machine has no /dev/full")
@pytest.mark.parametrize("command", ["ndjson", "table", "inspect"])
def test_full_disk_is_an_error(command: str, tmp_path: Path) -> None:
    with open("/dev/full", "wb") as full:
        process = started(*written(command, tmp_path, 9), stdout=full)
        errors = process.communicate(timeout=PATIENCE_S)[1]
    assert process.returncode == 1
    assert b"fltea: error: cannot write the output: [Errno 28]" in errors
    assert b"Traceback" not in errors
