"""Tests that each output of `OUTPUTS` takes every kind of item, and that what it writes is text for others.

What an output writes is caught at the standard output, in its files, on its way into a socket, and where
records are encoded as JSON. What the lines or messages of an output say needs tests of its own.
"""

import base64
import contextlib
import json
import re
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from fltea.records.block import Block
from fltea.records.ports import Departed, Item, Printed, Sink, Wanted
from fltea.records.records import AnyRecord, Corrected, Error, Estimate, Gap, Sample
from fltea.settings.config import load_configs
from fltea.settings.outputs import Output
from fltea.sinks import record_json
from fltea.sinks.json_lines import BlockLines
from fltea.sinks.opening import Opening, output_module

from tests.rig.blocks import block_of_records
from tests.rig.example_records import MOVES, RESTS, STEP
from tests.rig.figure_records import EVERY_ESTIMATE, EVERYTHING, SAMPLE
from tests.rig.mcap_support import messages
from tests.rig.outputs import EACH_OUTPUT, switched_on

WITH_EACH_SAMPLE = (Sample, Estimate, Corrected)
"""Kinds of records that reach outputs only as rows of a block."""
SINGLE: list[AnyRecord] = [
    *(record for kind, record in EVERYTHING.items() if kind not in WITH_EACH_SAMPLE),
    *(STEP, MOVES, RESTS),
    Gap(700, 3, 5, 7_000_000_000, device="due"),
    Error("silent", "no data for [5 s], \u2028 \x00", 7_000_000_000, device="due"),
    Error("silent", "an error of the program", 7_000_000_000),
]
KINDS = "|".join(kind.__name__ for kind in (Block, Printed, *get_args(AnyRecord)))
OF_PYTHON = re.compile(rf"\bnp\.\w+\(|\barray\(|\bdtype=|\b(?:{KINDS})\(\w+=".encode())
"""What stands in a text of an array, of a number of numpy, or of a record that was converted by `str`."""

PLACES: dict[str, Callable[[Path], Any]] = {
    "record.folder": lambda folder: str(folder / "recordings"),
    "mqtt.broker": lambda folder: f"mqtt://127.0.0.1:{unused_port()}",
    "metrics.address": lambda folder: 0,
    "dashboard.address": lambda folder: 0,
}
"""For settings whose example is of no use in a test, a function that returns another value."""


def unused_port() -> int:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port: int = unused.getsockname()[1]
    return port


def three_rows() -> Block:
    """Return a block whose samples 900 and 902 have records; sample 901 has none."""
    one = block_of_records(SAMPLE, EVERY_ESTIMATE)
    sensors: dict[str, Any] = {
        "estimates": tuple(each._make((*each[:4], *map(thrice, each[4:]))) for each in one.estimates),
        "tracked": tuple(each._make((*each[:2], *map(thrice, each[2:8]), *each[8:])) for each in one.tracked),
    }
    columns = {name: thrice(getattr(one, name)) for name in ("device_us", "host_ns", "gyro_dps")}
    columns |= {name: thrice(getattr(one, name)) for name in ("temperature_c", "flags")}
    return one.but(seq=np.arange(900, 903), **columns, **sensors, every=2, corrected=True)


def thrice(column: Any) -> Any:
    return np.repeat(column, 3, axis=0)


class Written:
    """Catches what an output writes.

    `encoded`: records that were encoded as JSON; an output may send them later or never.
    """

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self._folder, self.sent, self.encoded = folder, list[bytes](), list[bytes]()
        self._stdout = (folder / "stdout").open("w+", encoding="utf-8")
        monkeypatch.setattr("sys.stdout", self._stdout)
        for name in ("send", "sendall", "sendto"):
            monkeypatch.setattr(socket.socket, name, self._spied(getattr(socket.socket, name)), raising=False)
        encode = record_json._encode

        def spied(record: object) -> bytes:
            self.encoded.append(encode(record))
            return self.encoded[-1]

        monkeypatch.setattr(record_json, "_encode", spied)

    def _spied(self, send: Callable[..., Any]) -> Callable[..., Any]:
        def spied(of: socket.socket, data: Any, *how: Any) -> Any:
            self.sent.append(bytes(data))
            return send(of, data, *how)

        return spied

    def close(self) -> None:
        """Close the file that stands for the standard output."""
        self._stdout.close()

    def outside(self) -> list[bytes]:
        """Return all that has left the program: contents of files, and data given to sockets."""
        if not self._stdout.closed:
            self._stdout.flush()
        files = [path for path in sorted(self._folder.rglob("*")) if path.is_file()]
        return [*self.sent, *(path.read_bytes() for path in files if path.suffix != ".mcap")]

    def recorded(self) -> list[bytes]:
        """Return the records in finished MCAP files."""
        files = sorted(self._folder.rglob("*.mcap"))
        return [message.data for file in files for topic, message in messages(file) if "wire" not in topic]


