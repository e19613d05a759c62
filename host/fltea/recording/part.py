"""Writes one MCAP file of a recording, which stays readable if the program is killed at any moment."""

import contextlib
import struct
import threading
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    DataEnd,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdCompressor

from fltea._native import McapChunks
from fltea.recording.append_only import AppendOnly
from fltea.recording.schema import record_schema
from fltea.recording.session import HELLO, LINK, SESSION, WIRE, LinkMessage, PartInfo
from fltea.records.events import Ints, Reads
from fltea.records.records import Hello
from fltea.records.version import __version__

CHUNK_BYTES = 1 << 20


class _Packer(threading.local):
    """Compressor for chunks of messages.

    A thread uses one compressor for all its files, since each compressor takes a megabyte.
    """

    def __init__(self) -> None:
        self.packed = ZstdCompressor(level=1, write_checksum=True).compress


_packer = _Packer()


def _bytes_of(*records: McapRecord) -> bytes:
    builder: Any = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())


class PartWriter:
    """Writes one file of a recording: the session's metadata, then messages in compressed chunks.

    `records`: record class of each channel. `reserve_bytes`: free space that the disk must have at the start;
    it is only checked, not reserved.

    Raises:
        OSError: the disk failed. The constructor, `flush` and `finish` raise it; call `abandon` afterwards.
        Meddled: the file was deleted, moved or truncated. `flush` and `finish` raise it. `Meddled` is a kind
        of OSError.
    """

    def __init__(
        self, path: Path, info: PartInfo, records: Mapping[str, type[msgspec.Struct]], reserve_bytes: int = 0
    ) -> None:
        self.path = path
        self._file = AppendOnly(path, reserve_bytes)
        self._chunks = McapChunks("zstd")
        self._notes: list[MetadataIndex] = []
        self._schemas: list[Schema] = []
        self._channels: dict[str, Channel] = {}
        self._file.write(MCAP0_MAGIC + _bytes_of(Header("", f"fltea {__version__}")))
        self._note(SESSION, info.to_metadata())
        if info.hello is not None:
            self.note_hello(info.hello)
        self._describe(info.device, WIRE, None)
        self._describe(info.device, LINK, LinkMessage)
        for name, kind in records.items():
            self._describe(info.device, name, kind)
        try:
            self.flush()
        except OSError:
            self.discard()
            raise

    @property
    def size_bytes(self) -> int:
        """Length of the file so far [bytes], without the chunk of messages that is being filled."""
        return self._file.tell()

    def add(self, topic: str, log_ns: int, publish_ns: int, data: bytes) -> None:
        """Append one message to the channel `topic`."""
        self._chunks.add_message(self._channels[topic].id, 0, log_ns, publish_ns, data)
        self._end_large()

    def add_reads(self, reads: Reads, offset_ns: int, sequence: int) -> None:
        """Append the bytes of serial reads, with one message for each read.

        `offset_ns`: what is added to the times of the reads to give the messages' log times [ns]. `sequence`:
        sequence number of the first message.
        """
        end, host_ns = reads.end, reads.host_ns
        times = host_ns + offset_ns, host_ns + reads.unix_offset_ns
        self._chunks.add_reads(self._channels[WIRE].id, sequence, reads.data, end, *times)
        self._end_large()

    def add_lines(self, topic: str, log_ns: Ints, lines: bytes) -> None:
        """Append one message to the channel `topic` for each line of `lines`."""
        self._chunks.add_lines(self._channels[topic].id, log_ns, lines)
        self._end_large()

    def note_hello(self, hello: Hello) -> None:
        """Write a device's HELLO as metadata of the file."""
        fields = msgspec.structs.asdict(hello)
        self._note(HELLO, {key: str(value) for key, value in fields.items() if value is not None})

    def flush(self) -> None:
        """End the chunk that is being filled, and write everything to the file."""
        self._file.check()
        self._end_chunk()
        self._file.flush()

    def finish(self, *, moved: bool = False) -> None:
        """Write the summary and the indexes at the end, and close the file.

        `moved`: the file may have been moved, so do not check that it is still at its path.
        """
        if not moved:
            self._file.check()
        self._end_chunk()
        self._file.write(_bytes_of(DataEnd(0)))
        begin = at = self._file.tell()
        groups, offsets = self._summary(), list[McapRecord]()
        for kind, data in groups.items():
            offsets.append(SummaryOffset(kind, at, len(data)))
            at += len(data)
        summary = b"".join(groups.values()) + _bytes_of(*offsets)
        footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, begin, at)
        crc = zlib.crc32(footer, zlib.crc32(summary))
        self._file.write(summary + footer + struct.pack("<I", crc) + MCAP0_MAGIC)
        self._file.flush()
        self._file.close()

    def abandon(self) -> None:
        """Close the file after a failure. Everything that was flushed before stays readable."""
        self._file.cut()

    def discard(self) -> None:
        """Close and delete the file. Call this only if the file holds no messages yet."""
        self._file.close()
        with contextlib.suppress(OSError):
            self.path.unlink()

    def _describe(self, device: str, name: str, kind: type[msgspec.Struct] | None) -> None:
        """Write the description of a channel. `kind`: record class of the channel, None for raw bytes."""
        schema, encoding = 0, "application/octet-stream"
        if kind is not None:
            schema, encoding = len(self._schemas) + 1, "json"
            one = Schema(
                schema, record_schema(kind), "jsonschema", f"fltea.{kind.__name__.removesuffix('Message')}"
            )
            self._schemas.append(one)
            self._chunks.add_record(_bytes_of(one))
        channel = Channel(len(self._channels) + 1, f"/{device}/{name}", encoding, {}, schema)
        self._channels[name] = channel
        self._chunks.add_record(_bytes_of(channel))

    def _note(self, name: str, metadata: dict[str, str]) -> None:
        record = _bytes_of(Metadata(name, metadata))
        self._notes.append(MetadataIndex(self._file.tell(), len(record), name))
        self._file.write(record)

    def _end_large(self) -> None:
        if self._chunks.size > CHUNK_BYTES:
            self._end_chunk()

    def _end_chunk(self) -> None:
        self._file.write(self._chunks.end(self._file.tell(), _packer.packed))

    def _summary(self) -> dict[int, bytes]:
        """Return the records of the file's summary, by their opcodes."""
        index, first_ns, last_ns, chunks, counts = self._chunks.summary()
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=counts,
            chunk_count=chunks,
            message_count=sum(counts.values()),
            message_end_time=last_ns,
            message_start_time=first_ns,
            metadata_count=len(self._notes),
            schema_count=len(self._schemas),
        )
        return {
            Opcode.SCHEMA: _bytes_of(*self._schemas),
            Opcode.CHANNEL: _bytes_of(*self._channels.values()),
            Opcode.STATISTICS: _bytes_of(statistics),
            Opcode.CHUNK_INDEX: index,
            Opcode.METADATA_INDEX: _bytes_of(*self._notes),
        }
