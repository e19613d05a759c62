"""Tests of the emulated board with whole images.

The images are fltea's firmware, and a program that starts like a sketch on the Arduino core.
"""

import io
import json
import struct
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from itertools import accumulate, pairwise
from pathlib import Path
from unittest import mock

import pytest

from tests.rig.due_support import build
from tests.rig.machine_support import FOLDER, RAM_BASE, Bench, cpp_program, program, run
from tools.due_emulator.__main__ import IMAGE, main
from tools.due_emulator.noise import Constant
from tools.due_emulator.reset_controller import ResetType

ROOT = FOLDER.parents[1]
KEEP_CAUSE = """
  load r1, 0x20070000
  keep r1, 1
  store 0x20070000, 0xCAFEF00D
  load r1, 0x400E1A04
  keep r1, 2
  wait_forever
"""
CAFE = 0xCAFEF00D


def emulate_apart(*arguments, code=0):
    """Run the command `python -m tools.due_emulator` in a process of its own."""
    command = [sys.executable, "-m", "tools.due_emulator", *map(str, arguments)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stdout + done.stderr
    return done


def emulate(*arguments, code=0):
    """Run the command `python -m tools.due_emulator` in this process, which is quicker."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err), mock.patch("signal.signal"):
        try:
            ended = main([*map(str, arguments)])
        except SystemExit as ending:
            ended = int(ending.code or 0)
    assert ended == code, out.getvalue() + err.getvalue()
    return subprocess.CompletedProcess(arguments, ended, out.getvalue(), err.getvalue())


def report(*arguments, code=0):
    return json.loads(emulate(*arguments, "--json", code=code).stdout)


@pytest.fixture(scope="module")
def ours():
    assert IMAGE.exists(), "the committed image is missing: make firmware"
    return IMAGE


@pytest.fixture(scope="module")
def by_edges(tmp_path_factory):
    """Return fltea's image that reads the sensor at each edge of its data-ready pin, as `make firmware`
    builds it.
    """
    folder = tmp_path_factory.mktemp("data_ready")
    build("data_ready", folder)
    return folder / "fltea_due.bin"


@pytest.fixture(scope="module")
def arduino_like():
    return cpp_program(FOLDER / "arduino_like.cpp")


def test_an_image_that_starts_as_the_arduino_core_does_runs_and_sends(arduino_like):
    bench = Bench(arduino_like, world=Constant((100.0, -50.0, 25.0))).run(0.3)
    records = [bench.received[i : i + 20] for i in range(0, len(bench.received) // 20 * 20, 20)]
    assert len(records) >= 15
    times, rates = [], []
    for record in records:
        mark, n, micros, *words = struct.unpack("<cBI", record[:6]) + struct.unpack(">7h", record[6:])
        assert (mark, n) == (b"S", 14)
        assert words[2] == 16384
        assert words[4:] == [0, 0, 0] or words[4:] == [13100, -6550, 3275]
        times.append(micros)
        rates.append(words[4:])
    assert [13100, -6550, 3275] in rates
    steps = [b - a for a, b in pairwise(times)]
    assert all(9_900 <= step <= 10_100 for step in steps)
    assert bench.board.twi.transfers > 15


def test_what_each_start_leaves_and_says():
    bench = run(KEEP_CAUSE)
    board = bench.board
    assert bench.slot(1) != CAFE
    assert bench.slot(2) == ResetType.POWER_UP << 8 | 1 << 16
    board.reopen_port()
    bench.run(0.2)
    assert bench.slot(2) == ResetType.POWER_UP << 8 | 1 << 16, "the bridge holds the board for 205 ms"
    bench.run(0.3)
    assert (bench.slot(1), bench.slot(2)) == (CAFE, ResetType.USER << 8 | 1 << 16 | 1)
    board.brown_out()
    bench.run(0.4)
    assert bench.slot(1) != CAFE, "power lost, RAM lost"
    assert bench.slot(2) == ResetType.POWER_UP << 8 | 1 << 16
    board.reset(ResetType.WATCHDOG)
    bench.run(0.5)
    assert (bench.slot(1), bench.slot(2)) == (CAFE, ResetType.WATCHDOG << 8 | 1 << 16)
    assert board.resets == 3


def test_a_reset_puts_every_register_back_and_stops_what_was_under_way():
    bench = run("full_speed\n store 0x400E0610, 0x08001900\n store 0x400E1030, 0x1000\n wait_forever")
    board = bench.board
    assert board.machine.mck_hz == 84_000_000
    fresh = Bench(program("wait_forever")).board
    board.reset(ResetType.POWER_UP)
    assert board.machine.mck_hz == 4_000_000
    assert board.machine.clocked == 0
    for before, after in zip(fresh.peripherals, board.peripherals, strict=True):
        assert before.registers == after.registers, before.name


def test_a_hanging_program_gets_no_time_and_is_no_sleeper():
    bench = run("movs r1, #0\n1: adds r1, #1\n keep r1, 0\n b 1b", 0.01)
    count = bench.slot(0)
    bench.board.starve(1.0)
    bench.run(1.0)
    assert bench.slot(0) - count < 5
    assert bench.board.machine.idle_ps == 0
    bench.run(1.02)
    assert bench.slot(0) > count + 100


def test_our_image_sends_every_sample_at_its_time(ours, tmp_path):
    out = tmp_path / "bytes"
    found = report("--virtual", 3, "--out", out)
    assert found["error"] is None
    assert found["faults"] == []
    assert (found["gaps"], found["lost"], found["bad_frames"]) == (0, 0, {})
    assert 275 <= found["samples"] <= 300
    assert found["rate_hz"] == pytest.approx(100, abs=0.01)
    assert 9_950 <= found["step_us"]["min"] <= found["step_us"]["max"] <= 10_050
    assert out.stat().st_size == found["bytes"]
    assert found["hello"]["firmware_version"].endswith(found["build_id"])
    assert found["flash_bytes"] == ours.stat().st_size
    assert 0 < found["bus_load"] < 0.2
    assert 0.05 < found["uart_load"] < 0.2
    assert 0.5 < found["sleeping"] < 1
    status = found["statuses"][0]
    assert 400 < status.pop("cpu_share") < 800
    assert 400 < status.pop("longest_step") < 2_000
    assert set(status.values()) == {0}
    assert found["ram_touched_bytes"] <= found["ram_bytes"]


def test_two_runs_give_the_same_bytes_and_another_seed_others(ours, tmp_path):
    """Two runs with the same seed give the same bytes, even if one of them is in a process of its own. Other
    seeds give other bytes.
    """
    contents = []
    for n, arguments in enumerate(((), (), ("--seed", 2), ("--noise", "seed=9"))):
        out = tmp_path / str(n)
        (emulate if n else emulate_apart)("--virtual", 0.6, "--out", out, *arguments)
        contents.append(out.read_bytes())
    assert contents[0] == contents[1]
    assert len(set(contents)) == 3


def test_lost_bytes_are_seen_by_the_host_as_loss(ours):
    found = report("--virtual", 2, "--fault", "uart_loss at=1.25 count=100")
    assert found["bytes_lost_by_fault"] == 100
    assert 3 <= found["lost"] <= 5
    assert found["gaps"] == 1
    assert found["rate_hz"] == pytest.approx(100, abs=0.01)
    assert found["error"] is None


def test_a_reboot_begins_anew_and_is_no_loss(ours):
    found = report("--virtual", 2, "--fault", "port_reopen at=1")
    assert (found["boots"], found["resets"], len(found["statuses"])) == (2, 1, 2)
    assert (found["gaps"], found["lost"]) == (0, 0)
    assert found["rate_hz"] == pytest.approx(100, abs=0.01)
    assert found["status"]["reset_cause"] == ResetType.USER
    assert found["step_us"]["min"] >= 9_950, "no step leads from one boot into the next"


@pytest.mark.slow
def test_a_reset_may_come_at_any_moment_of_a_sampling_period(ours):
    # Each boot takes the same time, so the resets come at 25 moments of the sampling period, which are 0.4 ms
    # apart. As a read of the sensor takes 0.6 ms, at least one reset comes during a read.
    lives_s = [0.5 + 0.0004 * i for i in range(25)]
    faults = [part for at in accumulate(lives_s) for part in ("--fault", f"port_reopen at={at:.5f}")]
    found = report("--virtual", 13.5, *faults)
    assert found["error"] is None
    assert found["resets"] == 25
    assert found["samples"] > 25 * 10, "they came while it sampled"


@pytest.mark.parametrize(
    ("faults", "due", "unheard"),
    [
        # The sensor delivers values after 0.1 to 0.2 s.
        ((), range(275, 291), range(2)),
        (("unplug at=1 for=0.5",), range(275, 291), range(2)),
        (("uart_loss at=1.25 count=100",), range(275, 291), range(2)),
        (("uart_loss at=1.5 probability=1 for=2",), range(275, 291), range(149, 152)),
        (("uart_loss probability=1 for=0.995",), range(275, 291), range(75, 92)),
        # The host gets samples until the main loop stops at 1 s. Until the watchdog resets the board,
        # sampling instants are due, but their samples are neither sent nor counted as lost. The boot after
        # the port is reopened at 2.5 s is short.
        (("watchdog_starvation at=1 for=1.2", "port_reopen at=2.5"), range(215, 240), range(95, 105)),
    ],
)
def test_every_instant_is_delivered_lost_or_unheard(ours, faults, due, unheard):
    found = report("--virtual", 3, *(part for fault in faults for part in ("--fault", fault)))
    assert found["error"] is None
    assert found["due"] in due
    assert found["unheard"] in unheard
    assert found["samples"] + found["lost"] + found["unheard"] == found["due"]
    assert found["duplicates"] == 0


@pytest.mark.slow
def test_the_sensors_clock_may_change_at_any_moment(by_edges):
    found = report("--virtual", 3, "--image", by_edges, "--fault", "sensor_clock at=1.004 percent=1")
    assert (found["error"], found["lost"], found["gaps"], found["faults"]) == (None, 0, 0, [])
    assert found["step_us"]["max"] <= 10_005
    assert found["step_us"]["min"] == pytest.approx(9_901, abs=5)
    assert found["statuses"][0]["overruns"] == 0


@pytest.mark.slow
def test_an_image_in_build_says_what_it_is(by_edges):
    found = report("--virtual", 0.5, "--image", by_edges)
    assert found["hello"]["firmware_version"].endswith(found["build_id"])
    assert found["hello"]["sampling_mode"] == 1
    assert found["ram_bytes"] > found["ram_touched_bytes"]
    assert json.loads(by_edges.with_suffix(".json").read_text())["sampling_mode"] == "data_ready"
    assert found["due"] is found["unheard"] is None, "the sensor's clock decides"


def test_a_fault_that_never_came_is_reported(ours):
    found = report("--virtual", 0.5, "--fault", "unplug at=5", "--fault", "sda_stuck at=0.4 clocks=1")
    assert found["notes"] == ["unplug at 5 s did not happen: the run ended at 0.5 s"]
    assert "note: unplug at 5 s" in emulate("--virtual", 0.5, "--fault", "unplug at=5").stdout


def test_what_the_board_does_not_forgive_ends_the_command_with_1(tmp_path):
    image = tmp_path / "bad.bin"
    image.write_bytes(program("load r1, 0x400E0814\n wait_forever"))
    found = report("--virtual", 1, "--image", image, code=1)
    assert "UART_SR without its clock" in found["error"]
    assert found["virtual_s"] < 0.01
    assert "ENDED EARLY: read of UART_SR" in emulate("--virtual", 1, "--image", image, code=1).stdout


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--virtual", "-1"], "positive number"),
        (["--virtual", "1", "--image", "/nowhere.bin"], "cannot be read"),
        (["--virtual", "1", "--image", sys.executable], "ELF"),
        (["--virtual", "1e300"], "at most 1e+06"),
        (["--virtual", "nan"], "positive number"),
        (["--virtual", "1", "--fault", "unplug at=1e300"], "Expected `float` <= 1000000.0 - at `$.at`"),
        (
            ["--virtual", "1", "--fault", "unplug at=1 for=1e300"],
            "Expected `float` <= 1000000.0 - at `$.for`",
        ),
        (["--virtual", "1", "--baud", "inf"], "finite"),
        (["--virtual", "1", "--noise", "rate_hz=1e300"], "rate_hz"),
        (["--virtual", "1", "--link", "/tmp/x"], "only with --pty"),
        (["--virtual", "1", "--fault", "nonsense at=1"], "Kinds: "),
        (["--virtual", "1", "--noise", "alpha=x"], "alpha"),
        (["--virtual", "1", "--out", "/nowhere/x"], "cannot be written"),
        (["--virtual", "1", "--baud", "0"], "positive"),
        (["--virtual", "1", "--seed", "-1"], "0 or more"),
        (["--pty", "--link", "/nowhere/x"], "cannot be made"),
        (["--virtual", "1", "--pty"], "not allowed with"),
        ([], "required"),
    ],
)
def test_mistakes_of_the_user_are_explained(arguments, says, tmp_path):
    if "--image" not in arguments:
        image = tmp_path / "x.bin"
        image.write_bytes(struct.pack("<II", RAM_BASE, 0x80009) + b"\x30\xbf\xfd\xe7")
        arguments = [*arguments, "--image", str(image)]
    assert says in emulate(*arguments, code=2).stderr


def test_the_json_of_an_image_has_to_make_sense(tmp_path):
    image = tmp_path / "x.bin"
    image.write_bytes(bytes(8))
    Path(tmp_path / "x.json").write_text("{}")
    assert "does not describe an image" in emulate("--virtual", 1, "--image", image, code=2).stderr


def test_help_says_what_it_does():
    text = emulate_apart("--help").stdout
    assert "sda_stuck" in text
    assert "Exit codes" in text
