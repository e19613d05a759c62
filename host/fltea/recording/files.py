"""Recording files that are one file: .npz and CSV, each a `Stored`, read a block of rows at a time.

A file is checked as a whole before its first sample goes out, so that bad input gives one clear error (file,
line, reason) and no half of an output.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.recording.raw_lines import shown
from fltea.recording.reading import Answer
from fltea.recording.sample_times import LONGEST_S
from fltea.recording.session import HIGHEST_RATE_HZ, LOWEST_RATE_HZ
from fltea.records.errors import UsageError

TIME_COLUMN = "time_s"
LARGEST_DPS = 1e6
"""Hundreds of times what any gyroscope measures; beyond it the unit is wrong, and squares overflow."""

LONGEST_NAME, MOST_NAMES = 60, 30
"""How much of what a file says of itself goes into a message."""

LARGEST_COUNT, LARGEST_NUMBER = 2.0**31, 2.0**53
"""Of a sensor's register, and what a float tells from its neighbours."""

HOST_TOLERANCE = 0.05

AT_ONCE = 8192
"""Rows of a block."""


class Recording(NamedTuple):
    """A resting gyroscope, as recorded.

    gyro: (n, axes) counts where lsb_per_dps is given, else deg/s.
    accel: (n, 3) counts or None, accel_lsb_per_g their scale. accel_ms2: (n, 3) m/s² or None, where there are
    no counts. device_s: (n,) time of each sample by the device's clock.
    host_s: (n,) arrival times by the host's clock, or None where they were not recorded.
    seq: (n,) number of each sample, or None: then the times number them. epoch: (n,) number of the epoch.
    """

    gyro: NDArray[np.float64]
    rate_hz: float
    device_s: NDArray[np.float64]
    lsb_per_dps: float | None = None
    host_s: NDArray[np.float64] | None = None
    accel: NDArray[np.float64] | None = None
    seq: NDArray[np.int64] | None = None
    epoch: NDArray[np.int64] | None = None
    accel_lsb_per_g: float | None = None
    accel_ms2: NDArray[np.float64] | None = None


class Note(NamedTuple):
    """What whoever uses a recording has to be told. kind: of an `error` record."""

    kind: str
    text: str


class Stored(NamedTuple):
    """A recording that was checked as a whole and is read a block of rows at a time.

    blocks: gives all its rows again, each time it is called. start_unix_ns: when it begins; 0: not known.
    about: what else it says of itself, for a person. topic: of a bag, "" of other files. reading: how it was
    understood. axes: of the gyroscope, x, y or z each; none: the first ones.
    """

    samples: int
    rate_hz: float
    lsb_per_dps: float | None
    accel_lsb_per_g: float | None
    blocks: Callable[[], Iterator[Recording]]
    notes: tuple[Note, ...] = ()
    start_unix_ns: int = 0
    about: str = ""
    topic: str = ""
    reading: tuple[Answer, ...] = ()
    axes: tuple[str, ...] = ()

    def whole(self) -> Recording:
        """All of it in memory."""
        blocks = list(self.blocks())
        columns: dict[str, Any] = {}
        for name in ("gyro", "device_s", "host_s", "accel", "accel_ms2", "seq", "epoch"):
            parts = [getattr(block, name) for block in blocks]
            columns[name] = None if parts[0] is None else np.concatenate(parts)
        return blocks[0]._replace(**columns)


def check_span(path: Path, rate_hz: float, samples: int, span_s: float) -> None:
    """Raise UsageError for a rate, or a time from the first sample to the last, that no gyroscope has."""
    if not LOWEST_RATE_HZ <= rate_hz <= HIGHEST_RATE_HZ or span_s > LONGEST_S:
        raise UsageError(
            f"{path}: a rate of {rate_hz:.6g} Hz is no gyroscope's ({samples} samples over {span_s:.3g} s)."
        )


def listed(names: Sequence[str]) -> str:
    """Names of columns or arrays, for a message."""
    known = [name if name.isprintable() and len(name) < LONGEST_NAME else shown(name) for name in names]
    return ", ".join(known[:MOST_NAMES]) + (f", … {len(known)} in all" if len(known) > MOST_NAMES else "")
