"""Tests of the whole way of samples: a simulated device, a pseudo-terminal, `fltea run` and its NDJSON
output.
"""

import contextlib
import fcntl
import math
import os
import pty
import re
import signal
import subprocess
import sys
import termios
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fltea.settings.config import load_config
from fltea.sources.synthetic import NoiseGenerator, parse_noise

from tests.rig.bank_support import assert_published, fed_directly
from tests.rig.host_support import PATIENCE_S, QUICK, ROOT, Daemon, Processes, wait_until

NOISE = "alpha=0.5&f=-1&seed=8"


@pytest.fixture
def port(tmp_path: Path) -> Path:
    return tmp_path / "device"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    """Yield a `fltea run` that has ended, with some two hundred estimates and their samples."""
    started, port = Processes(), tmp_path_factory.mktemp("live") / "device"
    device = started.stand_in(port, "--noise", NOISE)
    daemon = started.daemon("-s", f"serial:{port}", "--samples", *QUICK)
    try:
        daemon.wait_for(lambda: len(daemon.of("estimate")) >= 200, "200 estimates")
        daemon.end()
        assert device.stop() == 0
        yield daemon
    finally:
        started.kill()


def test_every_sample_arrives_and_every_estimate_is_finite(run: Daemon) -> None:
    assert (run.code, run.stderr) == (0, "")
    estimates = run.of("estimate")
    assert [e["seq"] for e in estimates] == list(range(50, 50 + len(estimates)))
    for estimate in estimates:
        for axis in estimate["axes"].values():
            assert axis["fltea"]["valid"]
            assert all(math.isfinite(v) for v in axis["fltea"].values())
            assert all(math.isfinite(axis[name]) for name in ("bias", "bias_std", "state", "state_std"))
    assert [r["class"] for r in run.records[:2]] == ["hello", "epoch"]
    last = run.of("stats")[-1]
    assert last["sample_counts"]["delivered"] == len(run.of("sample")) == 50 + len(estimates)
    assert last["sample_counts"]["lost"] == last["sample_counts"]["gaps"] == 0
    assert last["link"]["bad_frames"] == {}
    assert last["board"]["reset_cause"] == "user"
    times = [e["host_ns"] for e in estimates]
    assert times == sorted(set(times))


def test_the_wire_changes_no_value(run: Daemon) -> None:
    """The estimates are equal in every bit to those of an estimator that gets the same quantised samples
    directly.
    """
    config = load_config(None, {"estimator.window": 200, "estimator.startup": 50}).estimator
    noise, estimates = NoiseGenerator(parse_noise(NOISE)), run.of("estimate")
    counts = [noise.step() for _ in range(50 + len(estimates))]
    assert_published(estimates, fed_directly(np.array(counts) / 16.4, config, 1 / 16.4))


def test_unplugged_and_back(processes: Processes, port: Path) -> None:
    device = processes.stand_in(port)
    daemon = processes.daemon("--source", f"serial:{port}", *QUICK)
    daemon.wait_for(lambda: len(daemon.of("estimate")) > 20, "estimates")
    device.stop()
    daemon.wait_for(lambda: "no_port" in daemon.errors(), "the port to be missed")
    assert daemon.errors()[0] == "unplugged"
    device = processes.stand_in(port, "--noise", "seed=2")
    daemon.wait_for(lambda: any(e["epoch"] == 2 for e in daemon.of("estimate")), "estimates of epoch 2")
    stderr = daemon.end_well(signal.SIGTERM)
    device.stop()
    assert "unplugged" in stderr
    assert daemon.of("stats")[-1]["link"]["reconnects"] == 1
    # Both simulated devices report their first boot (number 1) and the same id, so only sequence number and
    # time distinguish them.
    assert daemon.of("epoch")[1]["reason"] in ("restart", "discontinuity")


@contextlib.contextmanager
def unread(*arguments: str) -> Iterator[tuple["subprocess.Popen[bytes]", int]]:
    """Yield a running command, and the pipe with its output. One byte of the output is read; the rest waits
    in the pipe.

    At the end of the `with` block, a signal ends the command.
    """
    command = [sys.executable, "-m", "fltea", "run", *arguments, *QUICK]
    run = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        run.stdout.read(1)
        yield run, run.stdout.fileno()
        run.send_signal(signal.SIGTERM)
        assert run.wait(PATIENCE_S) == 0
    finally:
        run.kill()
        run.communicate()


