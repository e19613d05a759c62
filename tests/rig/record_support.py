"""Recordings as they lie on the disk, and a recorder in the hands of a test."""

from pathlib import Path
from typing import Any

from fltea.recording.session import WIRE, Entry
from fltea.settings.outputs import RecordConfig
from fltea.sinks.record import RecordSink
from fltea.sources.mcap import Part, read_entries, read_info
from mcap.reader import make_reader
from mcap.records import Message


def messages(path: Path) -> list[tuple[str, Message]]:
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return [(channel.topic, message) for _, channel, message in reader.iter_messages()]


def wire_of(path: Path) -> list[Message]:
    return [message for topic, message in messages(path) if topic == "/due/wire"]


def metadata_of(path: Path) -> list[tuple[str, dict[str, str]]]:
    with path.open("rb") as file:
        return [(entry.name, entry.metadata) for entry in make_reader(file).iter_metadata()]


def wire_entries(path: Path) -> list[Entry]:
    """What came over the wire, also of a file that is cut."""
    entries = read_entries(Part(path, read_info(path)))
    return [entry for entry in entries if isinstance(entry, Entry) and entry.topic == WIRE]


def wire_data(path: Path) -> list[bytes]:
    return [entry.data for entry in wire_entries(path)]


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.mcap"))


def sink_in(folder: Path, told: list[tuple[str, str]] | None = None, **settings: Any) -> RecordSink:
    told = [] if told is None else told
    return RecordSink(RecordConfig(folder=str(folder), **settings), "due", lambda *one: told.append(one))


def written(sink: RecordSink, *items: Any) -> None:
    """Write all items, and finish."""
    for item in items:
        sink.write(item)
    sink.close()
