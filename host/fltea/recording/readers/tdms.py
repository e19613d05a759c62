"""Reads LabVIEW files (TDMS): groups of channels.

Properties of a channel state its unit and sampling period.
"""

import struct
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from fltea.recording.files import Note
from fltea.recording.readers.arrays import NoNumbers, of_arrays
from fltea.recording.sheet import Sheet

_LEAD_IN = struct.Struct("<4sIIQQ")
_STILL_WRITTEN = (1 << 64) - 1


def read(path: Path, _: str) -> Sheet:
    """Return all channels as columns, named by group and channel; they are read in blocks."""
    from nptdms import TdmsFile

    found: dict[str, Any] = {}
    file = TdmsFile.open(path)
    facts: dict[str, Any] = dict(file.properties)
    for group in file.groups():
        facts.update({f"{group.name}.{key}": value for key, value in group.properties.items()})
        for channel in group.channels():
            name = f"{group.name}.{channel.name}"
            is_text = channel.dtype.kind not in "biufM"
            found[name] = NoNumbers("holds no numbers", len(channel)) if is_text else _Channel(channel)
            facts.update({f"{name}@{key}": value for key, value in channel.properties.items()})
    segments, is_cut = _segments(path)
    text = (
        f"{path}: was written in {segments} parts. Its rate does not show whether there is a pause between "
    )
    text += "two parts; a column of times would."
    sheet = of_arrays(found, attributes=facts)
    notes = [Note("reading", text)] if segments > 1 and sheet.rates else []
    if is_cut:
        text = f"{path}: ends within its last part: the recorder was switched off, or the file is cut or "
        text += "damaged. The samples that are missing there are left out, and so are channels without any."
        notes.insert(0, Note("cut_recording", text))
    return replace(sheet, notes=tuple(notes))


class _Channel:
    """A channel of a TDMS file that can be read like an array.

    The channel's own scale is applied to the values.
    """

    def __init__(self, channel: Any) -> None:
        self._channel, self.shape = channel, (len(channel),)
        self.dtype = np.dtype("M8[us]") if channel.dtype.kind == "M" else np.dtype(np.float64)

    def __getitem__(self, rows: Any) -> Any:
        if not isinstance(rows, slice):
            return np.asarray(self._channel[:])[rows]
        return np.asarray(self._channel[rows])


def _segments(path: Path) -> tuple[int, bool]:
    """Return the number of segments (parts that were written one after the other) of a TDMS file.

    Also return whether the last one is cut off or was never finished.
    """
    count, at, size = 0, 0, path.stat().st_size
    with path.open("rb") as file:
        while len(head := file.read(_LEAD_IN.size)) == _LEAD_IN.size:
            magic, _, _, length, _ = _LEAD_IN.unpack(head)
            if magic != b"TDSm":
                return count, True
            count += 1
            at += _LEAD_IN.size + length
            if length == _STILL_WRITTEN or at > size:
                return count, True
            file.seek(at)
    return count, at < size
