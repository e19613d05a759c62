"""Any bytes in any chunks: no exception, no growth, no wrong frame, and back in step after a 0x00."""

import random
from collections.abc import Iterator

import pytest
from cobs import cobs
from fltea.wire import layout as wire
from fltea.wire.framing import BadFrame, Deframer, encode_frame
from fltea.wire.messages import REASONS, Frame, FrameReader, encode
from hypothesis import given
from hypothesis import strategies as st
from protocol_support import fixed, messages, sequences, times

SAMPLE = wire.Sample(12, -7, 3, -120, 85, 16390, -1042, 0)
HELLO = wire.Hello(
    1, 0, wire.SCHEMA_HASH, 7, bytes(16), "fltea 0.1.0", 0x71, 1, 100_000, 2000, 164, 2, 16384, 184, 3
)
NEXT = encode(SAMPLE, 99, 990_000)

good = st.builds(encode, messages, sequences, times)
others = st.builds(encode_frame, st.integers(0, 255), sequences, times, st.binary(max_size=240))
runs = st.builds(lambda byte, n: bytes([byte]) * n, st.integers(0, 255), st.integers(1, 700))
cut = st.builds(
    lambda frame, a, b: frame[min(a, b) : max(a, b)], good, st.integers(0, 80), st.integers(0, 80)
)
streams = st.lists(
    st.one_of(good, good, others, cut, runs, st.just(b"\0"), st.binary(max_size=300)), max_size=12
).map(b"".join)


def chunks(data: bytes, sizes: list[int]) -> Iterator[bytes]:
    """`data` in pieces of these sizes, the rest at the end."""
    for size in sizes:
        yield data[:size]
        data = data[size:]
    yield data


@given(streams, st.lists(st.integers(0, 300), max_size=60))
@fixed(500)
def test_chunks_do_not_matter(data: bytes, sizes: list[int]) -> None:
    whole, pieces, single = FrameReader(), FrameReader(), FrameReader()
    expected = whole.feed_all(data)
    text = repr(expected)  # in which a NaN equals itself
    assert repr([item for chunk in chunks(data, sizes) for item in pieces.feed_all(chunk)]) == text
    assert repr([item for i in range(len(data)) for item in single.feed_all(data[i : i + 1])]) == text
    assert whole.counts == pieces.counts == single.counts
    assert whole.bytes_in == pieces.bytes_in == single.bytes_in == len(data)
    assert whole.counts["frames"] == sum(isinstance(item, Frame) for item in expected)
    assert whole.counts.keys() <= {"frames", *REASONS}
    assert whole.counts["partial"] <= 1


@pytest.mark.slow
@given(st.lists(streams, max_size=6))
@fixed()
def test_memory_is_bounded(parts: list[bytes]) -> None:
    deframer = Deframer()
    for part in parts:
        for item in deframer.feed(part):
            assert len(item.data if isinstance(item, BadFrame) else item) <= wire.MAX_ENCODED
        assert deframer.pending <= wire.MAX_ENCODED


def test_memory_is_bounded_without_any_zero() -> None:
    deframer = Deframer()
    found = [item for _ in range(10_000) for item in deframer.feed(b"\x55" * 100)]
    assert found == [BadFrame("oversize", b"\x55" * wire.MAX_ENCODED)]
    assert deframer.pending == 0


@given(streams)
@fixed()
def test_bytes_are_told_as_they_came(data: bytes) -> None:
    blocks = [block for block in data.split(b"\0")[:-1] if block]
    for item in FrameReader().feed_all(data):
        if isinstance(item, BadFrame):
            assert any(block.startswith(item.data) for block in [*blocks, data.rpartition(b"\0")[2]])


@given(st.binary(max_size=600), messages)
@fixed()
def test_after_garbage_and_a_zero_the_next_frame_arrives(garbage: bytes, message: wire.Message) -> None:
    found = FrameReader().feed(garbage + b"\0" + encode(message, 4, 5))
    assert repr(found[-1]) == repr(Frame(message.TYPE, 4, 5, message))


