"""The native decoder against the Python one on any bytes, in any chunks (vectors: tests/protocol).

The oracle is `FrameReader` fed byte by byte: what comes with a byte ends behind that byte.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from fltea import _native
from fltea.wire import layout as wire
from fltea.wire.block_reader import BlockReader, Decoded, Located, SampleColumns
from fltea.wire.framing import BadFrame, Deframer, encode_frame
from fltea.wire.messages import Frame, FrameReader, encode
from hypothesis import given
from hypothesis import strategies as st
from native_frames import Found, counted, flat, in_chunks
from protocol_support import fixed, messages, sequences, times

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
    """A composite strategy has a short repr, which hypothesis writes for every example that it gives up."""
    return encode(draw(st.one_of(samples, messages)), draw(sequences), draw(times))


good = good_frames()
# Intact, of any type and length: unknown types, wrong lengths, HELLOs of other versions.
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
# Half of it samples, so that runs of them stand before, between and behind everything else. (one_of would
# take branches that are alike for one.)
halves = st.booleans().flatmap(lambda sample: sample_frames if sample else parts)
streams = st.lists(halves, max_size=12).map(b"".join)


def chunks_of(data: bytes, sizes: list[int]) -> list[bytes]:
    chunks = []
    for size in sizes:
        chunks.append(data[:size])
        data = data[size:]
    return [*chunks, data]


def oracle(data: bytes, reader: FrameReader) -> list[Found]:
    return [Found(item, i + 1) for i in range(len(data)) for item in reader.feed_all(data[i : i + 1])]


@given(streams)
@fixed(150)
def test_it_gives_what_the_python_decoder_gives(data: bytes) -> None:
    python, native = FrameReader(), BlockReader()
    found = flat(native.feed(data))
    assert repr(found) == repr(oracle(data, python))  # as text a NaN equals itself
    assert counted(found) == python.counts
    assert [item for item, _ in found if isinstance(item, BadFrame)] == [
        item for item in FrameReader().feed_all(data) if isinstance(item, BadFrame)
    ]
    assert native.bytes_in == len(data)


@given(streams, st.lists(st.one_of(st.integers(0, 30), st.integers(0, 300)), max_size=60))
@fixed(100)
def test_chunks_do_not_matter(data: bytes, sizes: list[int]) -> None:
    expected = repr(flat(BlockReader().feed(data)))
    assert repr(in_chunks(BlockReader(), chunks_of(data, sizes))) == expected
    assert repr(in_chunks(BlockReader(), [data[i : i + 1] for i in range(len(data))])) == expected


@given(st.lists(st.one_of(st.just("reset"), halves, st.binary(max_size=9)), max_size=12))
@fixed(150)
def test_reset_and_pending_are_those_of_the_python_decoder(steps: list[bytes | str]) -> None:
    python, native, deframer = FrameReader(), BlockReader(), Deframer()
    for step in steps:
        if isinstance(step, str):
            for reader in (python, native, deframer):
                reader.reset()
        else:
            assert repr([item for item, _ in flat(native.feed(step))]) == repr(python.feed_all(step))
            deframer.feed(step)
        assert native.pending == deframer.pending <= wire.MAX_ENCODED
    assert native.bytes_in == python.bytes_in


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
    types = ["uint16", "uint32", "int16", "int16", "int16", "uint8", "int64"]
    for (name, column), type in zip(columns._asdict().items(), types, strict=True):
        assert (column.dtype, column.shape) == (np.dtype(type), shapes.get(name, (n,)))
        assert column.flags.carray  # contiguous, aligned, writable
    assert columns.sequence.tolist() == list(range(n))
    assert columns.device_us.tolist() == list(range(0, 10 * n, 10))
    assert columns.gyro.tolist() == [[12, -7, 3]] * n
    assert columns.accel.tolist() == [[-120, 85, 16390]] * n
    assert columns.temperature.tolist() == [-1042] * n
    assert columns.flags.tolist() == [5] * n
    assert columns.end.tolist() == list(range(28, 28 * n + 1, 28))


def test_an_oversize_block_ends_where_it_became_too_long() -> None:
    run = b"\x55" * 1000
    (bad,) = BlockReader().feed(b"\0" + run)
    assert bad == Located(BadFrame("oversize", run[: wire.MAX_ENCODED]), 1 + wire.MAX_ENCODED + 1)


def test_endless_bytes_without_a_zero_take_no_memory() -> None:
    reader = BlockReader()
    found = [item for _ in range(1000) for item in reader.feed(b"\x55" * 100)]
    assert found == [Located(BadFrame("partial", b"\x55" * wire.MAX_ENCODED), 53)]
    assert reader.pending == 0


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
    assert columns is not None
    assert (columns[0].tolist(), others) == ([99], [])


def test_threads_may_share_a_decoder() -> None:
    # Whole frames a call, and so many that others run meanwhile: nothing is lost or mixed.
    decoder = _native.Decoder()
    with ThreadPoolExecutor(4) as threads:
        calls = [threads.submit(decoder.feed, encode(SAMPLE, k, k) * 2000) for k in range(40)]
        for k, call in enumerate(calls):
            columns, others = call.result()
            assert columns is not None
            assert not others
            assert columns[0].tolist() == [k] * 2000
