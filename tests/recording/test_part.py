"""An MCAP file that fltea writes has the same messages and the same summary as a file that the MCAP library's
own writer makes of the same messages.
"""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea._native import McapChunks
from fltea.recording.part import PartWriter
from fltea.recording.session import LINK, WIRE, PartInfo
from fltea.records.events import Chunk, Reads
from fltea.records.records import Sample
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import NonSeekingReader, make_reader
from mcap.writer import Writer

INFO = PartInfo("s", 0, "due", "1", 1_000, 0)
TOPICS = {name: f"/due/{name}" for name in (WIRE, LINK, "sample")}

times = st.integers(0, 1 << 62)
message = st.tuples(st.just(LINK), times, times, st.binary(max_size=20))
lines = st.tuples(st.just("sample"), st.lists(st.tuples(times, st.binary(max_size=300)), max_size=6))
reads = st.tuples(
    st.just(WIRE),
    st.integers(0, 2**32 - 1),
    st.lists(
        st.builds(Chunk, st.binary(max_size=40), st.integers(0, 1 << 61), st.integers(0, 1 << 60)), max_size=9
    ),
)
story = st.lists(st.one_of(message, lines, reads, st.none(), st.just(("note",))), max_size=30)


def written(path: Path, story: list[Any]) -> None:
    part = PartWriter(path, INFO, {"sample": Sample})
    for one in story:
        match one:
            case None:
                part.flush()
            case ("note",):
                part._note("n", {"a": "b"})
            case ("sample", rows):
                columns = np.array([log_ns for log_ns, _ in rows], dtype=np.int64)
                part.add_lines("sample", columns, b"".join(_line(data) + b"\n" for _, data in rows))
            case ("wire", sequence, chunks) if chunks:
                part.add_reads(Reads.of(*chunks), INFO.offset_ns, sequence)
            case ("link", log_ns, publish_ns, data):
                part.add(LINK, log_ns, publish_ns, data)
    part.finish()


def _line(data: bytes) -> bytes:
    return data.replace(b"\n", b" ")


def by_the_library(story: list[Any]) -> io.BytesIO:
    file = io.BytesIO()
    writer = Writer(file)
    writer.start()
    writer.add_metadata("fltea.session", INFO.to_metadata())
    channels = {
        name: writer.register_channel(
            topic, "json", name != WIRE and writer.register_schema(name, "jsonschema", b"{}")
        )
        for name, topic in TOPICS.items()
    }
    for one in story:
        match one:
            case None:
                writer.flush()
            case ("note",):
                writer.add_metadata("n", {"a": "b"})
            case ("sample", rows):
                for log_ns, data in rows:
                    writer.add_message(channels["sample"], log_ns, _line(data), log_ns)
            case ("wire", sequence, chunks):
                for k, (data, host_ns, offset_ns) in enumerate(chunks):
                    log_ns, publish_ns = host_ns + INFO.offset_ns, host_ns + offset_ns
                    writer.add_message(channels[WIRE], log_ns, data, publish_ns, (sequence + k) % 2**32)
            case ("link", log_ns, publish_ns, data):
                writer.add_message(channels[LINK], log_ns, data, publish_ns)
    writer.finish()
    return file


def told(file: Any) -> list[Any]:
    """Return all messages and metadata of a file, and what its summary states about them."""
    file.seek(0)
    reader = make_reader(file, validate_crcs=True)
    found: list[Any] = [
        (channel.topic, message.sequence, message.log_time, message.publish_time, message.data)
        for _, channel, message in reader.iter_messages(log_time_order=False)
    ]
    found += [(one.name, one.metadata) for one in reader.iter_metadata()]
    summary = reader.get_summary()
    topics = {number: channel.topic for number, channel in summary.channels.items()}
    counts = {topics[number]: n for number, n in summary.statistics.channel_message_counts.items()}
    found.append(summary.statistics)
    summary.statistics.channel_message_counts = counts
    for one in summary.chunk_indexes:
        of_channels = sorted(topics[number] for number in one.message_index_offsets)
        found.append((one.message_start_time, one.message_end_time, of_channels, one.message_index_length))
    return found


@given(story)
@settings(deadline=None, max_examples=60)
def test_a_file_says_what_the_librarys_writer_says(
    tmp_path_factory: pytest.TempPathFactory, story: list
) -> None:
    path = tmp_path_factory.mktemp("part") / "a.mcap"
    written(path, story)
    expected = told(by_the_library(story))
    with path.open("rb") as file:
        assert told(file) == expected
        file.seek(0)
        in_order = [message for _, _, message in NonSeekingReader(file).iter_messages(log_time_order=True)]
        file.seek(0)
        by_index = [message for _, _, message in make_reader(file).iter_messages()]
        assert sorted(by_index, key=repr) == sorted(in_order, key=repr)


@given(
    st.lists(st.builds(Chunk, st.binary(max_size=9), *[st.integers(0, 99)] * 2), min_size=1, max_size=12),
    st.data(),
)
@settings(deadline=None, max_examples=60)
def test_reads_are_the_same_messages_however_they_are_cut(chunks: list[Chunk], data: st.DataObject) -> None:
    cuts = sorted(data.draw(st.sets(st.integers(1, max(1, len(chunks) - 1)))))
    at_once, apart = McapChunks(""), McapChunks("")
    for writer, ends in ((at_once, [len(chunks)]), (apart, [*cuts, len(chunks)])):
        begin = 0
        for end in ends:
            if chunks[begin:end]:
                some = Reads.of(*chunks[begin:end])
                writer.add_reads(1, begin, some.data, some.end, some.host_ns, some.unix_offset_ns)
            begin = max(begin, end)
    assert at_once.end(0, bytes) == apart.end(0, bytes)


def test_what_does_not_fit_together_is_refused() -> None:
    chunks = McapChunks("")
    column = np.arange(3, dtype=np.int64)
    for lines in (b"a\nb\n", b"a\nb\nc", b"a\nb\nc\nd\n"):
        with pytest.raises(ValueError, match="lines than times"):
            chunks.add_lines(1, column, lines)
    with pytest.raises(ValueError, match="must not decrease"):
        chunks.add_reads(1, 0, b"abc", column[::-1], column, column)
    with pytest.raises(ValueError, match="must not decrease"):
        chunks.add_reads(1, 0, b"a", column, column, column)
    with pytest.raises(ValueError, match="one time for each read"):
        chunks.add_reads(1, 0, b"abc", column, column[:2], column)
