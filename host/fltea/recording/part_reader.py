"""Reads one file of a recording: its metadata, its messages, and descriptions of damage."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mcap.records import Channel, Metadata

from fltea.recording.scan import Damage, Messages, Scan
from fltea.recording.session import (
    LINK,
    LINK_CHANNEL,
    SESSION,
    WIRE,
    WIRE_CHANNEL,
    Entry,
    PartInfo,
    from_metadata,
)
from fltea.records.errors import UsageError
from fltea.settings.limits import DEFAULT_LIMITS, Limits

OWN_CHANNELS = {WIRE_CHANNEL: WIRE, LINK_CHANNEL: LINK}


class Part(NamedTuple):
    """One file of a recording, with the metadata of the session that wrote it."""

    path: Path
    info: PartInfo


class Torn(NamedTuple):
    """States that a file ends without an index, so it was not finished. `text`: warning for people.

    `is_open`: a program is still writing the file.
    """

    text: str
    is_open: bool


def read_info(path: Path) -> PartInfo:
    """Return the metadata of the recording session to which a file belongs.

    Raises:
        UsageError: the file cannot be read, or is no recording of fltea.
    """
    try:
        for item in Scan(path):
            if isinstance(item, Metadata) and item.name == SESSION:
                return from_metadata(item.metadata)
            if isinstance(item, Messages) and len(item.table):
                break
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}: cannot be read as a recording ({error}).") from error
    raise UsageError(f"{path}: is no recording of fltea, or was cut before anything was written.")


class Batch(NamedTuple):
    """Successive messages of a file. `topics`: topic of each channel, without the device's name."""

    messages: Messages
    topics: dict[int, str]


def read_batches(part: Part, limits: Limits = DEFAULT_LIMITS) -> Iterator[Batch | Damage | Torn]:
    """Yield all messages of a file, and its damage. If the file was not finished, the last item is a `Torn`.

    Raises:
        UsageError: the file is no longer readable, or needs more memory than the limits allow.
    """
    topics = dict(OWN_CHANNELS)
    prefix = f"/{part.info.device}/"
    scan = Scan(part.path, limits, asks_for_writer=True)
    try:
        for item in scan:
            match item:
                case Channel():
                    topics[item.id] = item.topic.removeprefix(prefix)
                case Messages():
                    yield Batch(item, topics)
                case Damage():
                    yield item
    except (OSError, ValueError) as error:
        raise UsageError(f"{part.path}: cannot be read ({error}).") from error
    if not scan.whole:
        yield _torn(scan)


def _torn(scan: Scan) -> Torn:
    if scan.has_writer:
        return Torn(f"{scan.path}: a program still writes it; what has reached the disk is read.", True)
    why = f": {scan.why}" if scan.lost_bytes and scan.why else ""
    text = (
        f"{scan.path}: has no index, because the program that wrote it was killed, or the file was cut "
        f"off; what reached the disk is read ({scan.lost_bytes} bytes at its end are not{why})."
    )
    return Torn(text, False)


def read_entries(part: Part, limits: Limits = DEFAULT_LIMITS) -> Iterator[Entry]:
    """Yield the messages of a file one by one. Damaged messages and a truncated end are left out."""
    return entries_of(read_batches(part, limits))


def entries_of(items: Iterator[Batch | Damage | Torn]) -> Iterator[Entry]:
    """Yield the messages of the batches in `items` one by one, and skip other items."""
    for batch in items:
        if not isinstance(batch, Batch):
            continue
        for channel, sequence, log_ns, publish_ns, data in batch.messages.each():
            yield Entry(batch.topics.get(channel, ""), log_ns, publish_ns, sequence, data)
