"""Recordings in bags of ROS 1 and ROS 2: one topic of sensor_msgs/Imu, in ROS' units, without ROS."""

import contextlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fltea.recording.bag_files import MCAP, ROS1, SQLITE, files_of
from fltea.recording.bag_imu import read_imu
from fltea.recording.bag_messages import LONGEST_MESSAGE, Batch, Topic
from fltea.recording.bag_ros1 import read_ros1
from fltea.recording.bag_ros2 import read_mcap, read_sqlite, unpacked_file
from fltea.recording.files import (
    AT_ONCE,
    MOST_NAMES,
    Note,
    Recording,
    Stored,
    check_span,
    listed,
)
from fltea.recording.lines import shown
from fltea.recording.message_stamps import Stamps, Times, is_arrival, is_uneven, judge
from fltea.recording.npz_arrays import NUMBER_BYTES
from fltea.recording.session import LATEST_NS
from fltea.recording.spool import Spool
from fltea.recording.table import is_of_sensor
from fltea.recording.units import PER_UNIT
from fltea.recording.unpack import unpacked_zstd
from fltea.records.errors import UsageError
from fltea.records.visible import visible
from fltea.settings.extras import load
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import DEFAULT_LIMITS, Limits

COLUMNS, NUMBERS = ("gyro", "accel", "stamp", "arrival"), 8
"""What waits in a temporary file, and how many numbers of each sample that is."""

MOST_NOTES = 5
"""Places of damage that are reported one by one."""

ZSTD = b"\x28\xb5\x2f\xfd"
"""What a message begins with that was packed by itself."""


def open_bag(path: Path, how: How = AS_IT_SAYS, limits: Limits = DEFAULT_LIMITS) -> Stored:
    """Read the Imu topic of a bag, or the one that `how` names, once; its numbers wait in a temporary file.

    path: a .bag, .db3 or .mcap file, or the folder of a bag of ROS 2.

    Raises:
        UsageError: no such bag, none or several Imu topics (they are listed), no angular velocity in it, or
            more than the limits allow.
    """
    try:
        return _open(path, how, limits)
    except OSError as error:  # of reading a file by itself `_batches` tells
        raise UsageError(f"{path}: its numbers cannot be kept in a temporary file ({error}).") from error


def _open(path: Path, how: How, limits: Limits) -> Stored:
    topics: dict[Topic, int] = {}
    notes: list[Note] = []
    chosen: Topic | None = None
    messages = _Messages(path, limits)
    for item in _batches(path, limits):
        if isinstance(item, Note):
            notes.append(item)
            continue
        topic = item.topic
        topics[topic] = topics.get(topic, 0) + item.count
        is_named = how.topic is None or topic.name.lstrip("/") == how.topic.lstrip("/")
        if not topic.is_imu or not item.count or not is_named:
            continue
        chosen = chosen or topic
        if topic.name == chosen.name:
            messages.add(item)
    several = {topic.name for topic, count in topics.items() if topic.is_imu and count}
    if chosen is None:
        raise _none(path, topics, how.topic, notes)
    if how.topic is None and len(several) > 1:
        raise UsageError(
            f"{path}: has {len(several)} Imu topics; name one of them, such as --topic "
            f"{visible(min(several))}:\n{_listed(topics, imu_only=True)}"
        )
    stored = messages.stored(visible(chosen.name), sorted(several - {chosen.name}), _few(notes))
    return stored._replace(about=_about(chosen, topics), topic=chosen.name)


def _none(path: Path, topics: dict[Topic, int], name: str | None, notes: list[Note]) -> UsageError:
    why = "".join(f" {note.text}" for note in notes[:1])
    if not topics:
        return UsageError(f"{path}: no messages can be read of this bag.{why}")
    if name is not None and any(topic.is_imu and count for topic, count in topics.items()):
        what = f"has no Imu messages of the topic {shown(name)}"
    else:
        known = "has no messages of the type sensor_msgs/Imu"
        what = f"{known}, nor any of JSON or protobuf with a gyroscope's rates"
    return UsageError(f"{path}: {what}.{why} It holds:\n{_listed(topics)}")


def _listed(topics: dict[Topic, int], *, imu_only: bool = False) -> str:
    """A line a topic. Of what cannot be read messages are not always counted."""
    known = [item for item in topics.items() if item[0].is_imu or not imu_only]
    known.sort(key=lambda item: item[0][:2])
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
    """The first ones, and how many there are of each kind."""
    left = len(notes) - MOST_NOTES
    return notes[:MOST_NOTES] + (
        [Note(notes[-1].kind, f"… and {left} more such places.")] if left > 0 else []
    )


