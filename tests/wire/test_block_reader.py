"""Tests of the decoder with any bytes, in any chunks.

Memory stays bounded, no wrong frame is decoded, and a second, plain decoder agrees.
"""

import random
from collections import Counter
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from fltea import _native
from fltea.wire import layout as wire
from fltea.wire.block_reader import BlockReader, Decoded, FrameReader, Located, SampleColumns
from fltea.wire.messages import BadFrame, Frame, encode, encode_frame
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.plain_decoder import Found, decoded, in_chunks, unfinished
from tests.rig.protocol_support import HELLO, fixed, messages, sequences, times
from tests.rig.tiers import long

SAMPLE = wire.Sample(12, -7, 3, -120, 85, 16390, -1042, 5)
NEXT = encode(SAMPLE, 99, 990_000)


def flip(frame: bytes, bits: list[int]) -> bytes:
    hurt = bytearray(frame)
    for bit in bits:
        hurt[bit // 8 % len(hurt)] ^= 1 << bit % 8
    return bytes(hurt)


counts = st.integers(-(2**15), 2**15 - 1)
samples = st.builds(wire.Sample, *[st.one_of(st.just(0), counts)] * 7, st.integers(0, 255))
sample_frames = st.builds(encode, samples, sequences, times)


@st.composite
def good_frames(draw: st.DrawFn) -> bytes:
    """Draw a good frame.

    This strategy is composite because its repr is short. Hypothesis writes the repr for every rejected
    example, which takes time.
    """
    return encode(draw(st.one_of(samples, messages)), draw(sequences), draw(times))


good = good_frames()
# Undamaged frames of any type and length. Some have unknown types, wrong lengths, or other protocol versions.
intact = st.builds(
    encode_frame, st.one_of(st.integers(0, 8), st.integers(0, 255)), sequences, times, st.binary(max_size=240)
)
mutated = st.builds(flip, good, st.lists(st.integers(0, 2**11), min_size=1, max_size=3))
cut = st.builds(lambda frame, a, b: frame[min(a, b) : max(a, b)], good, *[st.integers(0, 113)] * 2)
runs = st.builds(
    lambda byte, n: bytes([byte]) * n,
    st.integers(0, 255),
    st.one_of(st.integers(250, 255), st.integers(1, 700)),
)
idle = st.builds(bytes, st.integers(1, 3))
parts = st.one_of(good, intact, mutated, cut, runs, idle, st.binary(max_size=300))
# Half of the frames are samples, so that several samples in a row occur before, between and after other
# frames. `one_of` could not do this, since it merges equal branches.
halves = st.booleans().flatmap(lambda sample: sample_frames if sample else parts)
streams = st.lists(halves, max_size=12).map(b"".join)


def chunks_of(data: bytes, sizes: list[int]) -> list[bytes]:
    chunks = []
    for size in sizes:
        chunks.append(data[:size])
        data = data[size:]
    return [*chunks, data]


@given(streams)
@fixed(250)
def test_it_gives_what_the_plain_decoder_gives(data: bytes) -> None:
    blocks, frames = BlockReader(), FrameReader()
    expected = decoded(data)
    # Results are compared as text, in which a NaN equals itself.
    assert repr(in_chunks(blocks, [data])) == repr(expected)
    assert repr(frames.feed_all(data)) == repr([item for item, _ in expected])
    names = ("frames" if isinstance(item, Frame) else getattr(item, "reason", None) for item, _ in expected)
    assert frames.counts == Counter(name for name in names if name)
    assert blocks.bytes_in == frames.bytes_in == len(data)
    good = [item for item, _ in expected if not isinstance(item, BadFrame)]
    assert repr(FrameReader().feed(data)) == repr(good)


@pytest.mark.parametrize("examples", [150, long(400)])
def test_chunks_do_not_matter(examples: int) -> None:
    @given(streams, st.lists(st.one_of(st.integers(0, 30), st.integers(0, 300)), max_size=60))
    @fixed(examples)
    def holds(data: bytes, sizes: list[int]) -> None:
        expected = repr(decoded(data))
        assert repr(in_chunks(BlockReader(), chunks_of(data, sizes))) == expected
        assert repr(in_chunks(BlockReader(), [data[i : i + 1] for i in range(len(data))])) == expected

    holds()


@given(st.lists(st.one_of(st.just("reset"), halves, st.binary(max_size=9)), max_size=12))
@fixed(150)
def test_a_reset_begins_anew_and_what_is_kept_is_bounded(steps: list[bytes | str]) -> None:
    reader, since, found = BlockReader(), b"", list[Found]()
    for step in steps:
        if isinstance(step, str):
            reader.reset()
            since, found = b"", []
        else:
            found += in_chunks(reader, [step])
            since += step
        assert repr([item for item, _ in found]) == repr([item for item, _ in decoded(since)])
        assert reader.pending == unfinished(since) <= wire.MAX_ENCODED
    assert reader.bytes_in == sum(len(step) for step in steps if isinstance(step, bytes))


@given(streams)
@fixed()
def test_samples_come_in_runs_as_long_as_can_be(data: bytes) -> None:
    before: Decoded | None = None
    for one in BlockReader().feed(data):
        if isinstance(one, SampleColumns):
            assert not isinstance(before, SampleColumns)
            assert len({len(column) for column in one}) == 1
            assert len(one.end) > 0
        else:
            assert not (isinstance(one.item, Frame) and one.item.type == wire.Sample.TYPE)
        before = one


@pytest.mark.parametrize("n", [1, 2, 3, 1000])
def test_columns_are_plain_arrays_of_their_own(n: int) -> None:
    reader = BlockReader()
    data = bytearray(b"".join(encode(SAMPLE, k, 10 * k) for k in range(n)))
    (columns,) = reader.feed(data)
    assert isinstance(columns, SampleColumns)
    data[:] = bytes(len(data))
    reader.feed(encode(wire.Sample(*(1,) * 8), 7, 7) * n)
    del reader
    shapes = {"gyro": (n, 3), "accel": (n, 3)}
    types = ["int64", "int64", "int16", "int16", "int16", "int64", "int64"]
    for (name, column), type in zip(columns._asdict().items(), types, strict=True):
        assert (column.dtype, column.shape) == (np.dtype(type), shapes.get(name, (n,)))
        assert column.flags.carray  # `carray`: the column is contiguous in memory, aligned and writable
    assert columns.sequence.tolist() == list(range(n))
    assert columns.device_us.tolist() == list(range(0, 10 * n, 10))
    assert columns.gyro.tolist() == [[12, -7, 3]] * n
    assert columns.accel.tolist() == [[-120, 85, 16390]] * n
    assert columns.temperature.tolist() == [-1042] * n
    assert columns.flags.tolist() == [5] * n
    assert columns.end.tolist() == list(range(28, 28 * n + 1, 28))


def test_endless_bytes_without_a_zero_take_no_memory() -> None:
    reader = BlockReader()
    found = [item for _ in range(1000) for item in reader.feed(b"\x55" * 100)]
    assert found == [Located(BadFrame("partial", b"\x55" * wire.MAX_ENCODED), 53)]
    assert reader.pending == 0


def damaged(frame: bytes, pattern: int, start: int) -> bytes:
    """Return `frame` with the bits of `pattern` flipped, beginning at bit `start`."""
    mask = (pattern << start) % (1 << 8 * len(frame))
    return (int.from_bytes(frame, "little") ^ mask).to_bytes(len(frame), "little")


def must_be_rejected(frame: bytes, pattern: int, start: int) -> None:
    hurt = damaged(frame, pattern, start)
    # After the first 0x00, the reader sees the damaged frame from its beginning, so it is not "partial". The
    # other 0x00 ends the frame, in case the frame's own closing 0x00 is damaged.
    found = FrameReader().feed(b"\0" + hurt + b"\0" + NEXT)
    assert [item.sequence for item in found if isinstance(item, Frame)] == [99], (hurt.hex(), pattern, start)
    assert len(found) == 1


@pytest.mark.parametrize("message", [SAMPLE, SAMPLE._replace(gyro_x=0, accel_x=0), HELLO])
def test_bursts_are_rejected(message: wire.Message) -> None:
    """Bursts of errors of each length up to 32 bits are tried, at every bit before the closing 0x00.

    Each burst is tried three times. The wrong bits are all bits of the burst, then only the first and the
    last, then these two and random ones in between.
    """
    # A UART sends bits 0 to 7 of a byte in this order, so a burst on the wire concerns successive bits. A
    # burst that begins before the closing 0x00 may reach into the next frame. Bursts in the 0x00 alone are
    # tested below.
    frame = encode(message, 513, 0x01020304)
    source = random.Random(2)
    for start in range(8 * (len(frame) - 1)):
        for length in range(1, 33):
            ends = 1 | 1 << (length - 1)
            for pattern in {ends, (1 << length) - 1, ends | source.getrandbits(length)}:
                if damaged(frame, pattern, start)[:-1] != frame[:-1]:
                    must_be_rejected(frame, pattern, start)


def test_a_damaged_end_costs_two_frames_and_no_more() -> None:
    one, two, three = (encode(SAMPLE, n, n) for n in (1, 2, 3))
    for bit in range(8):
        found = FrameReader().feed(damaged(one, 1, 8 * (len(one) - 1) + bit) + two + three)
        assert [item.sequence for item in found if isinstance(item, Frame)] == [3]


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
def test_any_kind_of_bytes(kind: type) -> None:
    (columns,) = BlockReader().feed(kind(NEXT))
    assert columns.sequence.tolist() == [99]


def test_what_is_not_bytes_is_refused_and_changes_nothing() -> None:
    decoder = _native.Decoder()
    decoder.feed(NEXT[:9])
    with pytest.raises(TypeError, match="bytes-like"):
        decoder.feed("text")
    with pytest.raises(BufferError):
        decoder.feed(memoryview(NEXT)[::2])
    columns, others = decoder.feed(NEXT[9:])
    assert (columns[0].tolist(), others) == ([99], [])


def test_threads_may_share_a_decoder() -> None:
    # Several threads decode at the same time. Each call gets so many frames that other threads run meanwhile.
    # No thread may lose frames or get those of another thread.
    decoder = _native.Decoder()
    with ThreadPoolExecutor(4) as threads:
        calls = [threads.submit(decoder.feed, encode(SAMPLE, k, k) * 2000) for k in range(40)]
        for k, call in enumerate(calls):
            columns, others = call.result()
            assert not others
            assert columns[0].tolist() == [k] * 2000
