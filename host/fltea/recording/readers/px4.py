"""Reads logs of PX4 (.ulg). `dialects.toml` states what their columns mean."""

from collections.abc import Mapping, Sequence
from io import BytesIO
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from fltea.recording.files import Note, listed
from fltea.recording.readers.arrays import of_arrays
from fltea.recording.readers.ulog import Mended, mended
from fltea.recording.reading import Missing, not_stated
from fltea.recording.sheet import Sheet
from fltea.records.errors import UsageError

TOPICS = "sensor_combined", "sensor_gyro", "sensor_gyro_fifo", "vehicle_angular_velocity"
"""If the user names no topic, the first of these topics that the log contains is read."""

FIFO = "sensor_gyro_fifo"

EVEN = 0.2
"""A FIFO message states a nominal sampling period (`dt`). The time since the previous message, divided by the
number of samples in the message, is the measured period. The measured period is used if it differs from `dt`
by less than the fraction EVEN.
"""


FEW = 0.02
"""Messages of other devices than the usual one are left out if they are at most this share of a topic. They
are damaged, or of a sensor that PX4 used for a moment.
"""


def read(path: Path, topic: str) -> Sheet:
    """Read a topic.

    If several sensors publish the topic, `topic` also names one of these sensors, as in `sensor_gyro:1`.
    """
    name, _, instance = topic.partition(":")
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
        whole = mended(content)
    wanted = [name] if name else list(TOPICS)
    log = _opened(path, whole, wanted)
    name = name or next((known for known in TOPICS if any(one.name == known for one in log.data_list)), "")
    there = _by_instance(log, name)
    if not there:
        raise _no_topic(path, topic, whole, log)
    each = [f"{name}:{number} ({_about(one)})" for number, one in there.items()]
    if instance and instance not in there:
        raise UsageError(f"is a PX4 log with no topic {topic}; it has {listed(each)}.")
    if not instance and len(there) > 1:
        what = f"which sensor is meant of {', '.join(each)}"
        raise not_stated(str(path), [Missing(what, "--topic ?")])
    data = there[instance] if instance else next(iter(there.values()))
    data, strays = _without_strays(name, data)
    if len(devices := _devices(data)) > 1:
        raise UsageError(
            f"is a PX4 log whose {name} is of several sensors one after the other (device_id "
            f"{listed(devices)}), so its samples are not all of one sensor. Name another topic by --topic."
        )
    if name in whole.twice and not whole.is_settled:
        raise UsageError(
            f"is a PX4 log that declares the fields of {name} twice, each time others, and which are right "
            "cannot be told. Name another topic by --topic."
        )
    sheet = _unpacked(data) if name == FIFO else of_arrays(data)
    texts = []
    if name == TOPICS[0] and len(others := _by_instance(log, "sensor_gyro")) > 1:
        texts.append(
            f"{name} has the samples of one of {len(others)} sensors, which PX4 chose; --topic sensor_gyro:0 "
            "reads the first sensor."
        )
    if lost_ms := [one.duration for one in log.dropouts]:
        texts.append(f"the logger lost data {len(lost_ms)} times, {sum(lost_ms)} ms in all.")
    notes = tuple(Note("reading", f"{path}: {text}") for text in texts)
    notes = (*(Note("recording_gap", f"{path}: {text}") for text in strays), *notes)
    notes = (*_losses(path, whole, log, wanted), *notes)
    topic = f"{name}:{instance}" if instance else name
    return replace(sheet, topic=topic, notes=notes)


def _by_instance(log: Any, name: str) -> dict[str, Mapping[str, Any]]:
    """Return the columns of each instance of a topic (each sensor that publishes it), by instance number.

    A log may split the messages of an instance into several series. PX4's library returns each series by
    itself. Here they are joined, in the order of their time stamps.
    """
    parts: dict[str, list[Mapping[str, Any]]] = {}
    for one in log.data_list:
        if one.name == name:
            parts.setdefault(str(one.multi_id), []).append(one.data)
    return {number: _joined(found) for number, found in parts.items()}


def _joined(parts: Sequence[Mapping[str, Any]]) -> Mapping[str, Any]:
    if len(parts) == 1:
        return parts[0]
    order = np.argsort(np.concatenate([one["timestamp"] for one in parts]), kind="stable")
    names = [name for name in parts[0] if all(name in one for one in parts)]
    return {name: np.concatenate([one[name] for one in parts])[order] for name in names}


def _opened(path: Path, whole: Mended, topics: list[str] | None) -> Any:
    """Read some topics, or all if `topics` is None, with PX4's library.

    Damaged parts of the log are left out.
    """
    from pyulog import ULog

    return ULog(str(path) if whole.is_whole else BytesIO(whole.data), topics)


