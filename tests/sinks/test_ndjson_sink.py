"""Tests of the output as JSON lines, which any JSON reader accepts."""

import io
import json
import math
import os
import threading
import time
from typing import Any

import pytest
from fltea.records.ports import Printed, SinkClosed, Wanted
from fltea.records.records import AnyRecord, Error, Gap, Sample
from fltea.sinks.ndjson import BUFFER, NdjsonSink
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.blocks import as_items
from tests.rig.example_records import axis_estimate
from tests.rig.host_support import strict_records
from tests.rig.sink_records import EPOCH, ERROR, FIT, HELLO, MOVES, RESTS, STATS, STEP, estimate

EVERY_KIND: list[AnyRecord] = [
    HELLO,
    EPOCH,
    Sample(1, 2, 3, 4, (0.5, -0.25), (9.8, 0.0, 0.0), 21.5, 3),
    estimate(),
    FIT,
    Gap(4, 5, 6, 7),
    STEP,
    MOVES,
    RESTS,
    STATS,
    ERROR,
]


def written(*records: AnyRecord, samples: bool = True) -> bytes:
    stream = io.BytesIO()
    sink = NdjsonSink(stream, samples=samples)
    for item in as_items(records):
        sink.write(item)
    sink.close()
    return stream.getvalue()


def test_one_object_a_line_with_its_class_first() -> None:
    data = written(*EVERY_KIND)
    assert strict_records(data) == EVERY_KIND
    first_keys = [next(iter(json.loads(line).items())) for line in data.splitlines()]
    kinds = [
        "hello",
        "epoch",
        "sample",
        "estimate",
        "fit",
        "gap",
        "step",
        "motion",
        "motion",
        "stats",
        "error",
    ]
    assert first_keys == [("class", kind) for kind in kinds]


def test_samples_only_on_request() -> None:
    kinds = [record.__class__ for record in strict_records(written(*EVERY_KIND, samples=False))]
    assert kinds == [kind.__class__ for kind in EVERY_KIND if not isinstance(kind, Sample)]


def test_newlines_in_a_text_stay_inside_the_line() -> None:
    assert written(Error("silent", "a\nb\r\n\u2028c", 1)).count(b"\n") == 1


def refuse_constant(text: str) -> None:
    raise AssertionError(text)


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=6, max_size=6))
def test_never_a_number_that_is_none(values: list[float]) -> None:
    """The pipeline replaces NaN by null. Even if a NaN remains, the line is still valid JSON."""
    line = written(estimate(gyro_x=axis_estimate(*values, True)))
    axis = json.loads(line, parse_constant=refuse_constant)["axes"]["gyro_x"]["fltea"]
    for found, value in zip(axis.values(), values, strict=False):
        assert found == (value if math.isfinite(value) else None)


class Stream(io.RawIOBase):
    """A stream that accepts a limited number of bytes at a time, or fails."""

    def __init__(self, failure: Exception | None = None, at_a_time: int = 1 << 20) -> None:
        self.data, self.failure, self.at_a_time, self.calls = bytearray(), failure, at_a_time, 0

    def write(self, data: Any) -> int | None:
        if self.failure:
            raise self.failure
        self.calls += 1
        taken = bytes(data[: self.at_a_time])
        self.data += taken
        return len(taken)


def test_lines_go_out_together_at_a_flush_and_at_once_when_many() -> None:
    stream = Stream()
    sink = NdjsonSink(stream, samples=True)
    for record in EVERY_KIND:
        sink.write(record)
    assert not stream.data
    sink.flush()
    assert stream.data == written(*EVERY_KIND)
    assert stream.calls == 1
    for _ in range(BUFFER // 100):
        sink.write(ERROR)
    assert stream.calls > 1


def test_what_was_printed_elsewhere_stands_between_the_records_around_it() -> None:
    stream = Stream()
    sink = NdjsonSink(stream, samples=True)
    sample, lines = Sample(1, 2, 3, 4, (0.5, -0.25), None, 21.5, 3), b'{"class":"sample"}\n'
    (block,) = as_items([sample])
    for item in (ERROR, Printed(lines * 2, 5), block, Printed(b"", 0), ERROR):
        sink.write(item)
    sink.flush()
    assert stream.data == written(ERROR) + lines * 2 + written(sample) + written(ERROR)
    sink.write(Printed(lines * BUFFER, 5))
    assert stream.data.endswith(lines * BUFFER)
    assert sink.prints == Wanted(samples=True, estimates=True, corrected=True)
    assert not NdjsonSink(stream, samples=False).prints.samples


@given(st.integers(1, 500))
def test_stream_that_takes_little_at_a_time_gets_everything(at_a_time: int) -> None:
    stream = Stream(at_a_time=at_a_time)
    sink = NdjsonSink(stream, samples=True)
    for record in EVERY_KIND:
        sink.write(record)
    sink.close()
    assert stream.data == written(*EVERY_KIND)


def test_a_full_pipe_that_does_not_block_is_waited_for() -> None:
    """The output waits for a full pipe, even if another process has made the pipe non-blocking."""
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    sink = NdjsonSink(io.FileIO(writer, "wb"), samples=True)
    expected = 3000 * len(written(ERROR))
    data = bytearray()

    def read() -> None:
        while len(data) < expected:
            time.sleep(0.002)
            data.extend(os.read(reader, 1 << 16))

    thread = threading.Thread(target=read, daemon=True)
    try:
        thread.start()
        for _ in range(3000):
            sink.write(ERROR)
        sink.close()
        thread.join(20)
        assert data == written(*[ERROR] * 3000)
    finally:
        os.close(reader)
        sink._stream.close()


@pytest.mark.parametrize("failure", [BrokenPipeError(), ValueError("I/O operation on closed file")])
def test_closed_pipe_is_sink_closed(failure: Exception) -> None:
    sink = NdjsonSink(Stream(failure), samples=True)
    sink.write(STATS)
    with pytest.raises(SinkClosed):
        sink.flush()
    with pytest.raises(SinkClosed):
        sink.close()


def test_full_disk_is_no_closed_pipe() -> None:
    sink = NdjsonSink(Stream(OSError(28, "No space left on device")), samples=True)
    sink.write(STATS)
    with pytest.raises(OSError, match="No space left"):
        sink.flush()


def test_record_that_cannot_be_encoded_is_no_closed_pipe() -> None:
    """An error in encoding must not look as if the process that reads the output had ended."""
    with pytest.raises(UnicodeEncodeError):
        written(Error("silent", "a lone surrogate: \udcff", 1))