def test_two_blocks_that_decode_to_one_body_do_not_exist() -> None:
    # FrameReader relies on it when it gives back the bytes of a bad frame.
    source = random.Random(1)
    for _ in range(20_000):
        block = bytes(source.choices(range(1, 256 if source.random() < 0.5 else 8), k=source.randint(1, 252)))
        try:
            body = cobs.decode(block)
        except cobs.DecodeError:
            continue
        assert cobs.encode(body) == block


def damaged(frame: bytes, pattern: int, start: int) -> bytes:
    """`frame` with the bits of `pattern` flipped from bit `start` on, as far as it reaches."""
    mask = (pattern << start) % (1 << 8 * len(frame))
    return (int.from_bytes(frame, "little") ^ mask).to_bytes(len(frame), "little")


def must_be_rejected(frame: bytes, pattern: int, start: int) -> None:
    hurt = damaged(frame, pattern, start)
    # The 0x00 in front keeps the damage from counting as "partial"; the one behind closes what lost its own.
    found = FrameReader().feed(b"\0" + hurt + b"\0" + NEXT)
    assert [item.sequence for item in found if isinstance(item, Frame)] == [99], (hurt.hex(), pattern, start)
    assert len(found) == 1


@pytest.mark.parametrize("message", [SAMPLE, SAMPLE._replace(gyro_x=0, accel_x=0), HELLO])
def test_bursts_are_rejected(message: wire.Message) -> None:
    """Every start and length of a burst: all ones, both ends alone, and random insides."""
    # Bits 0 to 7 of a byte travel in this order on a UART, so a burst on the line is a run of these bits.
    # Those that begin before the closing 0x00 may reach over it; one in it alone is tested below.
    frame = encode(message, 513, 0x01020304)
    source = random.Random(2)
    for start in range(8 * (len(frame) - 1)):
        for length in range(1, 33):
            ends = 1 | 1 << (length - 1)
            for pattern in {ends, (1 << length) - 1, ends | source.getrandbits(length)}:
                if damaged(frame, pattern, start)[:-1] != frame[:-1]:
                    must_be_rejected(frame, pattern, start)


@pytest.mark.slow
@given(messages, st.integers(0, 2**11), st.integers(1, 2**32 - 1))
@fixed(750)
def test_bursts_in_any_message_are_rejected(message: wire.Message, start: int, pattern: int) -> None:
    frame = encode(message, 513, 0x01020304)
    pattern |= 1
    must_be_rejected(frame, pattern, start % (8 * (len(frame) - 1)))


def test_a_damaged_end_costs_two_frames_and_no_more() -> None:
    one, two, three = (encode(SAMPLE, n, n) for n in (1, 2, 3))
    for bit in range(8):
        reader = FrameReader()
        found = reader.feed(damaged(one, 1, 8 * (len(one) - 1) + bit) + two + three)
        assert [item.sequence for item in found if isinstance(item, Frame)] == [3]


def test_partial_is_the_first_block_only_and_again_after_reset() -> None:
    reader = FrameReader()
    assert reader.feed_all(NEXT[9:] + NEXT[9:] + NEXT[:5])[0].reason == "partial"
    assert set(reader.counts) - {"partial"} <= {"cobs", "crc"}
    assert reader.counts["partial"] == 1
    reader.reset()
    assert [type(item) for item in reader.feed_all(NEXT[9:] + NEXT)] == [BadFrame, Frame]
    assert reader.counts["partial"] == 2
    reader.reset()
    assert reader.feed_all(b"\0" + NEXT[9:])[0].reason != "partial"


def test_reset_drops_the_unfinished_block_and_the_oversize_run() -> None:
    for rest in (NEXT[:9], b"\x55" * 999):
        reader = FrameReader()
        reader.feed(NEXT + rest)
        reader.reset()
        assert [type(item) for item in reader.feed(NEXT)] == [Frame]
        assert reader.counts["frames"] == 2


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
def test_any_kind_of_bytes(kind: type) -> None:
    assert Deframer().feed(kind(NEXT)) == Deframer().feed(NEXT) != []
