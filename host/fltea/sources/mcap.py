"""Replays a recording in MCAP files. The recorded bytes are decoded in the same way as live bytes.

Files are read one chunk at a time, so that large or many files need no more memory.
"""

import re
from collections.abc import Iterator, Sequence
from itertools import chain, pairwise
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from fltea.recording.changes import Changes
from fltea.recording.part_reader import Batch, Part, Torn, entries_of, read_batches, read_info
from fltea.recording.scan import BEGIN, CHANNEL, END, LOG_TIME, PUBLISH_TIME, SEQUENCE, Damage, Messages
from fltea.recording.session import (
    LINK,
    OVERFLOW,
    WIRE,
    WIRE_WRAP,
    Entry,
    LinkMessage,
    PartInfo,
)
from fltea.records.errors import UsageError
from fltea.records.events import Event, Failed, Ints, Opened, RawBlock, Reads, Trouble
from fltea.records.records import Hello
from fltea.records.stats import LinkStats
from fltea.settings.limits import DEFAULT_LIMITS, Limits
from fltea.sources.wire_events import Hints, WireEvents
from fltea.wire.sensors import NO_SENSOR

SUFFIX = ".mcap"

HINTS = Hints(
    "The device was silent then, or the program that recorded it stood still.",
    "The baud rate was wrong, or the device did not run the firmware of fltea.",
    "holds nothing for",
)

PART_OF_NAME = re.compile(r"(.+)_\d{3,}(\.recovered)?\.mcap")

_link = msgspec.json.Decoder(LinkMessage)


class Session(NamedTuple):
    """The readable files of one recording session, in their order.

    `unread`: for each other file of the session, the reason why it is not read.
    """

    parts: list[Part]
    unread: dict[Path, str]

    @property
    def name(self) -> Path:
        """Path of the session's first file, without the file's number."""
        return name_of(self.parts[0].path)


def find_session(paths: Sequence[Path]) -> Session:
    """Return the only recording session at these paths.

    Raises:
        UsageError: nothing is at the paths, the files are no recording, or they belong to several sessions.
    """
    sessions, stray = find_sessions(paths)
    if len(sessions) > 1:
        lines = "\n".join(sorted(map(_session_line, sessions)))
        raise UsageError(f"{paths[0]}: holds {len(sessions)} recordings; name one of them:\n{lines}")
    return sessions[0]._replace(unread=sessions[0].unread | stray)


def find_sessions(paths: Sequence[Path]) -> tuple[list[Session], dict[Path, str]]:
    """Return all recording sessions at these paths, and the unreadable files that belong to none of them.

    `paths`: paths of files. A folder stands for all its files. The name of a session, such as
    `due_20270801T120000Z_1f0c2b3a` without the number of a file, stands for all files of that session. If a
    file has a recovered copy, the copy is used.

    Raises:
        UsageError: nothing is at the paths, or the files are no recording.
    """
    found: dict[tuple[str, str], dict[int, Part]] = {}
    unread: dict[Path, str] = {}
    unused: dict[tuple[str, str], dict[Path, str]] = {}
    files = [file for path in paths for file in _files(path)]
    for file in files:
        try:
            part = Part(file, read_info(file))
        except UsageError as error:
            if len(files) == 1:
                raise
            unread[file] = str(error)
            continue
        key = part.info.device, part.info.session
        parts = found.setdefault(key, {})
        used, other = parts.get(part.info.part, part), part
        if _original(file) == used.path != file:
            used, other = part, used
        parts[part.info.part] = used
        if other.path not in (used.path, _original(used.path)):
            why = f"{other.path}: holds the same part of the recording as {used.path}, which is used."
            unused.setdefault(key, {})[other.path] = why
    if not found:
        raise UsageError(f"{paths[0]}: no recording of fltea in it ({len(unread)} files cannot be read).")
    sessions = [
        Session([parts[number] for number in sorted(parts)], unused.get(key, {}))
        for key, parts in found.items()
    ]
    for session in sessions:
        copied = {_original(part.path) for part in session.parts}
        for file in [file for file in unread if name_of(file) == session.name]:
            why = unread.pop(file)
            if file not in copied:
                session.unread[file] = why
        session.unread.update(_missing(session))
    return sessions, unread


