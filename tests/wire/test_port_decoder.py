"""The native wire decoder as seen from Python; tests/native/test_port_decoder.cpp checks its results."""

import numpy as np
import pytest
from fltea._native import PortDecoder
from fltea.wire import layout as wire
from fltea.wire.messages import encode

SAMPLE = encode(wire.Sample(12, -7, 3, -120, 85, 16390, -1042, 5), 99, 990_000)


def line() -> PortDecoder:
    return PortDecoder(5 * 10**9, 10**9 // 2, 60 * 10**9)


@pytest.mark.parametrize("n", [1, 2, 1000])
def test_columns_are_plain_arrays_of_their_own(n: int) -> None:
    one = line()
    data = bytearray(b"".join(encode(wire.Sample(k, 1, 2, 3, 4, 5, 6, 7), k, 10 * k) for k in range(n)))
    one.feed_one(data, 3, 4, 3)
    data[:] = bytes(len(data))
    found = one.next()
    assert found is not None
    assert found[0] == "samples"
    columns = found[1]
    one.feed_one(SAMPLE * n, 5, 6, 5)
    assert one.next() is not None
    del one
    types = ["int64", "int64", "int64", "int16", "int16", "int16", "int64"]
    shapes = [(n,), (n,), (n,), (n, 3), (n, 3), (n,), (n,)]
    for column, type, shape in zip(columns, types, shapes, strict=True):
        assert (column.dtype, column.shape) == (np.dtype(type), shape)
        assert column.flags.carray  # `carray`: the column is contiguous in memory, aligned and writable
    sequence, device_us, host_ns, gyro, accel, temperature, flags = columns
    assert sequence.tolist() == list(range(n))
    assert device_us.tolist() == list(range(0, 10 * n, 10))
    assert host_ns.tolist() == [3] * n
    assert gyro.tolist() == [[k, 1, 2] for k in range(n)]
    assert accel.tolist() == [[3, 4, 5]] * n
    assert (temperature.tolist(), flags.tolist()) == ([6] * n, [7] * n)


@pytest.mark.parametrize(
    ("end", "times"),
    [([], 0), ([27], 1), ([29], 1), ([-1, 28], 2), ([20, 10, 28], 3), ([28], 2)],
    ids=["none", "short", "long", "negative", "backwards", "times"],
)
def test_reads_that_do_not_fit_their_bytes_change_nothing(end: list[int], times: int) -> None:
    one, ends, zeros = line(), np.array(end, dtype=np.int64), np.zeros(times, dtype=np.int64)
    one.feed_one(SAMPLE[:9], 1, 0, 1)
    assert one.next() is None
    with pytest.raises(ValueError, match=r"\breads?\b"):
        one.feed(bytes(28), ends, zeros, zeros, 2)
    one.feed_one(SAMPLE[9:], 3, 0, 3)
    found = one.next()
    assert found is not None
    assert found[0] == "samples"
