"""Tests of the JSON lines that are made directly from a block of samples. They equal the lines that msgspec
and the recorder make of the block's records.
"""

import math

import msgspec
import numpy as np
import pytest
from fltea._native import Lines
from fltea.recording.schema import encode_message
from fltea.records.block import AxisColumns, Block, TrackedColumns
from fltea.records.fit import Interval
from fltea.records.ports import Wanted
from fltea.records.records import ACCEL_AXES, AXES
from fltea.sinks.json_lines import BlockLines
from hypothesis import given, settings
from hypothesis import strategies as st

numbers = st.floats() | st.integers(-(2**64), 2**64).map(float) | st.floats(-2, 2).map(lambda x: round(x, 3))
intervals = st.builds(Interval, *[st.none() | st.floats(allow_nan=False, allow_infinity=False)] * 3)
names = st.text(max_size=8)


def columns(draw: st.DrawFn, n: int, axes: int, count: int) -> list[np.ndarray]:
    """Draw columns that are contiguous in memory, as the estimator returns them."""
    values = draw(st.lists(numbers, min_size=4, max_size=20))
    order = np.random.default_rng(draw(st.integers(0, 99))).integers(0, len(values), (count, n, axes))
    return list(np.array(values)[order])


def flags(draw: st.DrawFn, n: int, axes: int) -> np.ndarray:
    return np.array(draw(st.lists(st.booleans(), min_size=n * axes, max_size=n * axes))).reshape(n, axes)


@st.composite
def blocks(draw: st.DrawFn) -> Block:
    n, whole = draw(st.integers(1, 30)), st.integers(-(2**63), 2**63 - 1)
    first = draw(st.integers(0, 10**12))
    sensors = draw(st.sampled_from([[], ["gyro"], ["accel"], ["gyro", "accel"]]))
    has = draw(st.tuples(*[st.booleans()] * 5))
    estimates, tracked = [], []
    for unit, all_axes in (("deg/s", AXES), ("m/s^2", ACCEL_AXES)):
        if ("gyro" if unit == "deg/s" else "accel") not in sensors:
            continue
        axes = tuple(draw(st.lists(st.sampled_from(all_axes), min_size=1, max_size=3, unique=True)))
        m = len(axes)
        each = st.tuples(*[st.none() | numbers.filter(math.isfinite)] * m)
        words = st.tuples(*[st.sampled_from([None, "rejected", "not rejected"])] * m)
        values, flag = columns(draw, n, m, 6), [flags(draw, n, m), flags(draw, n, m)]
        estimates.append(AxisColumns(axes, unit, draw(each), draw(words), *values, *flag))
        verdicts = st.tuples(*[st.sampled_from([None, "white", "fractional"])] * m)
        fits = draw(verdicts), draw(st.tuples(*[intervals] * m)), draw(st.tuples(*[intervals] * m))
        tracked.append(TrackedColumns(axes, unit, *columns(draw, n, m, 5), flags(draw, n, m), *fits))
    return Block(
        draw(st.none() | names),
        draw(st.integers(0, 10**6)),
        np.arange(first, first + n),
        *(np.array(draw(st.lists(whole, min_size=n, max_size=n)), dtype=np.int64) for _ in range(2)),
        columns(draw, n, 3, 1)[0],
        columns(draw, n, 3, 1)[0] if has[0] else None,
        columns(draw, n, 1, 1)[0][:, 0] if has[1] else None,
        np.arange(n) if has[2] else None,
        draw(names),
        tuple(estimates),
        draw(st.integers(1, 7)),
        corrected=has[3],
        tracked=tuple(tracked) if has[4] else (),
    )


@given(blocks(), st.tuples(*[st.booleans()] * 4), st.data())
@settings(max_examples=40, deadline=None)
def test_lines_are_what_msgspec_makes_of_the_records(
    block: Block, wanted: tuple[bool, ...], data: st.DataObject
) -> None:
    kinds = Wanted(*wanted)
    lines = BlockLines()
    encode = msgspec.json.encode if kinds.nulls else encode_message
    for part in (block, block.rows(0, data.draw(st.integers(1, len(block))))):
        records = part.records(samples=kinds.samples, estimates=kinds.estimates, corrected=kinds.corrected)
        expected = b"".join(encode(record) + b"\n" for record in records)
        assert lines.of(part, kinds, part.due_rows) == expected


def test_every_number_is_written_as_msgspec_writes_it() -> None:
    rng = np.random.default_rng(1)
    ends = [10.0**k * s for k in range(-30, 30) for s in (1, -1, 9.999999999999998, 1.2345678901234567)]
    bits = rng.integers(0, 2**64, 30_000, dtype=np.uint64).view(np.float64)
    values = [*ends, 0.0, -0.0, 5e-324, 2.0**53, *bits, *rng.normal(0, 100, 10_000).round(4)]
    n = len(values)
    zeros = np.zeros(n, dtype=np.int64)
    block = Block(None, 1, np.arange(n), zeros, zeros, np.array(values)[:, np.newaxis])
    lines = BlockLines().of(block, Wanted(samples=True), range(n)).splitlines()
    assert lines == [msgspec.json.encode(one) for one in block.samples()]


@pytest.mark.parametrize(
    ("columns", "rows"),
    [
        ([np.zeros((3, 1))], (0, 3, 1)),
        ([np.zeros((3, 2))], (0, 4, 1)),
        ([np.zeros((3, 2))], (0, 3, 0)),
        ([np.zeros((3, 2), dtype=np.int32)], (0, 3, 1)),
        ([np.zeros((3, 2, 2))], (0, 3, 1)),
        ([], (0, 3, 1)),
    ],
)
def test_columns_without_the_rows_of_a_text_are_refused(columns: list, rows: tuple[int, int, int]) -> None:
    lines, found = Lines([b"[", b"]\n"], [(0, 1)], True), bytearray(b"[]\n")
    lines.add(found, [np.array([[0, 0.5], [0, np.nan], [0, 1e16]])], 0, 3, 2)
    with pytest.raises(ValueError, match=r"column|step"):
        lines.add(found, columns, *rows)
    assert found == b"[]\n[0.5]\n[1e16]\n"
