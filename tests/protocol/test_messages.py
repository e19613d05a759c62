"""Tests the encoding and decoding of messages, values out of range, and which protocol versions are accepted.

The device's encoder makes the same bytes as the host's.
"""

import math
import struct
import zlib

import pytest
from cobs import cobs
from fltea import _native
from fltea.wire import layout as wire
from fltea.wire.block_reader import FrameReader
from fltea.wire.messages import BadFrame, Frame, Refused, encode, encode_frame, refusal
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.protocol_support import HELLO, PROTOCOL, fixed, messages, sequences, times


def decode(data: bytes) -> Frame | Refused | BadFrame:
    """Return the only frame in these bytes."""
    (found,) = FrameReader().feed_all(data)
    return found


@pytest.mark.slow
@given(messages, sequences, times)
@fixed(300)
def test_decode_undoes_encode(message: wire.Message, sequence: int, device_us: int) -> None:
    frame = decode(encode(message, sequence, device_us))
    # The two frames are compared as text, in which a NaN equals itself and -0.0 differs from 0.0. The text
    # also contains the message's class, so the classes are compared, too.
    assert repr(frame) == repr(Frame(message.TYPE, sequence, device_us, message))


def test_text_that_is_not_ascii_is_shown_with_replacement_characters() -> None:
    payload = HELLO.pack()[:26] + b"v1\xe9".ljust(24, b"\0") + HELLO.pack()[50:]
    assert wire.Hello.unpack(payload).firmware_version == "v1\N{REPLACEMENT CHARACTER}"


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"firmware_version": "x" * 25}, r"Hello.firmware_version: .* 25 characters long; at most 24 fit"),
        ({"firmware_version": "é"}, r"Hello.firmware_version: 'é' is not ASCII"),
        ({"device_id": bytes(15)}, r"Hello.device_id: 15 bytes; must be 16"),
        ({"device_id": bytes(17)}, r"Hello.device_id: 17 bytes; must be 16"),
    ],
)
def test_what_does_not_fit_its_field_is_named(change: dict[str, object], error: str) -> None:
    with pytest.raises(ValueError, match=error):
        encode(HELLO._replace(**change), 0, 0)


@pytest.mark.parametrize("value", [-32769, 32768])
def test_numbers_that_do_not_fit_raise(value: int) -> None:
    with pytest.raises(struct.error):
        encode(wire.Sample(value, 0, 0, 0, 0, 0, 0, 0), 0, 0)


FLOATS = wire.Estimate(0, 1, 2, 3, *(0.0,) * 6, *(0,) * 9, *(0.0,) * 4)
BEYOND = 2.0**128 - 2.0**103
"""The number half-way between the largest 32-bit float and the number that would follow it."""


@pytest.mark.parametrize(
    ("number", "rounded"),
    [
        (0.1, 0x3DCCCCCD),
        # this number is half-way between two 32-bit floats, so it is rounded to the even one
        (1 + 2.0**-24, 0x3F800000),
        (1 + 3 * 2.0**-24, 0x3F800002),
        (math.nextafter(BEYOND, 0.0), 0x7F7FFFFF),
        (2.0**-150, 0x00000000),
        (math.nextafter(-(2.0**-150), -1.0), 0x80000001),
        (-math.inf, 0xFF800000),
    ],
)
def test_a_float_is_rounded_to_the_nearest_f32(number: float, rounded: int) -> None:
    payload = FLOATS._replace(innovation=number).pack()
    assert struct.unpack_from("<I", payload, 28) == (rounded,)
    assert wire.Estimate.unpack(payload).innovation == struct.unpack("<f", struct.pack("<I", rounded))[0]


@pytest.mark.parametrize("number", [BEYOND, -BEYOND, 1e300])
def test_floats_that_do_not_fit_raise(number: float) -> None:
    with pytest.raises(OverflowError):
        encode(FLOATS._replace(alpha=number), 0, 0)


@pytest.mark.parametrize(("sequence", "device_us"), [(-1, 0), (65536, 0), (0, -1), (0, 2**32)])
def test_header_that_does_not_fit_raises(sequence: int, device_us: int) -> None:
    with pytest.raises(struct.error):
        encode(HELLO, sequence, device_us)


def test_payload_too_long_raises() -> None:
    assert len(encode_frame(9, 0, 0, bytes(240))) == wire.MAX_ENCODED + 1
    with pytest.raises(ValueError, match="payload has 241 bytes; a frame has room for at most 240"):
        encode_frame(9, 0, 0, bytes(241))