def _no_topic(path: Path, topic: str, whole: Mended, log: Any) -> UsageError:
    names = sorted({one.name for one in _opened(path, whole, None).data_list})
    asked = f"topic {topic}" if topic else f"topic {' or '.join(TOPICS)}"
    others = f"; name one by --topic: {listed(names)}" if names else ""
    losses = _losses(path, whole, log, [topic.partition(":")[0]] if topic else list(TOPICS))
    damage = "".join(f" It {note.text.removeprefix(f'{path}: ')}" for note in losses)
    return UsageError(f"is a PX4 log with no {asked}{others}.{damage}")


def _losses(path: Path, whole: Mended, log: Any, wanted: list[str]) -> list[Note]:
    """Return warnings about the parts of a log that are not read.

    `wanted`: the topics that PX4's library was asked for.
    """
    found = []
    if whole.holes:
        places = f"{whole.holes} places, the first" if whole.holes > 1 else "one place,"
        text = f"is damaged: {whole.lost_bytes} bytes in {places} at byte {whole.first}, belong to no message"
        found.append(("recording_gap", f"{text} and are left out; the parts before and after them are read."))
    if whole.odd:
        many, left = ("one message is", "is") if whole.odd == 1 else (f"{whole.odd} messages are", "are")
        text = f"{many} of a kind or a topic that the log does not declare"
        found.append(
            ("recording_gap", f"{text}, and {left} left out: the log is damaged, or newer than this program.")
        )
    if whole.twice:
        text = f"declares the fields of {listed(whole.twice)} twice, each time others; those that fit the "
        found.append(("recording_gap", f"{text}length of the messages are taken."))
    read = sum(len(one.data["timestamp"]) for one in log.data_list)
    there = sum(count for (name, _), count in whole.counts.items() if name in wanted)
    if read != there or log.file_corruption:
        damaged = "takes the log for damaged, and " if log.file_corruption else ""
        text = f"the library of PX4 {damaged}read {read} of {there} messages of {listed(wanted)}"
        found.append(("recording_gap", f"{text}."))
    if whole.cut_bytes:
        text = f"ends in the middle of a message, whose {whole.cut_bytes} bytes are left out"
        found.append(("cut_recording", f"{text}: the logger was switched off, or the file is cut."))
    return [Note(kind, f"{path}: {text}") for kind, text in found]


def _about(data: Mapping[str, Any]) -> str:
    devices = _devices(data)
    return f"{len(data['timestamp'])} messages{', device_id ' if devices else ''}{', '.join(devices)}"


def _devices(data: Mapping[str, Any]) -> list[str]:
    return [str(one) for one in np.unique(data["device_id"])] if "device_id" in data else []


def _without_strays(name: str, data: Mapping[str, Any]) -> tuple[Mapping[str, Any], list[str]]:
    """Leave out a few messages of a topic that name another device; return the rest, and a text on them."""
    if "device_id" not in data:
        return data, []
    devices, counts = np.unique(data["device_id"], return_counts=True)
    usual, total = devices[np.argmax(counts)], len(data["device_id"])
    strays = total - int(counts.max())
    if not 0 < strays <= FEW * total:
        return data, []
    others = listed([str(one) for one in devices if one != usual])
    text = f"device_id is {others} in {strays} of {total} messages of {name}, and {usual} in all others; "
    text += "the former are left out, as damaged or of another sensor."
    kept = data["device_id"] == usual
    return {column: values[kept] for column, values in data.items()}, [text]


def _unpacked(data: Mapping[str, Any]) -> Sheet:
    """Return the samples in FIFO messages.

    Each message holds several samples and the time of its last sample.
    """
    axes = {
        axis: sorted((n for n in data if n.startswith(f"{axis}[")), key=lambda n: int(n[2:-1]))
        for axis in "xyz"
    }
    count = np.asarray(data["samples"], np.int64)
    last_us, dt_us = (np.asarray(data[name], np.float64) for name in ("timestamp_sample", "dt"))
    behind = count[:, np.newaxis] - 1 - np.arange(len(axes["x"]))
    there = behind >= 0
    # `dt` in the messages is only the nominal sampling period
    took = np.diff(last_us, prepend=np.nan) / np.maximum(count, 1)
    step_us = np.where(np.abs(took / dt_us - 1) < EVEN, took, dt_us)
    columns = {"time_us": (last_us[:, np.newaxis] - behind * step_us[:, np.newaxis])[there]}
    scale = np.asarray(data["scale"], np.float64)[:, np.newaxis]
    for axis, names in axes.items():
        columns[f"gyro_{axis}"] = (np.stack([data[name] for name in names], axis=1) * scale)[there]
    sheet = of_arrays(columns, dict.fromkeys(columns, "rad/s") | {"time_us": "us"})
    return replace(sheet, unit_evidence=("dialect", "PX4: counts times scale are rad/s"))
