"""Reads the topic of a gyroscope from bags of ROS 1 and 2 and from other MCAP files, without ROS."""

from collections.abc import Iterator
from pathlib import Path

from msgspec.structs import replace

from fltea.recording.bag_files import MCAP, ROS1, SQLITE, files_of
from fltea.recording.bag_gather import Gathered
from fltea.recording.bag_messages import Batch, Topic
from fltea.recording.bag_names import Layout
from fltea.recording.bag_ros1 import read_ros1
from fltea.recording.bag_ros2 import read_mcap, read_sqlite, unpacked_file
from fltea.recording.files import MOST_NAMES, Note, Stored, listed
from fltea.recording.quota import Quota, TooManyFields
from fltea.recording.raw_lines import shown
from fltea.recording.reading import Answer, Evidence, Missing, not_stated
from fltea.records.errors import UsageError
from fltea.records.visible import visible
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import DEFAULT_LIMITS, Limits

MOST_NOTES = 5
"""At most this number of notes on damage are reported one by one. Further notes are only counted."""


def open_bag(path: Path, how: How = AS_IT_SAYS, limits: Limits = DEFAULT_LIMITS) -> Stored:
    """Read the Imu topic of a bag, or the topic that `how` names, in one pass.

    The samples go through a temporary file.

    The units and the rate in `how` have priority over what ROS prescribes by convention. They must not
    contradict what the bag states.

    `path`: a .bag, .db3 or .mcap file, or the folder of a bag of ROS 2.

    Raises:
        NotStated: the bag has several Imu topics (the message lists them), or the unit or the rate is
        unknown.
        UsageError: there is no such bag, Imu topic or angular velocity, an option in `how` is impossible, or
            the bag exceeds the limits.
    """
    topics = _Topics(path, how, _quota(path, limits))
    for item in _batches(path, limits):
        topics.take(item)
    chosen, gathered = topics.chosen, topics.gathered
    likely = _alike(topics.layouts)
    if chosen is None or gathered is None:
        # in a bag with only one topic of a gyroscope, --topic may name a sensor instead of a topic
        if how.topic is not None and len(likely) == 1:
            return open_bag(path, replace(how, topic=f"{next(iter(likely))}:{how.topic}"), limits)
        raise topics.none(how.topic)
    if how.topic is None and len(likely) > 1:
        what = f"which of its {len(likely)} Imu topics is meant"
        several = {topic: count for topic, count in topics.counts.items() if topic.name in likely}
        raise not_stated(str(path), [Missing(what, "--topic ?")], table=_listed(several))
    sensor = _named(chosen, how)[1]
    if sensor is not None and (has := gathered.lacks()):
        raise topics.none(sensor, f", nor of a sensor that is called so: {has}")
    stored = gathered.stored(sorted(likely - {chosen.name}), _few(topics.notes))
    reading = (_answer(chosen, sensor, how), *stored.reading)
    return stored._replace(about=_about(chosen, topics.counts), topic=chosen.name, reading=reading)


class _Topics:
    """The topics of a bag: number and fields of each topic's messages, and samples of the chosen topic."""

    def __init__(self, path: Path, how: How, quota: Quota) -> None:
        self._path, self._how, self._quota = path, how, quota
        self.counts: dict[Topic, int] = {}
        self.layouts: dict[Topic, Layout | None] = {}
        self.notes: list[Note] = []
        self.chosen: Topic | None = None
        self.gathered: Gathered | None = None

    def take(self, item: Batch | Note) -> None:
        """Count a batch of messages.

        If the batch is of the chosen topic, also collect the samples in its messages.
        """
        if isinstance(item, Note):
            self.notes.append(item)
            return
        topic = item.topic
        is_named, sensor = _named(topic, self._how)
        self.counts[topic] = self.counts.get(topic, 0) + item.count
        if item.data and topic not in self.layouts:
            self.layouts[topic] = self._layout(item, sensor)
        layout = self.layouts.get(topic)
        if layout is None or not item.count or not is_named:
            return
        known = None if self.chosen is None else self.layouts[self.chosen]
        if known is None or (layout.is_known and not known.is_known):
            self.chosen = topic
            self.gathered = Gathered(self._path, topic, layout, sensor, self._how, self._quota)
        if self.gathered is not None and self.chosen is not None and topic.name == self.chosen.name:
            self.gathered.add(item, layout)

    def _layout(self, batch: Batch, sensor: str | None) -> Layout | None:
        topic = batch.topic
        try:
            return topic.layout(batch.data, sensor, self._quota)
        except TooManyFields as error:
            text = f"{self._path}: topic {visible(topic.name)}: {error}."
            self.notes.append(Note("bag_messages", text))
            return None
        except UsageError as error:
            raise UsageError(f"{self._path}: topic {visible(topic.name)}: {error}") from error

    def none(self, name: str | None, has: str = "") -> UsageError:
        """Return the error for a bag without a topic of a gyroscope that is called `name`."""
        return _none(self._path, self.counts, self.layouts, name, self.notes, has)


def _answer(chosen: Topic, sensor: str | None, how: How) -> Answer:
    """Return the answer that says which topic, or which sensor of a topic, is read, and what decided this."""
    name = visible(chosen.name) + ("" if sensor is None else f", {visible(sensor)}")
    by: tuple[Evidence, str] = (
        ("stated", "no other topic has a gyroscope")
        if how.topic is None
        else ("given", "--topic" if sensor is None else "--sensor")
    )
    return Answer("sensor", f"topic {name}", *by)


