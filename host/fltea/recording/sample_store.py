"""Collects the samples of a recording that another program made.

The samples are kept in temporary files, so that the memory is limited.

Samples of tables and of bags are collected in the same way. The modules `table` and `bag_gather` decide which
rows or messages are samples, and when the samples were taken.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fltea.recording.columns import Chosen
from fltea.recording.files import AT_ONCE
from fltea.recording.npz_arrays import NUMBER_BYTES
from fltea.recording.plausible import Plausible, is_of_sensor
from fltea.recording.sample_times import Floats, Marks
from fltea.recording.spool import Spool
from fltea.settings.limits import Limits


class BadAccel:
    """Counts samples whose acceleration is missing, or beyond what sensors give.

    `first`: position of the first such sample in words, or None.
    """

    def __init__(self) -> None:
        self.count = 0
        self.first: str | None = None

    def add(self, accel: Floats, place: Callable[[int], str]) -> None:
        """Count the accelerations (n, 3) that are missing, or beyond what sensors give.

        `place`: as for `SampleStore.add`.
        """
        good = is_of_sensor(accel)
        if not good.all():
            self.count += int(np.count_nonzero(~good))
            self.first = self.first or place(int(np.argmax(~good)))


class SampleStore:
    """The samples that have been collected. `len` of a store is the number of these samples.

    `chosen`: the columns that are read, for messages. `numbers`: how many numbers are stored for each sample.

    `spool`: the stored columns. These are `gyro` and `accel`, with numbers as in the file or scaled, and the
    columns that the caller of `add` names.
    `plausible`: checks whether a gyroscope can have given the rates. `bad_accel`: counts the samples whose
    acceleration is missing or impossible. `moving`: those of the columns `gyro` and `accel` that had a value
    other than 0. `is_whole`: whether all rates are whole numbers.
    """

    def __init__(self, chosen: Chosen, numbers: int, limits: Limits) -> None:
        self.spool = Spool()
        self.plausible = Plausible(chosen)
        self.bad_accel = BadAccel()
        self.moving: set[str] = set()
        self.is_whole = True
        self._limits, self._row_bytes = limits, numbers * NUMBER_BYTES

    def __len__(self) -> int:
        return self.spool.length("gyro")

    def add(
        self,
        gyro: Floats,
        accel: Floats | None,
        others: Mapping[str, NDArray[Any]],
        place: Callable[[int], str],
        factor: float = 1.0,
    ) -> None:
        """Add samples, at least one.

        `factor`: factor that converts the rates to deg/s or counts. `place`: function that returns the
        position of one of these samples in words, by its index.

        Raises:
            UsageError: there are more samples than the limits allow.
        """
        fits = self._limits.whole_bytes // self._row_bytes - len(self)
        if len(gyro) > fits:
            raise self._limits.whole_too_large(place(fits), (len(self) + fits + 1) * self._row_bytes)
        self.plausible.add(gyro * factor if factor != 1.0 else gyro)
        self.is_whole = self.is_whole and bool((gyro == np.rint(gyro)).all())
        columns = {"gyro": gyro, **({} if accel is None else {"accel": accel}), **others}
        for name in ("gyro", "accel"):
            if name in columns and name not in self.moving and columns[name].any():
                self.moving.add(name)
        if accel is not None:
            self.bad_accel.add(accel, place)
        for name, values in columns.items():
            self.spool.append(name, values)

    def keep(self, columns: Sequence[str], kept: Iterable[Marks]) -> None:
        """Keep only some samples, and of these only `columns`.

        `kept`: for each block of `AT_ONCE` samples, an array that is True for the samples to keep.
        """
        before, self.spool = self.spool, Spool()
        for values, keep in zip(before.blocks(columns, AT_ONCE), kept, strict=True):
            for name, column in zip(columns, values, strict=True):
                self.spool.append(name, column[keep])
        before.close()
