"""Makes a complete MCAP file, with summary and indexes, from a truncated or damaged file."""

from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.records import Channel, Metadata, Schema
from mcap.writer import CompressionType, Writer

from fltea.recording.in_use import is_in_use
from fltea.recording.scan import LOG_TIME, ChunkEnd, Damage, Messages, Scan
from fltea.records.errors import UsageError
from fltea.records.small_file import open_file
from fltea.records.version import __version__
from fltea.records.whole_file import whole_file
from fltea.settings.limits import DEFAULT_LIMITS, Limits


class Recovered(NamedTuple):
    """Result of a recovery. `out`: path of the recovered file, None if no recovery was needed."""

    out: Path | None
    messages: int
    seconds: float
    lost_bytes: int
    damaged_chunks: int


def recover(path: Path, *, in_place: bool, limits: Limits = DEFAULT_LIMITS) -> Recovered:
    """Write the readable part of a damaged file to `NAME.recovered.mcap`, or in place of the file.

    Raises:
        UsageError: the file does not exist, is no MCAP file or is still being written, the copy already
            exists, or recovery needs more memory than the limits allow.
        FlteaError: the copy cannot be written.
    """
    out = path if in_place else path.with_name(f"{path.stem}.recovered.mcap")
    try:
        with open_file(path) as file:
            _check_unused(path, file)
            found = _examine(path, limits)
            if found.out is None:
                return found
            if not found.messages:
                raise UsageError(f"{path}: nothing in this file can be recovered.")
            if not in_place and out.exists():
                raise UsageError(
                    f"{out}: exists already. If {path.name} is to be recovered again, remove it first."
                )
            _copy(path, out, limits)
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}: cannot be read ({error}).") from error
    return found._replace(out=out)


def _check_unused(path: Path, file: BinaryIO) -> None:
    if is_in_use(file):
        raise UsageError(f"{path}: a running program still writes this file; stop that program first.")


def _examine(path: Path, limits: Limits) -> Recovered:
    """Count what can be recovered from a file.

    Messages whose channel's description was in a damaged chunk are recovered if the file's summary, at its
    end, has the description too.
    """
    scan = Scan(path, limits)
    known: set[int] = set()
    messages = damaged = 0
    first_ns = last_ns = None
    for item in scan:
        if isinstance(item, Channel):
            known.add(item.id)
        elif isinstance(item, Messages) and len(found := item.of_channels(known).table):
            messages += len(found)
            times = found[:, LOG_TIME]
            first_ns = int(times.min()) if first_ns is None else min(first_ns, int(times.min()))
            last_ns = int(times.max()) if last_ns is None else max(last_ns, int(times.max()))
        damaged += isinstance(item, Damage)
    seconds = 0.0 if first_ns is None or last_ns is None else (last_ns - first_ns) * 1e-9
    needed = damaged or not scan.whole
    return Recovered(path if needed else None, messages, seconds, scan.lost_bytes, damaged)


def _copy(path: Path, out: Path, limits: Limits) -> None:
    with whole_file(out) as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(library=f"fltea {__version__}")
        schemas: dict[int, int] = {0: 0}
        channels: dict[int, int] = {}
        for item in Scan(path, limits):
            match item:
                case Metadata():
                    writer.add_metadata(item.name, item.metadata)
                case Schema() if item.id not in schemas:
                    schemas[item.id] = writer.register_schema(item.name, item.encoding, item.data)
                case Channel() if item.id not in channels:
                    schema = schemas.get(item.schema_id, 0)
                    channels[item.id] = writer.register_channel(
                        item.topic, item.message_encoding, schema, item.metadata
                    )
                case Messages():
                    for channel, number, log_ns, publish_ns, data in item.of_channels(channels).each():
                        writer.add_message(channels[channel], log_ns, data, publish_ns, number)
                case ChunkEnd():
                    writer.flush()  # type: ignore[no-untyped-call]
        writer.finish()  # type: ignore[no-untyped-call]
