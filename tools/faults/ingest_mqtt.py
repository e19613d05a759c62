"""Faults of the ingest from an MQTT broker, with one program: the broker away, the line cut."""

import contextlib
import time
from pathlib import Path

from tools.fault_script.broker import Broker
from tools.fault_script.cut_line import CutLine
from tools.fault_script.program import Program
from tools.faults.boards import Boards
from tools.faults.row import Row
from tools.faults.sample_books import row, until_all_again

AWAY_S = 8.0


def broker_restarted(folder: Path) -> Row:
    """Killed, and started at once."""
    return _broker_killed(folder, 0.0, "MQTT broker killed (`kill -9`), started again at once")


def broker_away(folder: Path) -> Row:
    """Killed, and started after some seconds."""
    return _broker_killed(folder, AWAY_S, f"MQTT broker away for {AWAY_S:g} s")


def program_cut_off(folder: Path) -> Row:
    """The network between it and the broker is split until it tells so; boards go on."""
    with contextlib.closing(_Stage(folder)) as stage:
        stage.line.cut()
        cut_s = time.monotonic()
        stage.program.wait_for(lambda: "broker_lost" in stage.program.errors(), "word of it")
        told_s = time.monotonic() - cut_s
        stage.line.heal()
        stage.until_all_again()
        more = f"told after {told_s:.0f} s"
        return row("cut off from the MQTT broker until it was told", stage.boards, [stage.program], more)


def _broker_killed(folder: Path, away_s: float, name: str) -> Row:
    with contextlib.closing(_Stage(folder)) as stage:
        stage.broker.kill()
        time.sleep(away_s)
        stage.broker.start()
        back_s = time.monotonic()
        stage.until_all_again()
        more = f"samples of all sensors again {time.monotonic() - back_s:.0f} s after it was back"
        return row(name, stage.boards, [stage.program], more)


class _Stage:
    """A broker, boards that send with QoS 1, and a program. line: between broker and program."""

    def __init__(self, folder: Path) -> None:
        with contextlib.ExitStack() as stack:
            self.broker = Broker(folder)
            stack.callback(self.broker.kill)
            self.line = CutLine(self.broker.port)
            stack.callback(self.line.close)
            url = f"mqtt://127.0.0.1:{self.line.port}"
            settings = ("--set", "name=lab", "--set", "live.on=false")
            self.program = Program(("-s", url, "--format", "ndjson", *settings))
            stack.callback(self.program.kill)
            self.program.wait_for(self.broker.has_subscriber, "its subscription")
            self.boards = Boards(self.broker.port, qos=1)
            stack.callback(self.boards.close)
            self.boards.start()
            self.until_all_again()
            self.close = stack.pop_all().close

    def until_all_again(self) -> None:
        """Wait until samples of all boards arrive that are not published yet."""
        until_all_again(self.boards, [self.program])


CASES = (broker_restarted, broker_away, program_cut_off)
