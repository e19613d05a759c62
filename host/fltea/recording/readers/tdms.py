"""Reads LabVIEW files (TDMS): groups of channels.

Properties of a channel state its unit and sampling period.
"""

from collections.abc import Mapping
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from fltea.recording.files import Note, listed
from fltea.recording.readers.arrays import NoNumbers, of_arrays
from fltea.recording.readers.tdms_changes import change_in
from fltea.recording.readers.tdms_parts import Joined, Parts, checked, parts_of
from fltea.recording.sheet import Sheet
from fltea.records.errors import UsageError


def read(path: Path, _: str) -> Sheet:
    """Return all channels as columns, named by group and channel; they are read in blocks."""
    found: dict[str, Any] = {}
    file, parts, change = _unchanged(path, *_opened(path))
    cut = _rows_of_cut_channels(file)
    facts: dict[str, Any] = dict(file.properties)
    for group in file.groups():
        facts.update({f"{group.name}.{key}": value for key, value in group.properties.items()})
        for channel in group.channels():
            name = f"{group.name}.{channel.name}"
            is_text, rows = channel.dtype.kind not in "biufM", cut.get(channel.path, len(channel))
            found[name] = NoNumbers("holds no numbers", rows) if is_text else _Channel(channel, rows)
            facts.update({f"{name}@{key}": value for key, value in channel.properties.items()})
    sheet = of_arrays(found, attributes=facts)
    notes = [*change, *_losses(file, parts, cut, is_timed=not sheet.rates)]
    if len(parts.whole) > 1 and sheet.rates:
        text = f"was written in {len(parts.whole) + len(parts.lost)} parts. Its rate does not show whether "
        notes.append(("reading", f"{text}there is a pause between two parts; a column of times would."))
    return replace(sheet, notes=tuple(Note(kind, f"{path}: {text}") for kind, text in notes))


def _opened(path: Path) -> tuple[Any, Parts]:
    """Open the parts of a file that are whole. The library refuses a file with damage in any other part."""
    from nptdms import TdmsFile

    parts = parts_of(path)
    if not parts.lost:
        try:
            return TdmsFile.open(path), parts
        except Exception:  # the library raises various errors, MemoryError too, for a damaged description
            parts = checked(path)
            if not parts.lost:
                raise
    if not parts.whole:
        raise UsageError("is damaged: none of its parts is whole, so nothing of it can be read.")
    return _joined(path, parts), parts


def _joined(path: Path, parts: Parts) -> Any:
    from nptdms import TdmsFile

    return TdmsFile.open(BufferedReader(Joined(path.open("rb"), parts.whole)))


def _unchanged(path: Path, file: Any, parts: Parts) -> tuple[Any, Parts, list[tuple[str, str]]]:
    """Return the file up to the part from which on another unit, rate or scale holds.

    The list holds the kind and the text of a note if there is such a part.
    """
    change = change_in(path, parts.whole)
    if change is None:
        return file, parts, []
    lost = [one for one in parts.lost if one[0] < parts.whole[change.part].begin]
    before = Parts(parts.whole[: change.part], lost)
    kept = _joined(path, before)
    rows = max((len(one) for group in file.groups() for one in group.channels()), default=0)
    rows -= max((len(one) for group in kept.groups() for one in group.channels()), default=0)
    text = f"part {change.part + 1} of {len(parts.whole)} states {change.what}, so it and the parts after it "
    return kept, before, [("recording_gap", f"{text}are left out ({rows} rows).")]


def _rows_of_cut_channels(file: Any) -> dict[str, int]:
    """Return for channels of the last part how many values are read, by the path of the channel.

    If a file is cut, the channels of its last part end at different rows. Channels that would have equal
    lengths in a whole file are read up to the row up to which all of them have values.
    """
    expected: dict[int, list[Any]] = {}
    for path, status in (file.file_status.channel_statuses or {}).items():
        channel = next((one for group in file.groups() for one in group.channels() if one.path == path), None)
        if channel is not None and len(channel):
            whole = len(channel) - status.read_length + status.expected_length
            expected.setdefault(whole, []).append(channel)
    return {
        one.path: min(len(other) for other in channels) for channels in expected.values() for one in channels
    }


def _losses(file: Any, parts: Parts, cut: Mapping[str, int], *, is_timed: bool) -> list[tuple[str, str]]:
    """Return what is not read of a file: the kind of each note, and its text."""
    found = []
    if parts.is_cut:
        lacks = f" (bytes missing: {parts.missing_bytes})" if parts.missing_bytes else ""
        text = f"ends within its last part{lacks}: the recorder was switched off, or the file is cut or "
        text += "damaged. The samples that are missing there are left out, and so are channels without any."
        channels = [one for group in file.groups() for one in group.channels()]
        over = {one.name: len(one) - cut[one.path] for one in channels if one.path in cut}
        if over := {name: rows for name, rows in over.items() if rows}:
            each = listed([f"{rows} of {name}" for name, rows in over.items()])
            text += f" Values that are left out since other channels lack those of the same rows: {each}."
        found.append(("cut_recording", text))
    if parts.lost:
        lost = sum(end - begin for begin, end in parts.lost)
        places = f"{len(parts.lost)} places, the first" if len(parts.lost) > 1 else "one place,"
        text = (
            f"is damaged: {lost} bytes in {places} at byte {parts.lost[0][0]}, are in no whole part and are "
        )
        text += "left out; the parts before and after them are read."
        if not is_timed:
            text += " Its rate does not show the samples that are missing there; a column of times would."
        found.append(("recording_gap", text))
    return found


class _Channel:
    """A channel of a LabVIEW file (TDMS) that can be read like an array.

    The channel's own scale is applied to the values.
    """

    def __init__(self, channel: Any, rows: int) -> None:
        self._channel, self.shape = channel, (rows,)
        self.dtype = np.dtype("M8[us]") if channel.dtype.kind == "M" else np.dtype(np.float64)

    def __getitem__(self, rows: Any) -> Any:
        if not isinstance(rows, slice):
            return np.asarray(self._channel[: self.shape[0]])[rows]
        return np.asarray(self._channel[rows])
