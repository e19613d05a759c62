"""Chooses the columns to read, their units, the clock and the sensor, each with its evidence."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.recording.contradictions import check_clock, check_gravity
from fltea.recording.dialects import Dialect, Facts, dialect_of
from fltea.recording.evidence import Choice
from fltea.recording.files import Note
from fltea.recording.reading import Answer
from fltea.recording.sample_times import ClockColumns, TimeColumn
from fltea.recording.split_times import MOST_OF
from fltea.recording.wanted import Wanted, wanted_of
from fltea.recording.which_accelerometer import choose_accelerometer
from fltea.recording.which_sensor import choose_sensor
from fltea.recording.which_unit import Unit, choose_unit
from fltea.records.errors import UsageError
from fltea.settings.how import How

NOTHING = Facts()

IMPOSSIBLE = 1e300
"""Time of a row whose fraction of a second is none, since it is negative or more than a second, or whose
minutes or hours are none.
"""


class StatedRate(NamedTuple):
    """The sampling rate that the user or the file states, None if neither does.

    `is_given`: whether the user states it. `overrule`: whether the user wants the options to be used even if
    the times contradict them.
    """

    hz: float | None = None
    is_given: bool = False
    overrule: bool = False


NO_TIMES, NO_RATE = ClockColumns(), StatedRate()


@dataclass(frozen=True)
class Chosen:
    """The columns to read, as indices from 0, and their units.

    `gyro`: columns of the axes. `axes`: the letter x, y or z of each axis. `unit`: unit of the rates.
    `clock`: columns of the times. `accel`: columns of the accelerometer's axes x, y, z, or empty.
    `accel_ms2`: unit of these columns [m/s²].
    `sensor`: column that distinguishes sensors, and its value for the sensor to read. The value is None if
    only one occurs. `turn`: for sensors whose rows alternate, the index of the one to read, and the number of
    sensors. `answers`: the choices so far, each with its evidence. `notes`: warnings for the user.
    """

    names: list[str]
    gyro: tuple[int, ...]
    unit: Unit
    clock: ClockColumns = NO_TIMES
    accel: tuple[int, ...] = ()
    accel_ms2: float = 1.0
    axes: tuple[str, ...] = ("x", "y", "z")
    rate: StatedRate = NO_RATE
    sensor: tuple[int, str | None] | None = None
    turn: tuple[int, int] = (0, 1)
    answers: tuple[Answer, ...] = ()
    notes: tuple[Note, ...] = ()

    @property
    def time(self) -> int | None:
        """Column of times, None if there is none."""
        return self.clock.time

    def without_times(self) -> "Chosen":
        """Return the choice without the columns of times."""
        return replace(self, clock=self.clock._replace(time=None, fine=None, coarse=()))

    @cached_property
    def time_name(self) -> str:
        """Name of the column of times, "" if there is none; names of all if several say the time."""
        places = (*reversed([place for place, _ in self.clock.coarse]), self.time, self.clock.fine)
        return " + ".join(self.names[k] for k in places if k is not None)

    @cached_property
    def times(self) -> TimeColumn:
        """The column of times with its unit and the user's options about it."""
        is_of_one = any(one.question == "sensor" and one.evidence == "given" for one in self.answers)
        return TimeColumn(self.time_name, self.clock.unit, *self.rate, self.clock.factor, is_of_one)

    @cached_property
    def needed(self) -> tuple[int, ...]:
        """Columns in which every sample must have a number: the axes, then the times."""
        coarse = (place for place, _ in self.clock.coarse)
        return tuple(
            place for place in (*self.gyro, self.time, self.clock.fine, *coarse) if place is not None
        )

    @cached_property
    def time_at(self) -> int | None:
        """Index of the column of times among the columns that are read; None if there is none."""
        return None if self.time is None else len(self.gyro)

    @cached_property
    def places(self) -> tuple[int, ...]:
        """All columns that are read as numbers: the columns of `needed`, then the accelerometer's."""
        return (*self.needed, *self.accel)

    def scale(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Convert the values read (n, columns) in place: rates to deg/s or counts, accelerations to m/s²."""
        with np.errstate(over="ignore", invalid="ignore"):
            axes, clock = len(self.gyro), self.clock
            values[:, :axes] *= self.unit.factor
            if clock.time is not None and clock.factor != 1.0:
                values[:, axes] *= clock.factor
            if clock.fine is not None:
                fine_s = values[:, axes + 1] * clock.fine_s
                values[:, axes] += np.where((fine_s < 0) | (fine_s > 1), IMPOSSIBLE, fine_s)
            for k, (_, unit_s) in enumerate(clock.coarse, len(self.needed) - len(clock.coarse)):
                number = values[:, k]
                is_one = (number >= 0) & (number < MOST_OF[unit_s]) & (number == np.rint(number))
                values[:, axes] += np.where(is_one, number * unit_s, IMPOSSIBLE)
            if self.accel:
                values[:, len(self.needed) :] *= self.accel_ms2
        return values

    @cached_property
    def read(self) -> list[str]:
        """Names of the columns that are read."""
        return [self.names[place] for place in self.places]


def choose(
    where: str,
    names: Sequence[str] | None,
    units: Sequence[str] | None,
    width: int,
    how: How,
    facts: Facts = NOTHING,
    tag: str = "",
) -> Chosen:
    """Choose the columns to read, by their names, the user's options, the file's facts and the first rows.

    `where`: file and line of the names, for messages. `names`: names of all columns, None if the file has no
    names but only `width` columns. `units`: unit of each column, if a row of units follows the names. `tag`:
    first field of the rows to read, in files with rows of several kinds.

    Raises:
        NotStated: nothing states a fact that is needed. The message asks for it and shows what each candidate
            would mean.
        UsageError: a column is missing or ambiguous, or two pieces of evidence contradict each other.
    """
    wanted = wanted_of(how)
    dialect = _dialect(where, names, width, facts, tag)
    labels, names = _labels(where, names, width, wanted)
    found = Choice(where, labels, names, list(units or ()), wanted, how, facts, dialect)
    gyro, axes = found.gyro()
    sensor = choose_sensor(found, tag, gyro)
    unit = choose_unit(found, gyro)
    clock = found.clock(gyro)
    rate_hz = found.rate(clock.time)
    if found.asked.missing:
        raise found.error(gyro, rate_hz or found.measured_hz(clock))
    check_clock(found, clock)
    accel, accel_ms2 = choose_accelerometer(found, {*gyro, clock.time})
    check_gravity(found, gyro, unit.factor / (unit.lsb or 1.0), accel, accel_ms2)
    if dialect is not None and dialect.note:
        found.notes.append(Note("reading", f"{where}: {dialect.name}: {dialect.note}"))
    return Chosen(
        list(names),
        gyro,
        unit,
        clock,
        accel,
        accel_ms2,
        axes,
        StatedRate(rate_hz, how.rate_hz is not None, how.overrule),
        sensor,
        found.turn,
        tuple(found.answers),
        tuple(found.notes),
    )


def _dialect(where: str, names: Sequence[str] | None, width: int, facts: Facts, tag: str) -> Dialect | None:
    dialect = dialect_of(names or (), facts, tag=tag, fields=width)
    if dialect is not None and dialect.unread:
        raise UsageError(f"{where}: is of {dialect.name}: {dialect.unread}")
    return dialect


def check_sensors(where: str, chosen: Chosen, how: How, facts: Facts) -> None:
    """Check once more for several sensors in a live text, after more rows have arrived.

    Raises:
        NotStated: a column distinguishes several sensors.
    """
    found = Choice(where, chosen.names, chosen.names, [], wanted_of(how), how, facts, None)
    choose_sensor(found, "", chosen.gyro)
    if found.asked.missing:
        raise found.error(chosen.gyro, None)


def _labels(
    where: str, names: Sequence[str] | None, width: int, wanted: Wanted
) -> tuple[list[str], Sequence[str]]:
    """Return the labels by which the user may name the columns, and the columns' names.

    A column without a name has its position, counted from 1, as its label.
    """
    positions = [str(place + 1) for place in range(width)]
    if wanted.columns is None and wanted.time is None:
        return list(names or positions), names or positions
    if names is not None and (labels := wanted.labels(names)) is not None:
        return labels, names
    if all(name.isdecimal() for name in wanted.names):
        beyond = [name for name in wanted.names if not 1 <= int(name) <= width]
        if beyond:
            raise UsageError(f"{where}: no column {', '.join(beyond)} (it has {width}).")
        return positions, names if names is not None and len(names) == width else positions
    if names is None and wanted.columns is not None and wanted.time is None and width == len(wanted.columns):
        return wanted.columns, wanted.columns
    if names is None:
        raise UsageError(
            f"{where}: the {width} columns have no names; say which are the axes by their positions, from 1."
        )
    raise UsageError(f"{where}: {wanted.lacking(names)}.")