def test_a_signal_ends_a_run_whose_output_nobody_reads(port: Path, processes: Processes) -> None:
    processes.stand_in(port)
    with unread("-s", f"serial:{port}", "--samples") as (_, pipe):
        # The pipe has room for 65,536 bytes, in pages. A write that does not fit into the rest of a page
        # begins a new page. So up to a quarter of each page stays empty, even if the pipe is full.
        wait_until(lambda: _in_pipe(pipe) > 45_000, "the pipe to be full")


@pytest.mark.slow
def test_a_signal_ends_a_run_that_waits_for_its_reader_at_its_end() -> None:
    """The command has processed all samples, but waits to write the rest of its output, which nobody reads.
    The signal ends the command.
    """
    with unread("-s", "synthetic:?n=1000", "--pace", "fast", "--once") as (run, pipe):
        wait_until(lambda: _in_pipe(pipe) > 30_000, "the pipe to fill")
        # By then all samples are processed. The test has to wait, since this cannot be observed from outside.
        time.sleep(0.5)
        assert run.poll() is None


@pytest.mark.long
def test_a_signal_ends_a_run_whose_log_nobody_reads(tmp_path: Path) -> None:
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    for size in (1 << 12, 1):
        with contextlib.suppress(BlockingIOError):
            while os.write(writer, bytes(size)):
                pass
    os.set_blocking(writer, True)
    run = subprocess.Popen(
        [sys.executable, "-m", "fltea", "run", "-s", f"serial:{tmp_path / 'none'}"],
        stdout=subprocess.PIPE,
        stderr=writer,
        env={key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"},
    )
    try:
        os.close(writer)
        run.stdout.readline()  # The same error is also written to standard error.
        time.sleep(0.2)
        run.send_signal(signal.SIGTERM)
        assert run.wait(PATIENCE_S) == 0
    finally:
        run.kill()
        run.communicate()
        os.close(reader)


def _in_pipe(descriptor: int) -> int:
    waiting = bytearray(4)
    fcntl.ioctl(descriptor, termios.FIONREAD, waiting)
    return int.from_bytes(waiting, sys.byteorder)


def test_with_once_an_unplugged_device_is_a_failure(processes: Processes, port: Path) -> None:
    device = processes.stand_in(port)
    daemon = processes.daemon("--source", f"serial:{port}", "--once", *QUICK)
    daemon.wait_for(lambda: len(daemon.of("estimate")) > 5, "estimates")
    device.stop()
    code, stderr = daemon.end(None)
    assert code == 1
    assert stderr.startswith("fltea: error:")
    assert stderr.count("\n") == 1
    assert "unplugged" in stderr
    assert daemon.errors() == ["unplugged"]


def test_make_run_shows_the_table_and_ctrl_c_ends_it_with_0(tmp_path: Path) -> None:
    """Run the command on a terminal of its own, as a person does.

    The table fills, Ctrl-C leads to exit code 0, and no process is left behind.
    """
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(ROOT)
        os.environ.update(TERM="xterm", COLUMNS="140", LINES="40", ARGS=" ".join(QUICK), TMPDIR=str(tmp_path))
        os.environ.pop("MAKEFLAGS", None)
        os.execvp("make", ["make", "run"])
    seen = b""
    while b"\xce\xb1" not in seen or b"gyro_z" not in seen:
        seen += os.read(terminal, 65536)
    [address] = re.findall(rb"live page at (http://127.0.0.1:\d+/)", seen)
    with urllib.request.urlopen(address.decode(), timeout=PATIENCE_S) as answer:
        assert b"fltea" in answer.read()
    os.write(terminal, b"\x03")
    try:
        while chunk := os.read(terminal, 65536):
            seen += chunk
    except OSError:
        pass  # no process has the terminal open any more
    _, status = os.waitpid(pid, 0)
    os.close(terminal)
    assert os.waitstatus_to_exitcode(status) == 0, seen.decode(errors="replace")[-2000:]
    assert list(tmp_path.iterdir()) == []
