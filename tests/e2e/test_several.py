"""Tests of one program with several devices and outputs: a fault of one does not affect the others."""

import json
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.rig.host_support import PATIENCE_S, QUICK, Processes, wait_until
from tests.rig.tiers import slow


def of_device(records: list[dict[str, Any]], name: str, kind: str) -> list[dict[str, Any]]:
    return [r for r in records if r["device"] == name and r["class"] == kind]


def test_two_devices_are_estimated_side_by_side_and_one_may_vanish(
    processes: Processes, tmp_path: Path
) -> None:
    ports = [tmp_path / "left", tmp_path / "right"]
    devices = [
        processes.stand_in(port, "--noise", f"alpha=0.5&f=-1&seed={k}") for k, port in enumerate(ports, 1)
    ]
    urls = [part for port in ports for part in ("--source", f"serial:{port}")]
    daemon = processes.daemon(*urls, *QUICK)

    def count(name: str) -> int:
        return len(of_device(daemon.records, name, "estimate"))

    daemon.wait_for(lambda: min(count("left"), count("right")) >= 50, "estimates of both")
    devices[0].stop()
    daemon.wait_for(lambda: "unplugged" in daemon.errors(), "the unplugged one")
    before = count("right")
    daemon.wait_for(lambda: count("right") >= before + 100, "more of the other")
    stderr = daemon.end_well()
    assert "fltea: left: unplugged:" in stderr
    assert "right:" not in stderr
    for name in ("left", "right"):
        sequences = [r["seq"] for r in of_device(daemon.records, name, "estimate")]
        assert sequences == sorted(set(sequences))
        last = of_device(daemon.records, name, "stats")[-1]
        samples, epochs = last["sample_counts"], of_device(daemon.records, name, "epoch")
        # If the machine is too busy to read the port, the board loses samples, which are then counted.
        assert samples["delivered"] == len(sequences) + 50 * len(epochs)
        assert samples["delivered"] + samples["lost"] == sequences[-1] + 1
        assert last["outputs"]["stdout"]["dropped"] == 0


@pytest.mark.parametrize("number", [signal.SIGINT, slow(signal.SIGTERM)])
def test_a_signal_ends_all_devices_and_everything_is_written(
    number: signal.Signals, processes: Processes, tmp_path: Path
) -> None:
    ports = [tmp_path / name for name in ("a", "b", "c")]
    for port in ports[:2]:
        processes.stand_in(port)
    urls = [part for port in ports for part in ("--source", f"serial:{port}")]
    daemon = processes.daemon(*urls, *QUICK, "--state", tmp_path / "state")
    daemon.wait_for(lambda: len(daemon.of("estimate")) > 200, "estimates")
    assert daemon.end(number)[0] == 0
    for name in ("a", "b", "c"):
        assert [r["class"] for r in daemon.records if r["device"] == name][-1] == "stats"
    saved = json.loads((tmp_path / "state").read_bytes())["devices"]
    assert set(saved) == {"a", "b"}


@pytest.mark.slow
def test_a_restarted_daemon_goes_on_where_it_stopped(processes: Processes, tmp_path: Path) -> None:
    port, state = tmp_path / "port", tmp_path / "state"
    arguments = ("-s", f"serial:{port}", *QUICK, "--state", state)
    processes.stand_in(port)
    first = processes.daemon(*arguments)
    first.wait_for(lambda: len(first.of("estimate")) > 100, "estimates")
    first.end()
    last = first.of("estimate")[-1]
    second = processes.daemon(*arguments)
    second.wait_for(lambda: len(second.of("estimate")) > 10, "estimates again")
    second.end()
    [epoch] = second.of("epoch")
    assert epoch["reason"] == "resumed"
    assert 0 < epoch["resumed_after_s"] < PATIENCE_S
    assert second.errors() == []
    begin = second.of("estimate")[0]
    # The first estimate is at the first sample of the epoch (run of samples without a restart). So the
    # filters did not begin anew with a start-up window.
    assert begin["seq"] == epoch["seq"]
    for axis, estimate in begin["axes"].items():
        before, own = last["axes"][axis], estimate["fltea"]
        assert abs(own["alpha"] - before["fltea"]["alpha"]) < before["fltea"]["alpha_std"]
        assert own["alpha_std"] <= 1.5 * before["fltea"]["alpha_std"]
        assert abs(estimate["bias"] - before["bias"]) < 3 * before["bias_std"]


@pytest.mark.slow
def test_without_a_reader_of_stdout_other_outputs_go_on(processes: Processes, tmp_path: Path) -> None:
    port = tmp_path / "port"
    processes.stand_in(port)
    folder = tmp_path / "recordings"
    daemon = subprocess.Popen(
        [sys.executable, "-m", "fltea", "run", "-s", f"serial:{port}", *QUICK, "--record", folder],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    try:
        daemon.stdout.readline()
        daemon.stdout.close()
        wait_until(lambda: sum(f.stat().st_size for f in folder.glob("*.mcap")) > 20_000, "a recording")
        assert daemon.poll() is None
        daemon.send_signal(signal.SIGTERM)
        assert daemon.wait(PATIENCE_S) == 0
        assert daemon.stderr.read().count(b"output_lost: nothing more is written to stdout") == 1
    finally:
        daemon.kill()
        daemon.wait()
        daemon.stderr.close()


@pytest.mark.slow
def test_a_service_manager_hears_ready_alive_and_stopping(
    processes: Processes, tmp_path: Path, monkeypatch
) -> None:
    """As in sd_notify(3), the program sends datagrams to the socket that $NOTIFY_SOCKET names."""
    processes.stand_in(tmp_path / "port")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.settimeout(PATIENCE_S)
        manager.bind(str(tmp_path / "notify"))
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        daemon = processes.daemon("-s", f"serial:{tmp_path / 'port'}", *QUICK)
        assert manager.recv(100) == b"READY=1"
        assert manager.recv(100) == b"WATCHDOG=1"
        assert manager.recv(100) == b"WATCHDOG=1"
        assert daemon.end(signal.SIGTERM)[0] == 0
        while (said := manager.recv(100)) == b"WATCHDOG=1":
            pass
        assert said == b"STOPPING=1"


@pytest.mark.slow
def test_a_terminal_that_is_closed_ends_it_in_order(processes: Processes, tmp_path: Path) -> None:
    processes.stand_in(tmp_path / "port")
    daemon = processes.daemon("-s", f"serial:{tmp_path / 'port'}", *QUICK)
    daemon.wait_for(lambda: len(daemon.of("estimate")) > 10, "estimates")
    daemon.end_well(signal.SIGHUP)
    assert daemon.records[-1]["class"] == "stats"
