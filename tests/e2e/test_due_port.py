"""Tests of the emulated Due on a pseudo-terminal in real time, with `fltea run` reading it."""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fltea.settings.config import load_config
from fltea.sources.synthetic import NoiseGenerator, parse_noise

from tests.rig.bank_support import assert_published, fed_directly
from tests.rig.due_support import ROOT
from tests.rig.host_support import PATIENCE_S, QUICK, Processes

NOISE = "alpha=0.5&f=-1&seed=9"
ESTIMATES = 100


def session_of(leader: int) -> list[int]:
    """Return all processes of the session that the process `leader` began, including `leader`."""
    found = []
    for pid in (int(name) for name in os.listdir("/proc") if name.isdigit()):
        with contextlib.suppress(ProcessLookupError):
            if os.getsid(pid) == leader:
                found.append(pid)
    return found


@pytest.mark.slow
def test_the_chain_publishes_what_the_engine_gives_on_the_quantised_noise(
    processes: Processes, tmp_path: Path
) -> None:
    """Estimates from samples that pass through sensor, I2C, firmware, UART, port and daemon are equal in
    every bit to those of an estimator that gets the same samples directly.
    """
    link = tmp_path / "due"
    board = subprocess.Popen(
        [sys.executable, "-m", "tools.due_emulator", "--pty", "--link", link, "--noise", NOISE],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert str(link) in board.stdout.readline()
        daemon = processes.daemon("--source", f"serial:{link}", "--samples", *QUICK)
        daemon.wait_for(lambda: len(daemon.of("estimate")) >= ESTIMATES, "estimates")
        assert daemon.end() == (0, "")
        board.send_signal(signal.SIGINT)
        report = board.communicate(timeout=PATIENCE_S)[0]
    finally:
        board.kill()
        board.communicate()
    assert board.returncode == 0
    assert "ENDED EARLY" not in report

    assert daemon.errors() == []
    hellos = daemon.of("hello")
    assert [hello["sensor_starts"] for hello in hellos] == [0, 1]
    last = daemon.of("stats")[-1]
    assert last["sample_counts"]["lost"] == last["sample_counts"]["gaps"] == 0
    # Opening the port has reset the board.
    assert last["board"]["reset_cause"] == "user"

    samples = [tuple(round(rate * 16.4) for rate in s["gyro_dps"]) for s in daemon.of("sample")]
    noise = NoiseGenerator(parse_noise(NOISE))
    truth = [noise.step() for _ in range(len(samples) + 200)]
    begin = truth.index(samples[0])
    assert samples == truth[begin : begin + len(samples)]

    config = load_config(None, {"estimator.window": 200, "estimator.startup": 50}).estimator
    published = daemon.of("estimate")
    assert len(published) >= ESTIMATES
    assert_published(published, fed_directly(np.array(samples) / 16.4, config, 1 / 16.4))


@pytest.mark.slow
def test_make_run_passes_a_signal_on_and_leaves_nothing_behind(tmp_path: Path) -> None:
    demo = subprocess.Popen(
        [sys.executable, "-m", "tools.demo", "--format", "ndjson", *QUICK],
        cwd=ROOT,
        env={"PATH": "/usr/bin:/bin", "TMPDIR": str(tmp_path)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        seen = b""
        while b'"class":"sample"' not in seen and b'"class":"estimate"' not in seen:
            line = demo.stdout.readline()
            assert line, demo.stderr.read().decode()
            seen += line
        demo.send_signal(signal.SIGTERM)
        _, told = demo.communicate(timeout=PATIENCE_S)
        left = session_of(demo.pid)
    finally:
        for pid in session_of(demo.pid):
            os.kill(pid, signal.SIGKILL)
        demo.communicate()
    assert left == []
    assert demo.returncode == 0
    first, *rest = told.decode().splitlines()
    # The output says what is running, and gives the true parameters, with which the estimates can be
    # compared.
    assert "fltea_due.bin" in first
    assert "α 0.8, f -1," in first
    assert any("the true noise" in line and "α = 0.8 and f = -1 " in line for line in rest)
    # At the end the emulator reports on the run; a note says whether this machine was too slow.
    assert any("samples, 0 gaps, 0 lost" in line for line in rest)
    assert not any("ENDED EARLY" in line or "unplugged" in line for line in rest)
    assert list(tmp_path.iterdir()) == []
