"""Tests that each output counts the records that it loses while what it writes to has failed."""

import os
import socket
import stat
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from fltea.records.records import Gap
from fltea.service.sink_queue import SinkQueue
from fltea.settings.config import load_configs
from fltea.settings.outputs import OUTPUTS, Output
from fltea.sinks.opening import Opening, output_module

from tests.rig.sink_records import HELLO
from tools.faults.program import PATIENCE_S

RECORDS = 3000

Settings = dict[str, Any]


def full_stdout(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Settings:
    """Make the standard output a file on a full disk."""
    descriptor = os.open("/dev/full", os.O_WRONLY)
    monkeypatch.setattr("sys.stdout", SimpleNamespace(fileno=lambda: descriptor))
    return {}


def full_disk(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Settings:
    """Make the disk full: nothing can be written to files."""
    write = os.write

    def refuse(descriptor: int, data: bytes) -> int:
        if stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError(28, "No space left on device")
        return write(descriptor, data)

    monkeypatch.setattr(os, "write", refuse)
    return {"record.folder": str(tmp_path / "recordings")}


def nobody(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Settings:
    """Return the address of a broker at which nothing answers."""
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        return {"mqtt.broker": f"mqtt://127.0.0.1:{unused.getsockname()[1]}"}


FAILURES: dict[str, Callable[[pytest.MonkeyPatch, Path], Settings]] = {
    "ndjson": full_stdout,
    "record": full_disk,
    "mqtt.sink": nobody,
    "mqtt.many": nobody,
}
"""For each module of an output, a function after which writing fails; it returns settings."""

NOTHING_TO_LOSE = {"metrics.sink", "page.sink", "table"}
"""Modules of outputs that only show the newest figures."""


@pytest.mark.parametrize("output", OUTPUTS, ids=lambda output: output.module)
def test_what_an_output_loses_is_counted(
    output: Output, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    if output.module in NOTHING_TO_LOSE:
        return
    assert output.module in FAILURES, f"tests/service/test_output_losses.py: FAILURES has no {output.module}"
    settings = FAILURES[output.module](monkeypatch, tmp_path)
    configs = load_configs(None, {"format": "none"} | settings, ["synthetic:"])
    nothing: Any = None
    opening = Opening(configs, "due", ["other"], ["many"], lambda *_: None, list, nothing, lambda text: None)
    sink_queue = SinkQueue(output_module(output).open_output(opening), lambda *_: None)
    sink_queue.start()
    sink_queue.put([HELLO, *(Gap(seq, 1, 1, 0, device="due") for seq in range(RECORDS - 1))], wait=True)
    sink_queue.close()
    assert sink_queue.join(PATIENCE_S)
    stats = sink_queue.stats()
    assert stats.written + stats.dropped == RECORDS, f"sinks/{output.module}: {stats}"
    assert stats.dropped > RECORDS / 2, f"sinks/{output.module} does not count what it loses: {stats}"
