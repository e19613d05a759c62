"""Tests that text from a board, a recording or a file's name cannot control the terminal that shows it."""

import io
import json
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from fltea.archive import record as archive_record
from fltea.archive.info import Summary, as_text
from fltea.cli import app as cli_app
from fltea.cli import devices as cli_devices
from fltea.cli.output import print_lines, say
from fltea.diagnostics import host_system
from fltea.diagnostics.finding import problem
from fltea.identification import terminal
from fltea.identification.axis_report import FileReport
from fltea.recording.reading import Answer
from fltea.records.errors import FlteaError, UsageError
from fltea.records.records import Error
from fltea.records.stats import LinkStats, SampleStats
from fltea.sinks.log import LogSink
from fltea.sinks.page import facts
from fltea.sinks.table import TableSink
from fltea.wire.block_reader import FrameReader
from fltea.wire.inspection import inspect
from fltea.wire.messages import encode
from rich.console import Console

from tests.rig.fake_system import FakeSystem
from tests.rig.host_support import WIRE_HELLO, hello

ASCII = "v1\x1b[2J\x1b]0;x\a\b\x7f"
"""Text that a board can send. A terminal that obeyed it would clear the screen, rename the window, ring the
bell, and delete characters.
"""
NASTY = ASCII + "\r\nfltea: all is well\x9b2J\u202etxt\u2066"
"""Text that recordings and names of files can contain, in addition to the ASCII text that boards can send."""
HELLO = hello(firmware_version=NASTY, sensor=NASTY, source=f"serial:{NASTY}", device_id=NASTY)


def log() -> str:
    lines: list[str] = []
    LogSink(lines.append, several=False).write(Error("device_fault", NASTY, 1))
    assert len(lines) == 1
    return lines[0]


def table() -> str:
    console = Console(file=io.StringIO(), width=300, force_terminal=False)
    sink = TableSink(console)
    sink.write(HELLO)
    sink.write(Error("device_fault", NASTY, 1))
    sink.close()
    return console.file.getvalue()


def frames() -> str:
    data = encode(WIRE_HELLO._replace(firmware_version=ASCII), 1, 2)
    return "\n".join(inspect([b"\0" + data], FrameReader()))


def info() -> str:
    fields = dict.fromkeys(Summary.__struct_fields__, 0) | dict.fromkeys(("start_unix_ns", "rate_hz"))
    fields |= {"name": NASTY, "device": NASTY, "session": NASTY, "hello": HELLO, "about": NASTY}
    fields |= {
        "epochs": {},
        "link": LinkStats(),
        "counts": SampleStats(0, 0, 0, 0, 0),
        "notes": [NASTY],
        "unread": [NASTY],
    }
    fields["reading"] = [Answer("columns", NASTY, "stated", NASTY)]
    return as_text(Summary(**fields))


def identify() -> str:
    console = Console(file=io.StringIO(), width=300, force_terminal=False)
    report = FileReport(NASTY, failure=UsageError(f"{NASTY}: cannot be read."))
    terminal.show(console, report)
    terminal.summary(console, [report, report])
    return console.file.getvalue()


@pytest.mark.parametrize("shown", [log, table, frames, info, identify])
def test_no_text_for_a_person_holds_what_steers(shown: Callable[[], str]) -> None:
    text = shown()
    assert text.replace("\n", "").isprintable()
    assert r"v1\x1b[2J\x1b]0;x\x07" in text


def _doctor() -> None:
    cli_devices._show(problem("device", NASTY, NASTY), several=False)


def _recorder() -> None:
    archive_record._Recorder._say(type("Quiet", (), {"_live": False})(), NASTY)  # type: ignore[attr-defined]


@pytest.mark.parametrize("show", [_doctor, lambda: say(NASTY), lambda: print_lines(NASTY), _recorder])
def test_nothing_printed_steers(show: Callable[[], None], capsys: pytest.CaptureFixture[str]) -> None:
    show()
    captured = capsys.readouterr()
    text = captured.out + captured.err
    assert text.replace("\n", "").isprintable()
    assert r"v1\x1b[2J" in text


def test_list_of_devices(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The serial number of a USB device is a text that comes from the device, which may be malicious."""
    system = FakeSystem(tmp_path)
    system.plug("/dev/ttyACM0", serial_number=NASTY)
    monkeypatch.setattr(host_system, "System", lambda: system)
    cli_devices.devices()
    shown = capsys.readouterr().out
    assert shown.replace("\n", "").isprintable()
    assert r"serial number v1\x1b[2J" in shown
    assert "\nfltea: all is well" not in shown


def test_last_line_of_a_failed_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail() -> None:
        raise FlteaError(f"{NASTY}: cannot be read.")

    monkeypatch.setattr(cli_app, "app", fail)
    with pytest.raises(SystemExit):
        cli_app.main()
    error = capsys.readouterr().err
    assert error.replace("\n", "").isprintable()
    assert r"v1\x1b[2J" in error


def test_page_shows_it_too() -> None:
    assert all(value.isprintable() for _, value in facts.device(HELLO, None))


def test_records_keep_what_was_said() -> None:
    """Records keep the control characters of a text, since a replay has to equal its recording. JSON escapes
    these characters.
    """
    line = msgspec.json.encode(hello(firmware_version=ASCII))
    assert b"\x1b" not in line
    assert json.loads(line)["firmware_version"] == ASCII