def _missing(session: Session) -> Iterator[tuple[Path, str]]:
    """Yield the files that are missing between the files of a session, each with a text that says so.

    `McapRecording.missing_before` tells of missing first files. Missing last files cannot be noticed.
    """
    unread = {path.name for path in session.unread}
    for before, after in pairwise(part.info.part for part in session.parts):
        names = (f"{session.name.name}_{number:03}{SUFFIX}" for number in range(before + 1, after))
        if (name := next((name for name in names if name not in unread), None)) is not None:
            path = session.name.with_name(name)
            yield path, f"{path}: is missing, though there are parts before and after it."


def _original(path: Path) -> Path:
    """Return the path of the file of which `path` is a recovered copy; `path` itself if it is no copy."""
    return path.with_name(path.name.replace(".recovered.", "."))


def _files(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    files = sorted(path.glob(f"*{SUFFIX}")) if path.is_dir() else sorted(_of_session(path))
    if not files:
        what = f"no {SUFFIX} file in this folder" if path.is_dir() else "there is no such file or recording"
        raise UsageError(f"{path}: {what}.")
    return files


def _of_session(path: Path) -> list[Path]:
    if not path.parent.is_dir():
        return []
    names = ((file, PART_OF_NAME.fullmatch(file.name)) for file in path.parent.iterdir())
    return [file for file, match in names if match and match[1] == path.name]


def _session_line(session: Session) -> str:
    count = f"{len(session.parts)} file{'s' if len(session.parts) > 1 else ''}"
    return f"  {session.name}  (device {session.parts[0].info.device}, {count})"


def name_of(path: Path) -> Path:
    """Return the name of the session to which a file belongs: the file's path without its number."""
    match = PART_OF_NAME.fullmatch(path.name)
    return path.with_name(match[1]) if match else path


class Losses:
    """Counts of what a recording does not hold, by the events that were yielded so far.

    `breaks`: number of gaps in which something was not recorded. `torn`: number of files that end without an
    index, since their writing was interrupted. `open`: number of files to which a program still writes.
    `unrecorded_items`, `unrecorded_bytes`: items and bytes that the recorder counted as lost.
    `damaged_bytes`: total size of the unreadable places in files.
    """

    def __init__(self) -> None:
        self.breaks = self.torn = self.open = 0
        self.unrecorded_items = self.unrecorded_bytes = self.damaged_bytes = 0


class Continuity:
    """Knows whether the next message follows the last one without a gap.

    `opened`: whether the connection is open; if not, an `Opened` event has to come before the next message.
    `hello`: HELLO to yield before the next message, or None. `missing`: the reason if data are missing before
    the next message, else None. `next_sequence`: number of the next message from the wire; None if any number
    may follow.
    """

    def __init__(self, info: PartInfo) -> None:
        self.opened = info.part == 0
        self.hello = info.hello
        self.missing: str | None = None
        self.next_sequence: int | None = None

    def end(self, why: str, hello: Hello | None) -> None:
        """Note that data are missing before the next message, for the reason `why`.

        `hello`: HELLO of the device after the gap, if known.
        """
        self.missing, self.hello, self.next_sequence, self.opened = why, hello, None, False


class McapRecording:
    """Yields the events of a recording, or its messages. They can be iterated only once.

    `name`: name of the source in each HELLO. `unread`: reasons why files cannot be read, or not completely.
    `changes`: counts of bias steps and motions, of the events that were yielded so far.
    """

    live = prompt = False
    has_clock = True

    def __init__(self, session: Session, name: str, limits: Limits = DEFAULT_LIMITS) -> None:
        self.parts = parts = session.parts
        self.unread = list(session.unread.values())
        self._limits = limits
        self.losses = Losses()
        self.changes = Changes()
        self._name = name
        self._wire = WireEvents(name, HINTS)
        self._wire.unix_offset_ns = parts[0].info.offset_ns
        self._now_ns = 0
        self._continuity = Continuity(parts[0].info)
        self._no_sensor = False

    @property
    def unix_offset_ns(self) -> int:
        """Offset from the recorder's monotonic clock to Unix time at the last event [ns]."""
        return self._wire.unix_offset_ns

    @property
    def missing_before(self) -> str:
        """Text that says which files are missing before the first file that is read; empty if none."""
        name, number = name_of(self.parts[0].path), self.parts[0].info.part
        beside = {path.name.removesuffix(SUFFIX).removesuffix(".recovered") for path in _of_session(name)}
        missing = [k for k in range(number) if f"{name.name}_{k:03}" not in beside]
        if not missing:
            return ""
        first, last = missing[0], missing[-1]
        return (
            f"part {first:03} is missing" if first == last else f"parts {first:03} to {last:03} are missing"
        )

    def link_stats(self) -> LinkStats:
        """Return counts of the bytes and frames that reached the recorder, and of those lost before it."""
        return self._wire.link_stats()

    def events(self) -> Iterator[Event]:
        """Yield the device's events. Recorded troubles are not `fatal` here, so they do not end a replay."""
        number = self.parts[0].info.part
        for part in self.parts:
            if part.info.part != number:
                self._continuity.end(f"files are missing before {part.path.name}", part.info.hello)
            number = part.info.part + 1
            for item in self._items_of(part):
                match item:
                    case Batch():
                        self.changes.count_in(item.messages, item.topics)
                        yield from self._on_batch(item, part.info)
                    case Damage(size=0):
                        text = f"{part.path} {item.said}."
                        yield Trouble("cut_recording", text, self._now_ns, fatal=False)
                    case Damage():
                        self.losses.damaged_bytes += item.size
                        self._continuity.end(f"{part.path.name} {item.said}", None)
                    case Torn():
                        self.losses.torn += not item.is_open
                        self.losses.open += item.is_open
                        yield Trouble(
                            "recording_open" if item.is_open else "cut_recording",
                            item.text,
                            self._now_ns,
                            fatal=False,
                        )
        for why in self.unread:
            yield Trouble("unread_file", why, self._now_ns, fatal=False)

    def entries(self) -> Iterator[tuple[Part, Entry]]:
        """Yield the recorded messages one by one, each with its file. Damaged messages are left out."""
        for part in self.parts:
            for entry in entries_of(self._items_of(part)):
                yield part, entry

    def _items_of(self, part: Part) -> Iterator[Batch | Damage | Torn]:
        """Yield the contents of a file, and note its first damage in `unread`."""
        is_damaged = False
        for item in read_batches(part, self._limits):
            if isinstance(item, Damage) and item.size and not is_damaged:
                is_damaged = True
                what = f"{part.path}: {item.said}; what stands before and after that is read."
                self.unread.append(what)
            yield item

    def _on_batch(self, batch: Batch, info: PartInfo) -> Iterator[Event]:
        """Yield the events of a batch of messages.

        A message from the wire holds the bytes of one read from the port. Successive messages of this kind
        are decoded in one call.
        """
        of_wire = [channel for channel, topic in batch.topics.items() if topic == WIRE]
        of_link = [channel for channel, topic in batch.topics.items() if topic == LINK]
        messages = batch.messages.of_channels([*of_wire, *of_link])
        table = messages.table
        if not len(table):
            return
        host_ns = table[:, LOG_TIME] - info.offset_ns
        is_wire = np.isin(table[:, CHANNEL], of_wire)
        breaks = ~(is_wire[1:] & is_wire[:-1]) | (np.diff(host_ns) < 0)
        breaks |= np.diff(table[:, SEQUENCE]) % WIRE_WRAP != 1
        begins = [0, *(np.flatnonzero(breaks) + 1).tolist()]
        for begin, end in zip(begins, [*begins[1:], len(table)], strict=True):
            group = Messages(messages.data, table[begin:end])
            if is_wire[begin]:
                yield from self._on_wire(group, host_ns[begin:end])
                continue
            for _, _, log_ns, publish_ns, data in group.each():
                yield from self._on_link(
                    data, log_ns - info.offset_ns, publish_ns - log_ns + info.offset_ns, info
                )

    def _on_wire(self, group: Messages, host_ns: Ints) -> Iterator[Event]:
        table = group.table
        if self._continuity.next_sequence not in (None, table[0, SEQUENCE]):
            self._continuity.end("chunks from the wire are missing", None)
        self._continuity.next_sequence = (int(table[-1, SEQUENCE]) + 1) % WIRE_WRAP
        begin, end = table[:, BEGIN], table[:, END]
        spans = zip(begin.tolist(), end.tolist(), strict=True)
        data = b"".join([group.data[first:last] for first, last in spans])
        yield from self._feed(Reads(data, np.cumsum(end - begin), host_ns, table[:, PUBLISH_TIME] - host_ns))

    def _on_link(self, data: bytes, host_ns: int, offset_ns: int, info: PartInfo) -> Iterator[Event]:
        try:
            link = _link.decode(data)
        # msgspec raises ValueError, and RecursionError for deeply nested brackets
        except (ValueError, RecursionError):
            self._continuity.end("a message about the connection is damaged", None)
            return
        if link.event == "gap":
            self.losses.unrecorded_items += link.items
            self.losses.unrecorded_bytes += link.bytes
            why = f"{link.items} items, {link.bytes} bytes of the wire were not recorded ({link.kind})"
            self._continuity.end(why, None if link.kind == OVERFLOW else info.hello)
        elif link.event == "opened":
            yield from self._feed(Opened(host_ns, offset_ns))
        else:
            yield from self._feed(Failed(link.kind, link.message, host_ns, offset_ns))

    def _feed(self, item: Reads | Opened | Failed) -> Iterator[Event]:
        """Yield the events of an item.

        If there was a gap or a new connection before the item, events about these come first.
        """
        host_ns, offset_ns = item[-2:] if not isinstance(item, Reads) else next(item.chunks())[1:]
        continuity = self._continuity
        if continuity.missing is not None:
            self.losses.breaks += 1
            # nobody knows whether the port was silent during the gap, so no silence is reported
            self._wire.forgive(host_ns)
            failed = Failed("recording_gap", f"{self._name}: {continuity.missing}.", host_ns, offset_ns)
            yield from self._interpret(failed, host_ns)
            continuity.missing = None
        if not continuity.opened and not isinstance(item, Opened):
            yield from self._interpret(Opened(host_ns, offset_ns), host_ns)
        continuity.opened = True
        if continuity.hello is not None:
            yield self._renamed(msgspec.structs.replace(continuity.hello, host_ns=host_ns))
            continuity.hello = None
        yield from self._interpret(item, host_ns)

    def _interpret(self, item: Reads | Opened | Failed, host_ns: int) -> Iterator[Event]:
        self._now_ns = host_ns
        for event in chain(self._wire.pass_time(host_ns), self._wire.feed(item, host_ns)):
            yield self._as_replayed(event)

    def _as_replayed(self, event: Event) -> Event:
        match event:
            case Trouble():
                return event._replace(fatal=False)
            case Hello():
                return self._renamed(event)
            # the device was simulated, so the temperature in its frames has no meaning
            case RawBlock() if self._no_sensor:
                return event._replace(temperature=None)
        return event

    def _renamed(self, hello: Hello) -> Hello:
        self._no_sensor = hello.who_am_i == NO_SENSOR
        return msgspec.structs.replace(hello, source=self._name)
