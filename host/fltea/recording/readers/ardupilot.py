"""Reads logs of ArduPilot (DataFlash, .bin). `dialects.toml` states what their columns mean."""

import re
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from fltea.recording.files import Note, listed
from fltea.recording.readers.arrays import of_arrays
from fltea.recording.readers.dataflash import HEAD_BYTES, MOST_PADDING, TYPES, Form, messages_in
from fltea.recording.reading import Missing, not_stated
from fltea.recording.sheet import Sheet
from fltea.records.errors import UsageError

MESSAGES = "GYR", "IMU", "ISB"
"""Names of messages with unfiltered samples, filtered samples, and raw batches. The first that the log has is
read.
"""

SCALES = {**dict.fromkeys("cCeE", 0.01), "L": 1e-7}
"""Factors by which a field's stored numbers are multiplied, by the letter of the field's format. Source:
ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html.
"""

OF_GYROSCOPE = 1
"""Value of the field `type` in an ISBH message (the head of a batch) that means a gyroscope."""

SAMPLES = 32
"""Number of samples in one ISBD message (a part of a batch)."""


def read(path: Path, topic: str) -> Sheet:
    """Read the messages of one sensor. `topic`: messages and sensor, such as `GYR:1`, `IMU` or `1`."""
    log = _Log(path)
    there = {message: found for message in MESSAGES if (found := log.sensors(message))}
    asked = re.fullmatch(r"(GYR|IMU|ISB)?(?:[:\[]?(\d+)\]?)?", topic.upper())
    message = (asked[1] if asked else topic) or next(iter(there), "")
    if message not in there:
        what = f"no {message} messages" if message else f"no messages {' or '.join(MESSAGES)}"
        has = f"those of {listed([*there])}" if there else f"{listed(log.names)}"
        damage = "".join(f" The log: {note.text}" for note in log.losses())
        advice = damage or " Set LOG_BITMASK to log the IMU."
        raise UsageError(f"is an ArduPilot log with {what}; it has {has}.{advice}")
    sensors = there[message]
    each = ", ".join(f"{message}:{number} ({len(rows)} messages)" for number, rows in sensors.items())
    number = int(asked[2]) if asked and asked[2] else next(iter(sensors))
    if number not in sensors:
        raise UsageError(f"is an ArduPilot log without {message}:{number}; it has {each}.")
    if len(sensors) > 1 and not (asked and asked[2]):
        raise not_stated(str(path), [Missing(f"which sensor is meant of {each}", "--topic ?")])
    others = [one for one in there if one != message]
    notes = [f"{message} is read; there is {listed(others)} too (--topic)."] if others and not topic else []
    if message == "ISB":
        sheet = log.batches(sensors[number])
        notes.append("ISB: batches of raw samples; the samples between two batches count as lost.")
    else:
        sheet = of_arrays(
            {name: sensors[number][name] for name in sensors[number].dtype.names if name != "I"}
        )
    told = [*log.losses(), *(Note("reading", text) for text in notes)]
    told = [one._replace(text=f"{path}: {one.text}") for one in told]
    return replace(sheet, topic=f"{message}:{number}", notes=tuple(told))