@pytest.mark.parametrize("size", [*range(6), 6, 67, 68, 69, 240])
@pytest.mark.parametrize(("major", "schema"), [(2, wire.SCHEMA_HASH), (1, 0xDEADBEEF), (0, 0)])
def test_another_version_is_refused_whatever_its_length(size: int, major: int, schema: int) -> None:
    payload = (struct.pack("<BBI", major, 5, schema) + bytes(234))[:size]
    reader = FrameReader()
    data = encode_frame(wire.Hello.TYPE, 0, 0, payload)
    (found,) = reader.feed_all(data)
    if size < 6:
        assert found == BadFrame("length", data[:-1])
        return
    assert isinstance(found, Refused)
    assert found == Refused(major, 5, schema)
    assert found.message == (
        f"device speaks protocol {major}.5, schema 0x{schema:08X}; "
        f"this fltea speaks {wire.PROTOCOL_MAJOR}.{wire.PROTOCOL_MINOR}, schema 0x{wire.SCHEMA_HASH:08X}"
    )
    assert reader.counts == {}, "it is no damage"


def test_another_minor_version_is_not_refused() -> None:
    assert refusal(HELLO._replace(protocol_minor=9).pack()) is None


def test_generated_module_agrees_with_the_definition() -> None:
    assert wire.MESSAGES.keys() == {message.id for message in PROTOCOL.messages}
    for message in PROTOCOL.messages:
        kind = wire.MESSAGES[message.id]
        assert message.size == kind.SIZE
        assert kind._fields == tuple(field.name for field in message.fields)
        assert {f.name: float(f.scale) for f in message.fields if f.scale is not None} == kind.SCALE
    assert wire.MAX_FRAME == 251
    assert len(cobs.encode(b"\1" * wire.MAX_FRAME)) == wire.MAX_ENCODED
    assert wire.SampleFlags(0xF5) & wire.SampleFlags.LATE
    assert [flag.value for flag in wire.SampleFlags] == [1, 2, 4, 8]
    assert wire.ResetCause(255).name == "UNKNOWN"


long = st.one_of(
    st.binary(max_size=1100),
    st.lists(st.sampled_from([b"\0", b"\1", b"\x55" * 253, b"\x55" * 254, b"\x55" * 255]), max_size=6).map(
        b"".join
    ),
)


@given(messages, sequences, times)
@fixed(300)
def test_messages(message: wire.Message, sequence: int, device_us: int) -> None:
    expected = encode(message, sequence, device_us)
    assert _native.encode_message(message.TYPE, sequence, device_us, tuple(message)) == expected


@pytest.mark.slow
@given(st.integers(0, 255), sequences, times, st.binary(max_size=wire.MAX_PAYLOAD))
@fixed(500)
def test_frames(kind: int, sequence: int, device_us: int, payload: bytes) -> None:
    assert _native.encode_frame(kind, sequence, device_us, payload) == encode_frame(
        kind, sequence, device_us, payload
    )


@given(long)
@fixed()
def test_cobs(data: bytes) -> None:
    assert _native.cobs_encode(data) == cobs.encode(data)


@given(long)
@fixed()
def test_crc32(data: bytes) -> None:
    assert _native.crc32(data) == zlib.crc32(data)


def test_payload_too_long() -> None:
    assert _native.encode_frame(9, 0, 0, bytes(240)) == encode_frame(9, 0, 0, bytes(240))
    with pytest.raises(ValueError, match="too long"):
        _native.encode_frame(9, 0, 0, bytes(241))


@pytest.mark.parametrize(
    ("kind", "fields", "error"),
    [
        (2, (32768, *(0,) * 7), "gyro_x: 32768 does not fit"),
        (2, (*(0,) * 7, 256), "flags: 256 does not fit"),
        (2, (0,) * 7, "flags: no value"),
        (2, (0,) * 9, "more values than fields"),
        (4, (256, 0), "code: 256 does not fit"),
        (1, (1, 0, 0, 0, bytes(15), "", *(0,) * 8), "device_id: must be 16 bytes"),
        (1, (1, 0, 0, 0, bytes(16), "x" * 25, *(0,) * 8), "firmware_version: at most 24 characters fit"),
        (5, (0, 1, 2, 3, 1e300, *(0.0,) * 5, *(0,) * 9), "alpha: .* does not fit"),
        (200, (), "no message of this type"),
    ],
)
def test_fields_that_do_not_fit(kind: int, fields: tuple[object, ...], error: str) -> None:
    with pytest.raises(ValueError, match=error):
        _native.encode_message(kind, 0, 0, fields)