class Tried:
    """An output that was opened for a test. What goes wrong is told with its module and function."""

    def __init__(self, output: Output, folder: Path, written: Written, *, samples: bool) -> None:
        self.module, self.written = f"fltea.sinks.{output.module}", written
        on = PLACES[output.on](folder) if output.on in PLACES else switched_on(output)[output.on]
        settings = {"format": "none", "samples": samples, output.on: on}
        configs = load_configs(None, settings, ["synthetic:"])
        nothing: Any = None
        opening = Opening(
            configs, "due", ["other"], ["many"], lambda *_: None, list, nothing, lambda text: None
        )
        self.sink: Sink = self.tell(
            "open_output", "the settings", lambda: output_module(output).open_output(opening)
        )

    def tell(self, function: str, given: str, call: Callable[[], Any]) -> Any:
        """Call a function of the output; then check what the output has written."""
        where = f"{self.module}: open_output" if function == "open_output" else self.method(function)
        try:
            found = call()
        except Exception as error:
            raise AssertionError(f"{where} fails for {given}: {error!r}") from error
        for data in (*self.written.outside(), *self.written.encoded):
            assert (wrong := fault_in(data)) is None, f"{where} writes {wrong} for {given}: {data[-200:]!r}"
        return found

    def method(self, name: str) -> str:
        return f"{self.module}: {type(self.sink).__name__}.{name}"

    def write(self, item: Item) -> None:
        """Write an item. An output that takes lines of text has to write something then, or count a loss."""
        kind = type(item).__name__
        before = self.sink.lost, sum(map(len, self.written.outside()))
        self.tell("write", f"a {kind}", lambda: self.sink.write(item))
        self.tell("flush", f"a {kind}", self.sink.flush)
        after = self.sink.lost, sum(map(len, self.written.outside()))
        if self.sink.prints is not None:
            assert after != before, f"{self.method('write')} writes nothing for a {kind}"


BASE64 = base64.b64encode(b'{"class":')
"""The beginning of a line of a record, as base64."""


def fault_in(data: bytes) -> str | None:
    """Return what is wrong with a written text, in words; None if it seems to be right."""
    if BASE64 in data:
        return "lines of text as base64"
    if b"b'{" in data or b'b"{' in data:
        return "lines of text as Python shows bytes"
    if found := OF_PYTHON.search(data):
        return f"{found[0].decode()!r}, which is a text of a Python object,"
    for line in data.split(b"\n"):
        if line.startswith((b"{", b"[")):
            try:
                if not isinstance(json.loads(line, parse_constant=refuse), dict):
                    return "a list, not a JSON object,"
            except ValueError as error:
                return f"a line that is no JSON ({error})"
    return None


def refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no number of JSON")


def lines_for(sink: Sink, block: Block) -> Printed:
    """Return the lines of a block's records that this output asks for; for others, all lines."""
    wanted = sink.prints or Wanted(samples=True, estimates=True, corrected=True)
    return Printed(BlockLines().of(block, wanted, block.due_rows), len(block.due_rows))


def test_the_examples_are_of_every_kind() -> None:
    missing = {*get_args(AnyRecord)} - {*map(type, SINGLE)} - {*WITH_EACH_SAMPLE}
    assert not missing, f"tests/sinks/test_sink_contract.py: SINGLE has no {missing}"


@pytest.mark.parametrize("samples", [False, True], ids=["", "samples"])
@EACH_OUTPUT
def test_every_kind_of_item_is_taken_and_written_as_text(
    output: Output, samples: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = Written(tmp_path, monkeypatch)
    tried = Tried(output, tmp_path, written, samples=samples)
    sink = tried.sink
    try:
        write_everything(tried)
    except AssertionError:
        with contextlib.suppress(Exception):  # sockets that stay open would fail a later test
            sink.close()
        raise
    finally:
        written.close()
    recorded = written.recorded()
    assert bool(recorded) == (output.name == "record")
    assert not [data for data in recorded if fault_in(data)], f"{tried.method('write')} records no JSON"
    text = b"\n".join((*written.outside(), *recorded))
    assert b'"seq":901,' not in text, f"{tried.method('write')} writes a row that is not in `due_rows`"
    if sink.prints is not None:
        assert sink.prints.samples == samples, f"{tried.method('prints')} asks for samples: {not samples}"
        assert samples or b'"class":"sample"' not in text, f"{tried.method('write')} writes samples unasked"


def write_everything(tried: Tried) -> None:
    """Call every method of an output, as its queue does."""
    sink, block = tried.sink, three_rows()
    for record in SINGLE:
        tried.write(record)
    tried.write(block)
    tried.write(lines_for(sink, block))
    tried.tell("on_overflow", "3 lost items", lambda: sink.on_overflow(3))
    tried.tell("depart", "a device that is gone", lambda: sink.depart(Departed("due", moved=False)))
    tried.tell("close", "nothing", sink.close)