class _Log:
    """The messages of a log, by their names, as arrays."""

    def __init__(self, path: Path) -> None:
        from pymavlink.DFReader import DFReader_binary

        log = DFReader_binary(str(path))
        self._bytes, self._offsets = np.frombuffer(log.data_map, np.uint8), dict[int, Any]()
        self._forms, self._holes, self._lost_bytes, self._first = dict[int, Form](), 0, 0, 0
        for kind, form in log.formats.items():
            letters = form.format if isinstance(form.format, str) else form.format.decode("latin-1")
            self._forms[kind] = Form(form.name, form.len, letters.rstrip("\0"), form.columns)
            self._offsets[kind] = np.array(log.offsets[kind], np.int64)
        self._tail = self._behind_all()
        if not _is_padding(self._tail):
            found = messages_in(log.data_map)
            self._forms, self._tail = found.forms, found.tail
            self._offsets = {kind: np.array(offsets, np.int64) for kind, offsets in found.offsets.items()}
            self._holes, self._lost_bytes, self._first = found.holes, found.lost_bytes, found.first
        self._kinds = {form.name: kind for kind, form in self._forms.items()}
        self.names = sorted(name for name, kind in self._kinds.items() if len(self._offsets.get(kind, ())))

    def _behind_all(self) -> bytes:
        """Return the bytes after the last message; all bytes if some before it belong to no message."""
        end = whole_bytes = 0
        for kind, offsets in self._offsets.items():
            if len(offsets):
                length = self._forms[kind].length
                whole_bytes += len(offsets) * length
                end = max(end, offsets[-1] + length)
        return self._bytes[end if end == whole_bytes <= len(self._bytes) else 0 :].tobytes()

    def losses(self) -> list[Note]:
        """Return warnings about bytes that belong to no whole message. The caller adds the path in front."""
        found = []
        if self._holes:
            places = f"{self._holes} places, the first" if self._holes > 1 else "one place,"
            text = f"is damaged: {self._lost_bytes} bytes in {places} at byte {self._first}, belong to no "
            text += "message that the log declares and are left out; the messages around them are read."
            found.append(Note("recording_gap", text))
        if not _is_padding(self._tail):
            text = f"its last {len(self._tail)} bytes are no whole message and are left out: the board was "
            found.append(Note("cut_recording", f"{text}switched off, or the file is cut or damaged."))
        return found

    def offsets(self, name: str) -> Any:
        """Return the offsets in the log of all messages with a given name."""
        return self._offsets.get(self._kinds.get(name, -1), np.empty(0, np.int64))

    def rows(self, name: str) -> Any:
        """Return all messages with a given name as a structured array with a column for each field."""
        offsets = self.offsets(name)
        if not len(offsets):
            return np.empty(0, [("TimeUS", "<u8")])
        form = self._forms[self._kinds[name]]
        fields = list(zip(form.columns, form.fields, strict=True))
        packed = np.dtype([(column, TYPES[letter]) for column, letter in fields])
        if packed.itemsize != form.length - HEAD_BYTES:
            declared, taken = form.length, packed.itemsize + HEAD_BYTES
            raise ValueError(f"{name} declares {declared} bytes, and its fields take {taken}")
        found = self._bytes[offsets[:, np.newaxis] + np.arange(HEAD_BYTES, form.length)].view(packed)[:, 0]
        scaled = {column: SCALES[letter] for column, letter in fields if letter in SCALES}
        if not scaled:
            return found
        whole = np.empty(
            len(found), [(n, "f8" if n in scaled else found.dtype[n]) for n in found.dtype.names]
        )
        for column in found.dtype.names:
            whole[column] = found[column] * scaled[column] if column in scaled else found[column]
        return whole

    def sensors(self, message: str) -> dict[int, Any]:
        """Return, for each sensor's number, all messages of that sensor with the name `message`.

        For the raw batches ISB, these are their heads (ISBH).
        """
        if message == "ISB":
            heads = self.rows("ISBH")
            heads = heads[heads["type"] == OF_GYROSCOPE] if len(heads) else heads
            return (
                {int(k): heads[heads["instance"] == k] for k in np.unique(heads["instance"])}
                if len(heads)
                else {}
            )
        rows = self.rows(message)
        if "I" in rows.dtype.names:
            return {int(k): rows[rows["I"] == k] for k in np.unique(rows["I"])}
        # Before version 4.1, each sensor had messages with its own name: IMU, IMU2, IMU3, and ACC1, GYR1 and
        # so on.
        names = (
            (message, *(f"{message}{k}" for k in (2, 3)))
            if message == "IMU"
            else [f"{message}{k}" for k in (1, 2, 3)]
        )
        return {k: found for k, name in enumerate(names) if len(found := self.rows(name))}

    def batches(self, heads: Any) -> Sheet:
        """Return the samples in the batches of one sensor as a table. `heads`: ISBH messages of the sensor.

        The ISBH message before each batch gives the batch's scale, rate and first time.
        """
        data, begins = self.rows("ISBD"), self.offsets("ISBH")
        every = self.rows("ISBH")
        head = np.searchsorted(begins, self.offsets("ISBD")) - 1
        data, head = data[head >= 0], every[head[head >= 0]]
        ours = (
            (head["N"] == data["N"])
            & (head["type"] == OF_GYROSCOPE)
            & (head["instance"] == heads["instance"][0])
        )
        data, head = data[ours], head[ours]
        if not len(data) or (head["smp_rate"] <= 0).any() or (head["mul"] == 0).any():
            raise UsageError("holds heads of batches (ISBH) without samples, a rate or a scale.")
        place = data["seqno"][:, np.newaxis] * SAMPLES + np.arange(SAMPLES)
        time_us = head["SampleUS"][:, np.newaxis] + place * (1e6 / head["smp_rate"][:, np.newaxis])
        kept = place < head["smp_cnt"][:, np.newaxis]
        columns = {f"gyro_{axis}": (data[axis] / head["mul"][:, np.newaxis])[kept] for axis in "xyz"}
        units = {"time_us": "us", **dict.fromkeys(columns, "rad/s")}
        sheet = of_arrays({"time_us": time_us[kept], **columns}, units)
        return replace(
            sheet, unit_evidence=("dialect", "ArduPilot: counts of a batch, divided by mul, are rad/s")
        )


def _is_padding(tail: bytes) -> bool:
    """Return whether the bytes after the last message are padding or none."""
    return len(tail) < MOST_PADDING and not tail.strip(b"\0\xff")