def _batches(path: Path, limits: Limits) -> Iterator[Batch | Note]:
    """All messages of a bag, from all its files."""
    files = files_of(path) if path.is_dir() else [path]
    if not files:
        raise UsageError(f"{path}: no .db3 or .mcap file in this folder.")
    for file in files:
        try:
            with unpacked_file(file, limits) as unpacked:
                with unpacked.open("rb") as opened:
                    begin = opened.read(len(ROS1))
                if begin.startswith(ROS1):
                    yield from read_ros1(unpacked, limits)
                elif begin.startswith(MCAP):
                    yield from read_mcap(unpacked, limits)
                elif begin.startswith(SQLITE[: len(ROS1)]):
                    yield from read_sqlite(unpacked, limits)
                else:
                    raise ValueError("it begins like none of ROS 1, SQLite and MCAP")
        except (OSError, ValueError) as error:
            if len(files) == 1:
                raise UsageError(f"{file}: cannot be read as a bag ({error}).") from error
            yield Note("recording_gap", f"{file}: cannot be read ({error}), and is left out.")


class _Messages:
    """Imu messages of one topic, gathered in a spool."""

    def __init__(self, path: Path, limits: Limits) -> None:
        self._path, self._limits = path, limits
        self._spool = Spool()
        self._waiting: list[tuple[int, bytes]] = []
        self._topic = Topic("", "", "cdr")
        self._last: NDArray[np.int64] | None = None
        self._unusable = self._not_numbers = self._twice = 0
        self._moves = self._accel_moves = False
        self._bad_accel = 0
        self._measured = self._measured_accel = False

    def add(self, batch: Batch) -> None:
        """Take the next ones; they are looked at many at a time."""
        if batch.topic.encoding != self._topic.encoding:
            self._look()
        self._topic = batch.topic
        self._waiting.extend(zip(batch.arrival_ns, batch.data, strict=True))
        if len(self._waiting) >= AT_ONCE:
            self._look()

    def _look(self) -> None:
        if not self._waiting:
            return
        arrivals, messages = zip(*self._waiting, strict=True)
        self._waiting.clear()
        if any(message.startswith(ZSTD) for message in messages):
            messages = tuple(map(_unpacked, messages))
        encoding = self._topic.encoding
        assert encoding is not None
        if self._topic.is_of_objects:
            from fltea.recording.bag_objects import read_objects

            imu = read_objects(messages, encoding, self._topic.type, self._topic.schema)
        else:
            imu = read_imu(messages, encoding)
        self._unusable += len(messages) - len(imu.row)
        numbers = is_of_sensor(imu.gyro_rads * PER_UNIT["rad/s"])
        self._not_numbers += len(numbers) - int(np.count_nonzero(numbers))
        stamp_ns, arrival_ns = imu.stamp_ns, np.array(arrivals, np.int64)[imu.row]
        self._measured |= bool(imu.measured.any())
        self._measured_accel |= bool(imu.measured_accel.any())
        rows = np.column_stack([imu.gyro_rads, imu.accel_ms2, stamp_ns.view(np.float64)])
        again = self._repeated(rows) & numbers
        self._twice += int(np.count_nonzero(again))
        keep = numbers & ~again
        gyro, accel = imu.gyro_rads[keep] * PER_UNIT["rad/s"], imu.accel_ms2[keep]
        self._moves |= bool(gyro.any())
        self._accel_moves |= bool(accel.any())
        self._bad_accel += int(np.count_nonzero(~is_of_sensor(accel)))
        size = (self._spool.length("gyro") + len(gyro)) * NUMBERS * NUMBER_BYTES
        if size > self._limits.whole_bytes:
            raise self._limits.whole_too_large(str(self._path), size)
        if len(gyro):
            self._append(gyro, accel, stamp_ns[keep], arrival_ns[keep])

    def _repeated(self, rows: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which are the same as the one before, their stamp included; one that has none is not."""
        if not len(rows):
            return np.zeros(0, bool)
        bits = np.ascontiguousarray(rows).view(np.int64)
        before = bits[:1] if self._last is None else self._last
        same: NDArray[np.bool_] = (bits == np.concatenate([before, bits[:-1]])).all(axis=1) & (
            bits[:, -1] != 0
        )
        same[0] &= self._last is not None
        self._last = bits[-1:]
        return same

    def stored(self, topic: str, others: list[str], notes: list[Note]) -> Stored:
        """All of them as a recording."""
        self._look()
        where = f"{self._path}: topic {topic}"
        self._clean_accel()
        n = self._spool.length("gyro")
        self._check(where, n, others)
        notes += self._of_messages(where)
        stamps, times_are_arrivals, problems = self._judged(where)
        notes += problems
        rate_hz = 1e9 / stamps.period_ns
        last = int(stamps.sequence(n - 1, n)[0])
        check_span(self._path, rate_hz, n, last / rate_hz)
        if not (self._accel_moves and self._measured_accel):
            self._spool.drop("accel")
        arrival_ns: Times = self._spool.whole("arrival")
        start_ns = int(arrival_ns[0])
        sane = bool((arrival_ns > 0).all() and (arrival_ns <= LATEST_NS).all())
        if (
            times_are_arrivals
            or not sane
            or not is_arrival(arrival_ns, stamps.sequence(0, n), stamps.period_ns)
        ):
            self._spool.drop("arrival")
        blocks = partial(_blocks, self._spool, stamps, rate_hz, start_ns)
        return Stored(n, rate_hz, None, None, blocks, tuple(notes), start_ns if sane else 0)

    def _clean_accel(self) -> None:
        """Leave out messages whose acceleration is none; if most are so, leave out the acceleration."""
        if self._bad_accel > self._spool.length("gyro") // 2:
            self._spool.drop("accel")
        elif self._bad_accel:
            before, self._spool = self._spool, Spool()
            for values in before.blocks(COLUMNS, AT_ONCE):
                keep = is_of_sensor(values[1])
                self._append(*(column[keep] for column in values))
            before.close()
            self._not_numbers += self._bad_accel

    def _append(self, *values: NDArray[Any]) -> None:
        for name, column in zip(COLUMNS, values, strict=True):
            self._spool.append(name, column)

    def _check(self, where: str, n: int, others: list[str]) -> None:
        instead = f" Other Imu topics of this bag: {', '.join(map(visible, others))}." if others else ""
        if not n:
            raise UsageError(
                f"{where}: none of its messages can be used ({self._unusable} are not of the layout of "
                f"sensor_msgs/Imu, {self._not_numbers} hold no rates).{instead}"
            )
        if not self._moves:
            said = "" if self._measured else ", and the messages say that it was not measured"
            raise UsageError(f"{where}: the angular velocity is 0 in all {n} messages{said}.{instead}")
        if n < 2:
            raise UsageError(f"{where}: one message alone tells no rate.")

    def _of_messages(self, where: str) -> list[Note]:
        found = [
            (self._unusable, "do not have the layout of sensor_msgs/Imu and are left out"),
            (
                self._not_numbers,
                "hold a value that is not a number, or that no sensor gives, and count as missing",
            ),
            (self._twice, "are repeated and taken once"),
        ]
        problems = [f"{count} messages {what}" for count, what in found if count]
        if self._bad_accel and "accel" not in self._spool:
            problems.append(
                "the acceleration is left out, since most of its values are not numbers, or no "
                "sensor gives them"
            )
        return [Note("bag_messages", f"{where}: {'; '.join(problems)}.")] if problems else []

    def _judged(self, where: str) -> tuple[Stamps, bool, list[Note]]:
        """The stamps or else the arrivals, whether it is these, and what has to be said of them."""
        stamp_ns: Times = self._spool.whole("stamp")
        arrival_ns: Times = self._spool.whole("arrival")
        known = bool((np.abs(arrival_ns) <= LATEST_NS).all() and np.ptp(arrival_ns) > 0)
        problems = []
        no_stamps = not np.ptp(stamp_ns)
        if no_stamps:
            value = "0" if not stamp_ns[0] else "the same"
            problems.append(
                f"the stamps of all message headers are {value}, so the times of arrival are taken; gaps and "
                "rate are only as good as these"
            )
            stamp_ns = arrival_ns
        try:
            if no_stamps and not known:
                raise ValueError("the stamps do not advance")
            stamps = judge(stamp_ns, arrival_ns if known and not no_stamps else None)
        except ValueError as error:
            raise UsageError(f"{where}: neither header stamps nor arrivals tell a rate ({error}).") from error
        n = len(stamp_ns)
        if is_uneven(stamps, n):
            problems.append(
                f"{stamps.uneven} of {n - 1} steps between stamps are more than a fifth off the period of "
                f"{stamps.period_ns * 1e-6:.4g} ms (by {stamps.spread_ns * 1e-6:.3g} ms, root mean square); "
                "the samples are taken as even"
            )
        if stamps.alike:
            problems.append(f"{stamps.alike} stamps are the same as the one before, with other values")
        if stamps.backward:
            problems.append(f"{stamps.backward} stamps run backwards")
        if len(stamps.epoch_row):
            problems.append(f"the clock was set {len(stamps.epoch_row)} times; a new stretch begins at each")
        return stamps, no_stamps, [Note("bag_stamps", f"{where}: {'; '.join(problems)}.")] if problems else []


def _unpacked(message: bytes) -> bytes:
    if not message.startswith(ZSTD):
        return message
    zstandard = load("zstandard", "zstandard", "ros", "Bags that are packed in zstd need")
    with contextlib.suppress(zstandard.ZstdError):
        return unpacked_zstd(message, LONGEST_MESSAGE)
    return b""


def _blocks(spool: Spool, stamps: Stamps, rate_hz: float, start_ns: int) -> Iterator[Recording]:
    names = [name for name in ("gyro", "accel", "arrival") if name in spool]
    row = 0
    for values in spool.blocks(names, AT_ONCE):
        found = dict(zip(names, values, strict=True))
        end = row + len(found["gyro"])
        seq = stamps.sequence(row, end)
        yield Recording(
            found["gyro"],
            rate_hz,
            seq / rate_hz,
            host_s=(found["arrival"] - start_ns) * 1e-9 if "arrival" in found else None,
            accel_ms2=found.get("accel"),
            seq=seq,
            epoch=stamps.epoch(row, end),
        )
        row = end
