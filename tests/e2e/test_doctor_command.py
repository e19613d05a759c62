"""Tests of the commands `fltea doctor` and `fltea devices`, on this machine and with a simulated board on a
pseudo-terminal.
"""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.rig.host_support import Processes, fltea, fltea_here


def findings(output: str) -> dict[str, dict[str, Any]]:
    return {found["check"]: found for found in map(json.loads, output.splitlines())}


@pytest.mark.long
def test_a_device_is_examined_and_one_in_use_is_left_alone(processes: Processes, tmp_path: Path) -> None:
    port = tmp_path / "device"
    processes.stand_in(port)
    done = fltea("doctor", "--source", f"serial:{port}", "--record", tmp_path, "--json")
    found = findings(done.stdout)
    assert (done.returncode, done.stderr) == (0, "")
    for check in ("program", "native", "port", "permission", "frames", "firmware", "sensor", "board"):
        assert found[check]["level"] == "ok", found[check]
    assert "100.00 Hz (100 stated)" in found["samples"]["message"]
    assert found["samples"]["device"] == "device"
    assert "ppm" in found["clock drift"]["message"]
    assert found["disk"]["class"] == "finding"

    daemon = processes.daemon("--source", f"serial:{port}")
    daemon.wait_for(lambda: bool(daemon.of("hello")), "HELLO")
    found = findings(fltea("doctor", "--source", f"serial:{port}", "--json").stdout)
    assert found["in use"]["level"] == "ok"
    assert f"pid {daemon.process.pid}" in found["in use"]["message"]
    assert "frames" not in found
    daemon.end_well()
    assert "restart" not in [epoch["reason"] for epoch in daemon.of("epoch")]


def test_a_problem_ends_with_1_and_says_what_to_do() -> None:
    done = fltea_here("doctor", "--source", "serial:/dev/no-such-port")
    assert (done.returncode, done.stderr) == (1, "")
    lines = done.stdout.splitlines()
    (at,) = [n for n, line in enumerate(lines) if line.startswith("problem  port ")]
    assert "there is no port /dev/no-such-port" in lines[at]
    assert "→ check the cable and the name" in lines[at + 1]
    assert lines[-1].startswith("1 problem")
