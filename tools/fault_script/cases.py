"""All faults, in the order of the table, and how they are played."""

import tempfile
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from tools.fault_script import line_faults, output_faults, program_faults
from tools.fault_script.account import Account
from tools.fault_script.stage import Outcome, Skip, Stage


class Case(NamedTuple):
    """name: for the command line and the table. rest: what `unheard` is made of; if empty, that is 0."""

    name: str
    play: Callable[[Stage], Outcome]
    rest: str = ""


CUT = "the half frame"
CASES = (
    Case("unplugged in mid-frame, back as another port", line_faults.replug, CUT),
    Case("the same, found by its USB id", line_faults.replug_found_by_usb_id, CUT),
    Case("reset in mid-frame", line_faults.reset_in_mid_frame, CUT),
    Case("another program writes `AT\\r` to the port", line_faults.modem_manager_writes),
    Case("`AT\\r` in the stream", line_faults.modem_bytes_in_the_stream),
    Case("another program reads the port too", line_faults.another_reader),
    Case("a bit flipped in 1 % of frames", line_faults.flipped_frames),
    Case("a bit flipped in 1 % of bytes", line_faults.flipped_bytes),
    Case("line stalls 500 ms, then a burst", line_faults.stall_of_the_line),
    Case("daemon stopped for 500 ms", line_faults.stall_of_the_program),
    Case("daemon stopped until the line is full", line_faults.long_stall_of_the_program),
    Case("sequence and time wrap, 20 samples lost at each", line_faults.wraps),
    Case("firmware of another protocol version", line_faults.wrong_version, "those of that firmware"),
    Case("MQTT broker killed, back after a while", output_faults.broker_down),
    Case("browser killed in mid-stream", output_faults.browser_killed),
    Case("three open pages that do not read", output_faults.page_that_does_not_read),
    Case("disk full, later room again", output_faults.disk_full),
    Case("`kill -9` while recording", program_faults.kill_9, "until the next daemon heard a HELLO"),
    Case("two daemons on one port", program_faults.two_daemons, "until the other heard a HELLO"),
    Case("clock set an hour forward, two back", program_faults.clock_step),
)


def folder_of_its_own() -> tempfile.TemporaryDirectory[str]:
    """A folder that goes even if a killed browser's last child still writes into it."""
    return tempfile.TemporaryDirectory(prefix="fault-", ignore_cleanup_errors=True)


def play(case: Case, *, short: bool) -> Outcome:
    """Play one fault in a folder of its own; what breaks is a wrong outcome, not an exception.

    Raises:
        Skip: something is missing on this machine.
    """
    try:
        with (
            folder_of_its_own() as folder,
            Stage(Path(folder), short=short) as stage,
        ):
            return case.play(stage)
    except Skip:
        raise
    except Exception:
        nothing = Account(0, 0, 0, 0, 0, [])
        return Outcome(nothing, [], [], 0.0, 0.0, 0.0, "", {}, [traceback.format_exc()])


def play_all(cases: Sequence[Case], *, short: bool, at_once: int) -> dict[str, "Future[Outcome]"]:
    """Play several, some at once; most of the time they wait."""
    pool = ThreadPoolExecutor(at_once)
    found = {case.name: pool.submit(play, case, short=short) for case in cases}
    pool.shutdown(wait=False)
    return found
