"""Tests of recording as a user does it: with the command, a device on a pseudo-terminal, and a kill at any
moment.
"""

import json
import random
import re
import signal
import time
from pathlib import Path

import pytest
from mcap.reader import make_reader

from tests.rig.host_support import QUICK, Daemon, Processes, fltea, wait_until
from tests.rig.tiers import long, slow

FLUSHED_S = 1.0


@pytest.fixture
def port(tmp_path: Path) -> Path:
    return tmp_path / "device"


def records(output: str, kind: str) -> list[dict]:
    found = [json.loads(line) for line in output.splitlines()]
    return [{k: v for k, v in r.items() if k != "device"} for r in found if r["class"] == kind]


def of(daemon: Daemon, kind: str) -> list[dict]:
    return [{k: v for k, v in r.items() if k != "device"} for r in daemon.of(kind)]


def replay(path: Path) -> str:
    result = fltea("run", "-s", f"replay:{path}", "--once", "--samples", *QUICK)
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.mark.parametrize("seed", [slow(1), long(2)])
def test_kill_9_costs_the_last_second(seed: int, processes: Processes, port: Path, tmp_path: Path) -> None:
    folder = tmp_path / "rec"
    device = processes.stand_in(port, "--noise", f"alpha=0.5&f=-1&seed={seed}")
    daemon = processes.daemon("--source", f"serial:{port}", *QUICK, "--record", folder, "--samples")
    daemon.wait_for(lambda: len(daemon.of("estimate")) >= 100, "100 estimates")
    time.sleep(random.Random(seed).uniform(0.0, 1.0))
    daemon.end(signal.SIGKILL)
    device.stop()
    again = replay(folder)
    live, found = of(daemon, "estimate"), records(again, "estimate")
    assert found == live[: len(found)]
    missing_s = (live[-1]["host_ns"] - found[-1]["host_ns"]) * 1e-9
    assert missing_s <= FLUSHED_S
    assert [e["kind"] for e in records(again, "error")] == ["cut_recording"]
    result = fltea("recover", folder)
    assert result.returncode == 0, result.stderr
    assert "saved" in result.stdout
    (copy,) = folder.glob("*.recovered.mcap")
    assert records(replay(folder), "estimate") == found
    with copy.open("rb") as file:
        assert make_reader(file, validate_crcs=True).get_summary() is not None


@pytest.mark.slow
def test_record_export_replay(processes: Processes, port: Path, tmp_path: Path) -> None:
    """Run the commands for recording, export and replay one after the other, as the README has them."""
    folder = tmp_path / "rec"
    device = processes.stand_in(port)
    result = fltea("record", "-s", f"serial:{port}", folder, "--for", "2", "--rotate-s", "0.8")
    assert result.returncode == 0, result.stderr
    assert re.search(r"0 lost in 0 gaps; [2-9] files in", result.stderr)
    device.stop()
    text = fltea("info", folder).stdout
    assert "MPU-9250, ±2000 deg/s" in text
    result = fltea("export", folder, "--to", tmp_path / "out.npz")
    assert result.returncode == 0, result.stderr
    assert result.stderr.endswith(" samples\n")
    of_file, of_npz = replay(folder), replay(tmp_path / "out.npz")
    axes = [[estimate["axes"] for estimate in records(out, "estimate")] for out in (of_file, of_npz)]
    assert len(axes[0]) > 20
    assert axes[0] == axes[1]
    result = fltea("export", folder, "--to", tmp_path / "out.csv", "--what", "estimates")
    assert (result.returncode, "holds no estimates" in result.stderr) == (2, True)


def test_ctrl_c_ends_a_recording_in_order(processes: Processes, port: Path, tmp_path: Path) -> None:
    device = processes.stand_in(port)
    recorder = processes.daemon("-s", f"serial:{port}", tmp_path / "rec", command="record")
    wait_until(lambda: len(list((tmp_path / "rec").glob("*.mcap"))) == 1, "the file")
    time.sleep(1.0)
    stderr = recorder.end_well()
    device.stop()
    assert "1 file in" in stderr
    assert json.loads(fltea("info", "--json", tmp_path / "rec").stdout)["whole"]
