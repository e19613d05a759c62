"""Stored recordings: files that are checked as a whole and then read in blocks of rows.

The whole file is checked before the first sample is used. So bad input causes one clear error (file, line,
reason) and no partial output.
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
"""Largest accepted angular rate [deg/s], far above any gyroscope's. A larger number shows a wrong unit."""

LONGEST_NAME, MOST_NAMES = 60, 30
"""An error message shows at most MOST_NAMES names from a file, and at most LONGEST_NAME characters of each.
"""

LARGEST_COUNT, LARGEST_NUMBER = 2.0**31, 2.0**53
"""The counts of a sensor's register are below LARGEST_COUNT. Up to LARGEST_NUMBER, a float represents each
whole number exactly.
"""

HOST_TOLERANCE = 0.05

AT_ONCE = 8192
"""Number of rows in a block."""


class Recording(NamedTuple):
    """Samples of a gyroscope, and of an accelerometer if there is one.

    `gyro`: (n, axes) in counts if `lsb_per_dps` is given, else in deg/s. `accel`: (n, 3) in counts, or None;
    `accel_lsb_per_g`: counts in 1 g. `accel_ms2`: (n, 3) in m/s², or None. `device_s`: (n,) time of each
    sample by the device's clock [s]. `host_s`: (n,) arrival times by the host's clock [s], or None if they
    were not recorded. `seq`: (n,) sequence number of each sample; None: the numbers can be derived from the
    times.
    `epoch`: (n,) number of the epoch (the samples between two restarts) that each sample belongs to.
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
    """A warning for the user about a recording. `kind`: kind of the `error` record that reports it."""

    kind: str
    text: str


class Stored(NamedTuple):
    """A recording that was checked as a whole and is read in blocks of rows.

    `blocks`: function that yields all rows; each call starts at the first row again. `start_unix_ns`: Unix
    time of the beginning [ns], 0 if unknown. `about`: further description of the recording, for people.
    `topic`: topic of a bag that was read, "" for other files. `reading`: the answers (columns, units, rate)
    by which the file was read, each with its evidence. `axes`: x, y or z for each gyroscope column; if empty,
    the columns are x, y, z in this order.
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
        """Return all samples in memory."""
        blocks = list(self.blocks())
        columns: dict[str, Any] = {}
        for name in ("gyro", "device_s", "host_s", "accel", "accel_ms2", "seq", "epoch"):
            parts = [getattr(block, name) for block in blocks]
            columns[name] = None if parts[0] is None else np.concatenate(parts)
        return blocks[0]._replace(**columns)


def check_span(path: Path, rate_hz: float, samples: int, span_s: float) -> None:
    """Raise UsageError if a recording's sampling rate or duration is impossible."""
    if not LOWEST_RATE_HZ <= rate_hz <= HIGHEST_RATE_HZ or span_s > LONGEST_S:
        raise UsageError(
            f"{path}: a rate of {rate_hz:.6g} Hz is no gyroscope's ({samples} samples over {span_s:.3g} s)."
        )


def listed(names: Sequence[str]) -> str:
    """Return names of columns or arrays as a list for a message."""
    known = [name if name.isprintable() and len(name) < LONGEST_NAME else shown(name) for name in names]
    return ", ".join(known[:MOST_NAMES]) + (f", … {len(known)} in all" if len(known) > MOST_NAMES else "")
