"""What the tests of the host share: the command as a process, and its output read strictly."""

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from unittest import mock

import msgspec
from fltea.cli.app import main
from fltea.records.records import AnyRecord, Hello
from support import PATIENCE_S

from tools.board_voice import HELLO

ROOT = Path(__file__).resolve().parents[2]
QUICK = ("--startup", "50", "--set", "estimator.window=200")
"""An estimator that is fast rather than good."""

WIRE_HELLO = HELLO
"""The made-up boards' own, as the tests of the host expect it."""

_decoder = msgspec.json.Decoder(AnyRecord)


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
    """The same within this process, without the start of Python and the imports.

    For what ends by itself: the command's output is the interest, not the process.
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
    """Records of an NDJSON output, each one whole line that says what its struct says and nothing else."""
    data = output.encode() if isinstance(output, str) else output
    assert not data or data.endswith(b"\n"), f"the last line is cut: {data[-80:]!r}"
    found = []
    for line in data.splitlines():
        assert line.startswith(b'{"class":"'), line[:80]
        record = _decoder.decode(line)  # refuses unknown fields, wrong types, and NaN
        assert msgspec.json.encode(record) == line
        found.append(record)
    return found


def hello(**changes: object) -> Hello:
    """A HELLO as an MPU-9250 at ±2000 deg/s and 100 Hz gives it."""
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
