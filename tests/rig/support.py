"""The stand-in device and the real command, as processes."""

import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tools.faults.program import PATIENCE_S, Program
from tools.faults.program import wait_until as wait_until

ROOT = Path(__file__).parents[2]
QUICK = ["--startup", "50", "--set", "estimator.window=200"]


HEARS_HANGUPS = ("env", "--default-signal=HUP")
"""Tests may run under nohup, which whoever they start would inherit."""


class StandIn:
    """tools/standin.py under a name of our own, so that it can go and come back."""

    def __init__(self, link: Path, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, ROOT / "tools/standin.py", "--link", link, *arguments],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        self.announcement = self.process.stdout.readline()

    def stop(self) -> int:
        self.process.send_signal(signal.SIGINT)
        assert self.process.stdout is not None
        self.process.stdout.close()
        return self.process.wait(PATIENCE_S)

    def kill(self) -> None:
        self.process.kill()
        self.stop()


class Daemon(Program):
    """`fltea run`, or another command, and its records as they come. program: what runs in place of fltea."""

    def __init__(self, *arguments: str | Path, program: Sequence[str] = (), command: str = "run") -> None:
        super().__init__([command, *arguments], before=HEARS_HANGUPS, program=program)

    def end(self, number: signal.Signals | None = signal.SIGINT) -> tuple[int, str]:
        """Exit code and stderr, after a signal or by itself."""
        return super().end(number)


class Processes:
    """Starts both kinds, and leaves none behind when a test fails."""

    def __init__(self) -> None:
        self._started: list[StandIn | Daemon] = []

    def stand_in(self, link: Path, *arguments: str) -> StandIn:
        self._started.append(device := StandIn(link, *arguments))
        return device

    def daemon(self, *arguments: str | Path, **how: Any) -> Daemon:
        self._started.append(daemon := Daemon(*arguments, **how))
        return daemon

    def kill(self) -> None:
        for one in self._started:
            one.kill()
