"""The device's encoder (C++) gives the bytes of the host's, for everything that both can encode."""

import zlib

import pytest
from cobs import cobs
from fltea import _native
from fltea.wire import layout as wire
from fltea.wire.messages import encode, encode_frame
from hypothesis import given
from hypothesis import strategies as st
from protocol_support import fixed, messages, sequences, times

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