def _quota(path: Path, limits: Limits) -> Quota:
    """Return the quota (the limits of time and memory) for decoding the messages in all files of a bag."""
    try:
        files = files_of(path) if path.is_dir() else [path]
        return Quota(path, limits, sum(file.stat().st_size for file in files))
    except OSError:  # the bag is opened later, and this error is reported then
        return Quota(path, limits, 0)


def _named(topic: Topic, how: How) -> tuple[bool, str | None]:
    """Return whether the user names this topic, as TOPIC or TOPIC:SENSOR, and the sensor after the colon."""
    name, given = topic.name.lstrip("/"), how.topic
    if given is None or given.lstrip("/") == name:
        return True, None
    begin, sensor = given.lstrip("/")[: len(name) + 1], given.lstrip("/")[len(name) + 1 :]
    return (True, sensor) if begin == f"{name}:" else (False, None)


def _alike(layouts: dict[Topic, Layout | None]) -> set[str]:
    """Return the names of the topics whose message type is made for gyroscopes.

    If there are no such topics, return the names of all topics with angular rates.
    """
    there = {topic: layout for topic, layout in layouts.items() if layout is not None}
    some_known = any(layout.is_known for layout in there.values())
    return {topic.name for topic, layout in there.items() if layout.is_known or not some_known}


def _none(
    path: Path,
    topics: dict[Topic, int],
    layouts: dict[Topic, Layout | None],
    name: str | None,
    notes: list[Note],
    has: str = "",
) -> UsageError:
    why = "".join(f" {note.text}" for note in (notes if len(notes) < 3 else [notes[0], notes[-1]]))
    if not topics:
        return UsageError(f"{path}: no messages of this bag can be read.{why}")
    if name is not None and any(layouts.values()):
        what = f"has no Imu messages of the topic {shown(name)}{has}"
    else:
        known = f"has no messages{' that can be read' if notes else ''} of the type sensor_msgs/Imu"
        what = f"{known}, nor any of another type, of JSON or of protobuf with a gyroscope's rates"
    return UsageError(f"{path}: {what}.{why} It holds:\n{_listed(topics)}")


def _listed(topics: dict[Topic, int]) -> str:
    """Return a text that lists topics with their numbers of messages, if these numbers are known."""
    known = sorted(topics.items(), key=lambda item: item[0][:2])
    lines = []
    for topic, count in known[:MOST_NAMES]:
        messages = f"{count} message{'s' * (count != 1)}" if count or topic.is_imu else ""
        lines.append(f"  {visible(topic.name)}  ({', '.join(filter(None, [visible(topic.type), messages]))})")
    more = [f"  … {len(known)} in all"] if len(known) > MOST_NAMES else []
    return "\n".join(lines + more)


def _about(chosen: Topic, topics: dict[Topic, int]) -> str:
    others = sorted({topic.name for topic in topics} - {chosen.name})
    text = f"topic {visible(chosen.name)}, {visible(chosen.type)}"
    return f"{text}; other topics: {listed(others)}" if others else text


def _few(notes: list[Note]) -> list[Note]:
    """Return the first notes on damage, and one note with the number of the remaining notes."""
    left = len(notes) - MOST_NOTES
    return notes[:MOST_NOTES] + (
        [Note(notes[-1].kind, f"… and {left} more places like these.")] if left > 0 else []
    )


def _batches(path: Path, limits: Limits) -> Iterator[Batch | Note]:
    """Yield all messages of a bag, from all its files."""
    files = files_of(path) if path.is_dir() else [path]
    if not files:
        raise UsageError(f"{path}: no .db3 or .mcap file in this folder.")
    seen: dict[tuple[int, int], Path] = {}
    for file in files:
        try:
            about = file.stat()
            same = seen.setdefault((about.st_dev, about.st_ino), file)
            if same != file:
                yield Note(
                    "bag_messages", f"{file}: is the same file as {same} (a link), and is read only once."
                )
                continue
            with unpacked_file(file, limits) as unpacked:
                yield from _under_its_name(file, unpacked.path, _read(unpacked.path, limits))
                if unpacked.is_cut:
                    text = f"{file}: is cut off; what can be decompressed is read."
                    yield Note("cut_recording", text)
        except (OSError, ValueError) as error:
            if len(files) == 1:
                raise UsageError(f"{file}: cannot be read as a bag ({error}).") from error
            yield Note("recording_gap", f"{file}: cannot be read ({error}), and is left out.")


def _read(path: Path, limits: Limits) -> Iterator[Batch | Note]:
    """Yield the messages of a file that is not compressed."""
    with path.open("rb") as opened:
        begin = opened.read(len(ROS1))
    if begin.startswith(ROS1):
        return read_ros1(path, limits)
    if begin.startswith(MCAP):
        return read_mcap(path, limits)
    if begin.startswith(SQLITE[: len(ROS1)]):
        return read_sqlite(path, limits)
    raise ValueError("it does not begin like a file of ROS 1, SQLite or MCAP")


def _under_its_name(file: Path, read: Path, items: Iterator[Batch | Note]) -> Iterator[Batch | Note]:
    """Yield items with the user's name of a file, `file`, instead of that of its copy, `read`."""
    try:
        for item in items:
            yield (
                item._replace(text=item.text.replace(str(read), str(file)))
                if isinstance(item, Note)
                else item
            )
    except UsageError as error:
        raise type(error)(str(error).replace(str(read), str(file))) from error
