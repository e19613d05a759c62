"""Find which items are lost when another program deletes, moves or truncates an unfinished file."""

import contextlib
from pathlib import Path
from typing import NamedTuple

import msgspec

from fltea.recording.append_only import Meddled
from fltea.recording.scan import BEGIN, END, Messages, Scan
from fltea.recording.session import LINK_CHANNEL, WIRE_CHANNEL, LinkMessage
from fltea.records.errors import UsageError
from fltea.sinks.record_session import NOTHING, OpenPart, longer, summed

DELETED = "record_deleted"
"""Kind of the `error` record that says that another program has deleted the file. After such a loss, the next
file begins at once.
"""


class Outage:
    """What is not recorded at the moment, and why.

    `gap`: counts of the items that were not recorded; None while a file is written. `trouble`: text
    that says why no file is written; None while one is written. `retry_ns`: time by the host's clock before
    which no new file is tried [ns].
    """

    def __init__(self) -> None:
        self.gap: LinkMessage | None = None
        self.trouble: str | None = None
        self.retry_ns = 0

    @property
    def is_of_disk(self) -> bool:
        """Whether the disk is full or failed, and not only a file was deleted."""
        return self.gap is not None and self.gap.kind != DELETED

    def count(self, items: int, size_bytes: int, chunks: int) -> None:
        """Count items that were not recorded."""
        if self.gap is not None:
            self.gap = longer(self.gap, items, size_bytes, chunks)

    def add(self, kind: str, lost: LinkMessage) -> None:
        """Add the counts `lost` to the gap, or begin a gap. `kind`: kind of the `error` record about it."""
        self.gap = msgspec.structs.replace(summed(lost, self.gap or NOTHING), kind=kind)


class Held(NamedTuple):
    """Counts of what a file contains, or of what it has lost.

    `items`: counts of recorded items. `gaps`: counts of items that were not recorded, as messages in the file
    report them.
    """

    items: LinkMessage
    gaps: LinkMessage


def lost_of(part: OpenPart, error: Meddled) -> Held:
    """Return counts of what a file has lost.

    A deleted file has lost all of its content. A truncated file has lost what stood after its new end. A
    moved file has lost nothing.
    """
    written = summed(part.flushed, part.unflushed)
    if error.what == "moved":
        return Held(NOTHING, NOTHING)
    if error.what == "deleted":
        return Held(written, part.gaps)
    left = _held_by(part.writer.path)
    return Held(_less(written, left.items), _less(part.gaps, left.gaps))


def told(path: Path, error: Meddled, lost: LinkMessage) -> tuple[str, str]:
    """Return kind and text of the `error` record that says what another program did to the file at `path`."""
    if error.what == "moved":
        to = f" to {error.where}" if error.where else ""
        return "record_moved", (
            f"{path} was moved away{to} while it was written. It is finished there; the recording goes on in "
            "a new file."
        )
    return "record_deleted", (
        f"{path} was {error.what} by another program while it was written: {lost.items} items of it, with "
        f"{lost.bytes} bytes of the wire, are lost. The recording goes on in a new file. Does a "
        "program delete old files to make room?"
    )


def _held_by(path: Path) -> Held:
    """Return counts of items, bytes and gaps that can still be read from a file."""
    items = gaps = NOTHING
    # the content after an unreadable position counts as lost
    with contextlib.suppress(OSError, ValueError, UsageError):
        for found in Scan(path):
            if not isinstance(found, Messages):
                continue
            wire = found.of_channels([WIRE_CHANNEL]).table
            size_bytes = int((wire[:, END] - wire[:, BEGIN]).sum())
            items = longer(items, len(found.table), size_bytes, len(wire))
            for message in found.of_channels([LINK_CHANNEL]).each():
                link = msgspec.json.decode(message.data, type=LinkMessage)
                if link.event == "gap":
                    gaps = summed(gaps, link)
                    items = longer(items, -1)
    return Held(items, gaps)


def _less(gap: LinkMessage, other: LinkMessage) -> LinkMessage:
    return longer(gap, -other.items, -other.bytes, -other.chunks)
