"""The stand-in device and the real command, as processes."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
PATIENCE_S = 60.0
"""Ends only what would hang; nothing that works takes as long, however busy the machine is."""
QUICK = ["--startup", "50", "--set", "estimator.window=200"]


def wait_until(condition: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, f"waited in vain for {what}"
        time.sleep(0.005)


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


def _hear_hangups() -> None:
    """Tests may run under nohup, which whoever they start would inherit."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


class Daemon:
    """`fltea run` with its records collected as they come."""

    def __init__(self, *arguments: str | Path) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "fltea", "run", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, "COLUMNS": "200", "PYTHONFAULTHANDLER": "1"},
            preexec_fn=_hear_hangups,
        )
        self.records: list[dict[str, Any]] = []
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.records.append(json.loads(line))

    def of(self, kind: str) -> list[dict[str, Any]]:
        return [r for r in self.records if r["class"] == kind]

    def errors(self) -> list[str]:
        return [r["kind"] for r in self.of("error")]

    def wait_for(self, condition: Callable[[], bool], what: str) -> None:
        def met() -> bool:
            ended = self.process.poll() is not None
            assert condition() or not ended, f"the daemon ended before {what}: {self.records[-3:]}"
            return condition()

        wait_until(met, what)

    def end(self, number: signal.Signals | None = signal.SIGINT) -> tuple[int, str]:
        """Exit code and stderr, after a signal or by itself."""
        if number is not None:
            self.process.send_signal(number)
        hangs = False
        try:
            code = self.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            hangs = True
            self.process.send_signal(signal.SIGABRT)  # where every thread stands goes to stderr
            code = self.process.wait(PATIENCE_S)
        self._thread.join(PATIENCE_S)
        assert self.process.stderr is not None
        assert self.process.stdout is not None
        with self.process.stderr, self.process.stdout:
            text = self.process.stderr.read().decode()
        assert not hangs, f"it did not end within {PATIENCE_S} s:\n{text}"
        return code, text


class Processes:
    """Starts both kinds, and leaves none behind when a test fails."""

    def __init__(self) -> None:
        self._started: list[StandIn | Daemon] = []

    def stand_in(self, link: Path, *arguments: str) -> StandIn:
        self._started.append(device := StandIn(link, *arguments))
        return device

    def daemon(self, *arguments: str | Path) -> Daemon:
        self._started.append(daemon := Daemon(*arguments))
        return daemon

    def kill(self) -> None:
        for one in self._started:
            one.process.kill()
            one.process.wait()
            if isinstance(one, StandIn) and one.process.stdout is not None:
                one.process.stdout.close()
