"""Tells whether numbers can be from a gyroscope or an accelerometer, or are of a wrong column or unit."""

import numpy as np

from fltea.recording.columns import Chosen
from fltea.recording.files import LARGEST_DPS
from fltea.recording.sample_times import Floats, Marks
from fltea.records.errors import Implausible

MOST_DPS = 4000.0
"""Largest plausible rate [deg/s]; gyroscopes in phones and for navigation have no wider range."""

ENOUGH_ROWS = 50
"""Numbers are judged only if there are at least this many rows."""


class Plausible:
    """Checks whether rates are possible for a gyroscope at rest.

    Rates in a wrong unit, or from a wrong column, are impossible.
    """

    def __init__(self, chosen: Chosen) -> None:
        self._chosen, self.rows = chosen, 0
        self._large = np.zeros(len(chosen.gyro), np.int64)
        self._rises: Marks = np.ones(len(chosen.gyro), np.bool_)
        self._last: Floats | None = None

    def add(self, gyro: Floats) -> None:
        self.rows += len(gyro)
        size, most = np.abs(gyro), MOST_DPS * (self._chosen.unit.lsb or 1.0)
        if size.max() > most:  # seldom true, so that the slow sum over rows is seldom needed
            self._large += (size > most).sum(axis=0)
        if self._rises.any():
            steps = np.diff(gyro, axis=0, prepend=gyro[:1] - 1.0 if self._last is None else self._last)
            self._rises &= (steps > 0).all(axis=0)
        self._last = gyro[-1:]

    def check(self, where: str) -> None:
        """Check all samples so far, if there are enough.

        Raises:
            Implausible: no gyroscope gives such numbers.
        """
        if self.rows < ENOUGH_ROWS:
            return
        chosen = self._chosen
        names = [chosen.names[place] for place in chosen.gyro]
        for name, rises, large in zip(names, self._rises, self._large, strict=True):
            if rises:
                raise Implausible(
                    f"{where}: column '{name}' rises from each of its {self.rows} rows to the next, as "
                    "times and counters do and no gyroscope at rest does. Name the axes with --columns."
                )
            if large > self.rows // 2:
                raise Implausible(
                    f"{where}: column '{name}' is beyond {MOST_DPS:g} deg/s in {large} of {self.rows} rows, "
                    f"read in the unit {chosen.unit.name}; no gyroscope at rest gives that. If it holds "
                    "counts, say how many counts are 1 deg/s by the data sheet, such as --units lsb:131. If "
                    "it holds thousandths of deg/s, say --units mdps."
                )


def is_of_sensor(values: Floats) -> Marks:
    """Mark the rows whose numbers, in deg/s or m/s², are possible for a sensor. Rows with NaN get no mark."""
    good = np.abs(values) <= LARGEST_DPS
    return np.ones(len(values), np.bool_) if good.all() else np.asarray(good.all(axis=1))
