"""Reads ASAM MDF files of measurements in vehicles: groups of channels, each group with its own clock."""

import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from fltea.recording.readers.arrays import of_arrays
from fltea.recording.sample_times import Floats
from fltea.recording.sheet import Sheet
from fltea.records.errors import UsageError


def read(path: Path, _: str) -> Sheet:
    """Read the channels of all groups as they were measured, without resampling to another clock."""
    from asammdf import MDF
    from asammdf.blocks import mdf_v3, mdf_v4

    # asammdf would write temporary files, but this reader process is not allowed to
    for module in (mdf_v3, mdf_v4):
        vars(module)["NamedTemporaryFile"] = lambda **_: io.BytesIO()
    found: dict[str, Any] = {}
    units: dict[str, str] = {}
    with MDF(path) as file:
        groups_of_file: list[Any] = file.groups
        for number, group in enumerate(groups_of_file):
            name = (group.channel_group.acq_name or f"group{number}").replace(".", "_")
            name = f"{name}_{number}" if any(known.startswith(f"{name}.") for known in found) else name
            for index, channel in enumerate(group.channels):
                is_clock = index == file.masters_db.get(number)
                label = f"{name}.{'time' if is_clock else channel.name.replace('.', '_')}"
                label = f"{label}#{index}" if label in found else label
                found[label], units[label] = _values(file, number, index)
    sheet = of_arrays(found, units)
    groups, blocks = [array.partition(".")[0] for array in sheet.arrays], sheet.blocks

    def of_one_clock(places: Sequence[int]) -> Iterator[Floats]:
        used = sorted({groups[place] for place in places})
        if len(used) > 1:
            raise UsageError(
                f"the columns that are read belong to the groups {', '.join(used)}, and each group has a "
                "clock of its own. Name columns of one group with --columns."
            )
        return blocks(places)

    return replace(sheet, blocks=of_one_clock)


def _values(file: Any, group: int, index: int) -> tuple[Any, str]:
    """Return the numbers of a channel, with NaN in place of invalid numbers, and the unit of the channel."""
    signal = file.get(group=group, index=index, ignore_invalidation_bits=True)
    values, invalid = signal.samples, signal.invalidation_bits
    if invalid is not None and values.dtype.kind in "biuf" and values.ndim == 1:
        values = np.where(np.asarray(invalid, bool), np.nan, values)
    return values, signal.unit or ""
