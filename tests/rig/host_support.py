"""Helpers for the tests of the host program.

The helpers are a simulated board, the real command, a strict reader of the command's output, and HTTP
requests.
"""

import contextlib
import http.client
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar
from unittest import mock
from urllib.parse import urlsplit

import msgspec
from fltea.cli.app import main
from fltea.records.records import AnyRecord, Hello
from fltea.service.hub import Hub
from fltea.sinks.record_json import record_json

from tools.faults.program import PATIENCE_S, Program
from tools.faults.program import wait_until as wait_until
from tools.made_up_board import HELLO

T = TypeVar("T")

ROOT = Path(__file__).resolve().parents[2]
QUICK = ("--startup", "50", "--set", "estimator.window=200")
"""Command-line options for an estimator that is quick rather than accurate."""

FAST = ("run", "-s", "synthetic:?n=700", "--pace", "fast")
"""Command that estimates 700 samples as fast as it can."""

WIRE_HELLO = HELLO
"""The HELLO of the simulated boards, as the tests of the host expect it."""

_decoder = msgspec.json.Decoder(AnyRecord)


def closed(hub: Hub) -> bool:
    """Close all outputs; return whether each has ended."""
    return all(one.done(PATIENCE_S) for outputs in (hub.close, hub.close_log) for one in outputs())


def fltea(*arguments: str | Path, columns: int = 200) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "fltea", *arguments],
        capture_output=True,
        encoding="utf-8",
        env={**os.environ, "COLUMNS": str(columns), "TERM": "dumb"},
        timeout=PATIENCE_S,
        stdin=subprocess.DEVNULL,
    )


def fltea_here(*arguments: str | Path, columns: int = 200) -> subprocess.CompletedProcess[str]:
    """Run fltea in this process, which saves the start of Python and the imports.

    Use this for commands that end without a signal, if only their output matters.
    """
    command = ["__main__.py", *map(str, arguments)]
    kept = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    code: object = 0
    with tempfile.TemporaryFile("w+") as output, tempfile.TemporaryFile("w+") as errors:
        try:
            with (
                mock.patch.object(sys, "argv", command),
                mock.patch.object(sys.modules["__main__"], "__package__", "fltea", create=True),
                mock.patch.dict(os.environ, {"COLUMNS": str(columns), "TERM": "dumb"}),
                contextlib.redirect_stdout(output),
                contextlib.redirect_stderr(errors),
            ):
                main()
        except SystemExit as end:
            code = end.code or 0
        finally:
            for number, handler in kept.items():
                signal.signal(number, handler)
        assert isinstance(code, int), code
        for file in (output, errors):
            file.seek(0)
        return subprocess.CompletedProcess(command, code, output.read(), errors.read())


def strict_records(output: str | bytes) -> list[AnyRecord]:
    """Return the records of an NDJSON output.

    Each record must be one whole line that has exactly the fields of the record's struct.
    """
    data = output.encode() if isinstance(output, str) else output
    assert not data or data.endswith(b"\n"), f"the last line is cut: {data[-80:]!r}"
    found = []
    for line in data.splitlines():
        assert line.startswith(b'{"class":"'), line[:80]
        record = _decoder.decode(line)  # the decoder refuses unknown fields, wrong types, and NaN
        assert record_json(record) == line
        found.append(record)
    return found


def hello(**changes: object) -> Hello:
    """Return a HELLO as an MPU-9250 at ±2000 deg/s and 100 Hz gives it."""
    usual = Hello(
        source="test:",
        host_ns=0,
        rate_hz=100.0,
        sampling_mode="timer",
        boot_id=7,
        device_id="a0",
        who_am_i=0x71,
        sensor_starts=1,
        gyro_lsb_per_dps=16.4,
        accel_lsb_per_g=16384.0,
    )
    return msgspec.structs.replace(usual, **changes)


def each_ended(make: Callable[..., T], end: Callable[[T], object]) -> Iterator[Callable[..., T]]:
    """Yield a function that a test calls to make objects, each by `make`. After the test, call `end` for each
    of them.
    """
    with contextlib.ExitStack() as stack:

        def one(*arguments: Any, **options: Any) -> T:
            made = make(*arguments, **options)
            stack.callback(end, made)
            return made

        yield one


HEARS_HANGUPS = ("env", "--default-signal=HUP")
"""Command prefix that restores the default reaction to SIGHUP, since programs started under nohup ignore it.
"""


class StandIn:
    """A process of tools/standin.py, the simulated board.

    The board's port has a fixed name, so that the board can go away and come back.
    """

    def __init__(self, link: Path, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tools.standin", "--link", link, *arguments],
            cwd=ROOT,
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
    """A running `fltea run` (or other command), whose records are read as soon as they are written.

    `program`: a program to run in place of fltea.
    """

    def __init__(self, *arguments: str | Path, program: Sequence[str] = (), command: str = "run") -> None:
        super().__init__([command, *arguments], before=HEARS_HANGUPS, program=program)

    def end(self, number: signal.Signals | None = signal.SIGINT) -> tuple[int, str]:
        """Send a signal, or none if `number` is None; wait for the end, and return exit code and stderr."""
        return super().end(number)

    def end_well(self, number: signal.Signals | None = signal.SIGINT) -> str:
        """Check that the program ends with exit code 0, and return its stderr."""
        code, said = self.end(number)
        assert code == 0, said
        return said


class Processes:
    """Starts instances of `StandIn` and `Daemon`, and stops all of them even if a test fails."""

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


class Answer(NamedTuple):
    status: int
    text: str
    headers: dict[str, str]


def port_of(url: str) -> int:
    port = urlsplit(url).port
    assert port is not None
    return port


def ask(port: int, path: str = "/", method: str = "GET", skip_host: bool = False, **headers: str) -> Answer:
    """Send a request without a body; underscores in header names are sent as hyphens."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
    try:
        connection.putrequest(method, path, skip_host=skip_host or "Host" in headers)
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        answer = connection.getresponse()
        return Answer(answer.status, answer.read().decode(), dict(answer.getheaders()))
    finally:
        connection.close()
