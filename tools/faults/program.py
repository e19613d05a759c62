"""Runs `fltea` as a process.

The program's records are stored with their times of arrival. Its standard error and its exit code are stored,
too.
"""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec

ROOT = Path(__file__).resolve().parents[2]
PATIENCE_S = 180.0
"""Longest wait for an event [s]. It suffices for a busy machine, and for a first start, which compiles all
files.
"""


class Skip(Exception):
    """Raised if a fault cannot be caused on this machine; the text says what is missing."""


def wait_until(condition: Callable[[], bool], what: str, *, every_s: float = 0.01) -> None:
    """Wait until a condition is true.

    Raises:
        TimeoutError: the condition was not met in time.
    """
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > deadline_s:
            raise TimeoutError(f"waited in vain for {what}")
        time.sleep(every_s)


class Program:
    """A running command of `fltea`.

    `command`: the words after `fltea`. `clock`: file with eight bytes that are added to the program's Unix
    time [ns].
    `ports`: file with the USB ports that the program shall find (see `shim`). `before`: words to put before
    the command line, such as `nsenter …`, which runs the rest of the line.
    `program`: arguments for Python that start another program in place of `fltea`, such as `-m NAME`.
    """

    def __init__(
        self,
        command: Sequence[str | Path],
        *,
        clock: Path | None = None,
        ports: Path | None = None,
        before: Sequence[str] = (),
        program: Sequence[str] = (),
    ) -> None:
        shim = {"FLTEA_SHIM_CLOCK": clock, "FLTEA_SHIM_PORTS": ports}
        files = {name: str(file) for name, file in shim.items() if file is not None}
        path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        program = program or ("-m", "tools.faults.shim" if files else "fltea")
        own = {"PYTHONPATH": path, "COLUMNS": "200", "PYTHONFAULTHANDLER": "1"}
        self.process = subprocess.Popen(
            [*before, sys.executable, *program, *command],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, **own, **files},
        )
        self.records: list[dict[str, Any]] = []
        self.estimates_ns: list[int] = []
        self.newest: dict[str, int] = {}
        """Number of the newest sample of each device."""
        self.stderr = ""
        self.code: int | None = None
        self._newest: tuple[int, int] | None = None
        self._threads = [threading.Thread(target=one) for one in (self._read, self._read_stderr)]
        for thread in self._threads:
            thread.start()

    def of(self, kind: str) -> list[dict[str, Any]]:
        """Return all records of a class that the program has written so far."""
        return [record for record in list(self.records) if record["class"] == kind]

    def errors(self) -> list[str]:
        """Return the kinds of the errors reported so far."""
        return [record["kind"] for record in self.of("error")]

    def wait_for(self, condition: Callable[[], bool], what: str, *, every_s: float = 0.01) -> None:
        """Wait until a condition is true, but only as long as the program runs.

        Raises:
            RuntimeError: the program ended before.
            TimeoutError: the condition was not met in time.
        """

        def met() -> bool:
            if not condition() and self.process.poll() is not None:
                raise RuntimeError(f"the program ended before {what}: {self.stderr or self.records[-1:]}")
            return condition()

        wait_until(met, what, every_s=every_s)

    def has_hello(self, boot_id: int) -> bool:
        """Return whether the program has received the HELLO of this boot."""
        return any(record["boot_id"] == boot_id for record in self.of("hello"))

    def wait_for_sample(self, boot_id: int, sequence: int) -> None:
        """Wait until the program's newest sample is that with this boot and sequence number."""
        self.wait_for(lambda: self._newest == (boot_id, sequence % (1 << 16)), "the last sample")

    def end(self, number: signal.Signals | None = signal.SIGTERM) -> tuple[int, str]:
        """Send a signal, if one is given, and wait for the program's end; set and return `code` and `stderr`.

        Raises:
            TimeoutError: the program did not end in time; the text shows where its threads are.
        """
        if number is not None:
            self.process.send_signal(number)
        hangs = False
        try:
            code = self.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            hangs = True
            self.process.send_signal(signal.SIGABRT)
            code = self.process.wait(PATIENCE_S)
        self.code = code
        for thread in self._threads:
            thread.join(PATIENCE_S)
        if hangs:
            raise TimeoutError(f"the program did not end: {self.stderr}")
        return code, self.stderr

    def kill(self) -> None:
        """Kill the program with SIGKILL, if it still runs."""
        if self.code is None:
            self.end(signal.SIGKILL)

    def _read(self) -> None:
        assert self.process.stdout is not None
        boot_id = 0
        with self.process.stdout as stream:
            for line in stream:
                now_ns = time.monotonic_ns()
                if not line.endswith(b"\n"):  # The program was killed in the middle of this line.
                    break
                record = msgspec.json.decode(line)
                self.records.append(record)
                match record["class"]:
                    case "epoch":
                        boot_id = record["boot_id"]
                    case "sample":
                        self._newest = (boot_id, record["seq"] % (1 << 16))
                        self.newest[record.get("device", "")] = record["seq"]
                    case "estimate":
                        self.estimates_ns.append(now_ns)

    def _read_stderr(self) -> None:
        assert self.process.stderr is not None
        with self.process.stderr as stream:
            for line in stream:
                self.stderr += line.decode()
