"""Tests the host's code with the vectors in protocol/vectors. The vectors for encoding also test the device's
code.

The vectors come from the packages cobs, zlib and struct (tools/make_vectors.py), and from published values
copied by hand, which are cited there.
"""

import zlib
from collections import Counter
from struct import pack

import pytest
from cobs import cobs
from fltea import _native
from fltea.wire import layout as wire
from fltea.wire.block_reader import BlockReader, FrameReader
from fltea.wire.messages import REASONS, BadFrame, Frame, Refused, encode, encode_frame

from tests.rig.plain_decoder import Found, decoded, in_chunks
from tests.rig.protocol_support import names, records, run, table

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
    (found,) = in_chunks(BlockReader(), [on_wire])
    # Results are compared as text, since a NaN does not equal itself as a number.
    assert repr([found]) == repr(decoded(on_wire))
    if kind not in wire.MESSAGES:
        assert found == Found(BadFrame("unknown_type", on_wire[:-1]), len(on_wire))
        return
    message = wire.MESSAGES[kind].unpack(payload)
    fields = [value.split(" ", 1) for key, value in record if key == "field"]
    assert [name for name, *_ in fields] == list(message._fields)
    for (_, *text), value in zip(fields, message, strict=True):
        if isinstance(value, float):
            assert pack("<f", float(*text)) == pack("<f", value)
        else:
            assert (value.hex() if isinstance(value, bytes) else str(value)) == "".join(text)
    assert repr(found) == repr(Found(Frame(kind, sequence, device_us, message), len(on_wire)))
    assert encode(message, sequence, device_us) == on_wire
    assert _native.encode_message(kind, sequence, device_us, tuple(message)) == on_wire


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
    assert [shown(item) for item in reader.feed_all(bytes.fromhex(data))] == [" ".join(expected)]
    assert reader.counts == ({expected[1]: 1} if expected[0] == "bad" else {})
    assert [shown(item) for item, _ in decoded(bytes.fromhex(data))] == [" ".join(expected)]


@pytest.mark.parametrize("record", STREAMS, ids=names(STREAMS))
def test_stream(record: list[tuple[str, str]]) -> None:
    """Each decoder decodes the vector's stream of bytes once, in chunks of fixed length. Another test divides
    streams into arbitrary chunks.
    """
    data = b"".join(bytes.fromhex(value) for key, value in record if key == "bytes")
    expected = [f"{key} {value}" for key, value in record if key in ("frame", "bad", "refused")]
    counts = Counter({v.split()[0]: int(v.split()[1]) for key, v in record if key == "count"})
    chunks = [data[i : i + 7] for i in range(0, len(data), 7)]
    reader = FrameReader()
    assert [shown(item) for chunk in chunks for item in reader.feed_all(chunk)] == expected
    assert reader.counts == counts
    assert reader.counts.keys() <= {"frames", *REASONS}
    assert [shown(item) for item, _ in decoded(data)] == expected


def test_every_reason_has_a_vector() -> None:
    assert {value for record in BAD for key, value in record if key == "bad"} == set(REASONS)


def test_every_message_has_vectors() -> None:
    assert {int(dict(record)["type"]) for record in GOOD} >= set(wire.MESSAGES)
