"""The vectors of protocol/vectors against the host and, where it encodes, against the device's code.

Sources: PyPI cobs, zlib and struct (tools/make_vectors.py), and published values typed by hand (cited there).
"""

import subprocess
import sys
import zlib
from collections import Counter
from struct import pack

import pytest
from cobs import cobs
from fltea import _native
from fltea.wire import layout as wire
from fltea.wire.block_reader import BlockReader
from fltea.wire.framing import BadFrame, encode_frame
from fltea.wire.messages import REASONS, Frame, FrameReader, Refused, decode, encode
from native_frames import counted, flat, in_chunks
from protocol_support import ROOT, names, records, run, table

GOOD, BAD, STREAMS = records("good.txt"), records("bad.txt"), records("streams.txt")


@pytest.mark.parametrize(("crc", "data"), table("crc32.txt"))
def test_crc32(crc: str, data: str) -> None:
    assert _native.crc32(run(data)) == int(crc, 16)
    assert zlib.crc32(run(data)) == int(crc, 16)


@pytest.mark.parametrize(("plain", "encoded"), table("cobs.txt"))
def test_cobs(plain: str, encoded: str) -> None:
    assert _native.cobs_encode(run(plain)) == run(encoded)
    assert cobs.encode(run(plain)) == run(encoded)
    assert cobs.decode(run(encoded)) == run(plain)


@pytest.mark.parametrize("record", GOOD, ids=names(GOOD))
def test_good_frame(record: list[tuple[str, str]]) -> None:
    row = dict(record)
    kind, sequence, device_us = int(row["type"]), int(row["sequence"]), int(row["device_us"])
    payload, on_wire = bytes.fromhex(row["payload"]), bytes.fromhex(row["wire"])
    assert encode_frame(kind, sequence, device_us, payload) == on_wire
    assert _native.encode_frame(kind, sequence, device_us, payload) == on_wire
    if kind not in wire.MESSAGES:
        return
    message = wire.MESSAGES[kind].unpack(payload)
    fields = [value.split(" ", 1) for key, value in record if key == "field"]
    assert [name for name, *_ in fields] == list(message._fields)
    for (_, *text), value in zip(fields, message, strict=True):
        if isinstance(value, float):
            assert pack("<f", float(*text)) == pack("<f", value)
        else:
            assert (value.hex() if isinstance(value, bytes) else str(value)) == "".join(text)
    frame = decode(cobs.decode(on_wire[:-1]))
    assert repr(frame) == repr(Frame(kind, sequence, device_us, message))  # a NaN equals itself as text alone
    assert encode(message, sequence, device_us) == on_wire
    assert _native.encode_message(kind, sequence, device_us, tuple(message)) == on_wire


@pytest.mark.parametrize("record", GOOD, ids=names(GOOD))
def test_good_frame_to_the_native_decoder(record: list[tuple[str, str]]) -> None:
    row = dict(record)
    kind, on_wire = int(row["type"]), bytes.fromhex(row["wire"])
    (found,) = flat(BlockReader().feed(on_wire))
    assert found.end == len(on_wire)
    if kind in wire.MESSAGES:
        assert repr(found.item) == repr(decode(cobs.decode(on_wire[:-1])))
    else:
        assert found.item == BadFrame("unknown_type", on_wire[:-1])


def shown(item: Frame | BadFrame | Refused) -> str:
    match item:
        case Frame(kind, sequence, device_us, _):
            return f"frame {kind} {sequence} {device_us}"
        case BadFrame(reason, _):
            return f"bad {reason}"
        case Refused(major, minor, schema):
            return f"refused {major} {minor} {schema:08x}"


@pytest.mark.parametrize("record", BAD, ids=names(BAD))
def test_bad_frame(record: list[tuple[str, str]]) -> None:
    _, expected, (_, data) = record
    reader = FrameReader()
    assert list(map(shown, reader.feed_all(bytes.fromhex(data)))) == [" ".join(expected)]
    assert reader.counts == ({expected[1]: 1} if expected[0] == "bad" else {})
    assert [shown(item) for item, _ in flat(BlockReader().feed(bytes.fromhex(data)))] == [" ".join(expected)]


@pytest.mark.parametrize("record", STREAMS, ids=names(STREAMS))
def test_stream(record: list[tuple[str, str]]) -> None:
    """Once through each decoder; that chunks do not matter is tested with any bytes."""
    data = b"".join(bytes.fromhex(value) for key, value in record if key == "bytes")
    expected = [f"{key} {value}" for key, value in record if key in ("frame", "bad", "refused")]
    counts = Counter({v.split()[0]: int(v.split()[1]) for key, v in record if key == "count"})
    chunks = [data[i : i + 7] for i in range(0, len(data), 7)]
    reader = FrameReader()
    found = [item for chunk in chunks for item in reader.feed_all(chunk)]
    assert list(map(shown, found)) == expected
    assert reader.counts == counts
    assert reader.bytes_in == len(data)
    good = FrameReader()
    assert repr(good.feed(data)) == repr([item for item in found if not isinstance(item, BadFrame)])
    native = in_chunks(BlockReader(), chunks)
    assert [shown(item) for item, _ in native] == expected
    assert counted(native) == counts
    assert counted(native).keys() <= {"frames", *REASONS}


def test_every_reason_has_a_vector() -> None:
    assert {value for record in BAD for key, value in record if key == "bad"} == set(REASONS)


def test_every_message_has_vectors() -> None:
    assert {int(dict(record)["type"]) for record in GOOD} >= set(wire.MESSAGES)


def test_files_are_what_the_tool_writes() -> None:
    tool = [sys.executable, "-W", "error", str(ROOT / "tools/make_vectors.py"), "--check"]
    done = subprocess.run(tool, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
