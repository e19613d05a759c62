"""Which columns are meant, in which units, by which clock, of which sensor.

A reading, with its evidence (pure).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fltea.recording.contradictions import check_clock, check_gravity
from fltea.recording.dialects import Facts, dialect_of
from fltea.recording.evidence import Choice
from fltea.recording.files import Note
from fltea.recording.reading import Answer
from fltea.recording.sample_times import TimeColumn
from fltea.recording.wanted import Wanted, wanted_of
from fltea.recording.which_accelerometer import choose_accelerometer
from fltea.recording.which_sensor import choose_sensor
from fltea.recording.which_unit import choose_unit
from fltea.records.errors import UsageError
from fltea.settings.how import How, TimeUnit

NOTHING = Facts()


@dataclass(frozen=True)
class Chosen:
    """What to read: places from 0 of the axes and of the times (None without), and what they are counted in.

    axes: of the places in `gyro`, x, y or z. units: as `--units` takes them. factor, lsb: as of
    `parse_units`. time_unit: None if nothing says it. time_factor: of that unit, for 1 in the column. accel:
    places of the accelerometer's axes x, y, z, or none; accel_ms2: m/s² in one of their unit. fine: place of
    what is added to whole seconds, fine_s: seconds in one of its unit. rate_hz: the rate that is given or
    stated; is_given: by the user. sensor: place of the column that tells several sensors apart, and the value
    of the one that is read, None: the only one. turn: of several sensors in turns which one, and of how many.
    answers: the reading so far. notes: what the user has to know.
    """

    names: list[str]
    gyro: tuple[int, ...]
    time: int | None
    units: str
    factor: float
    lsb: float | None
    time_unit: TimeUnit | None
    accel: tuple[int, ...] = ()
    accel_ms2: float = 1.0
    fine: int | None = None
    fine_s: float = 0.0
    axes: tuple[str, ...] = ("x", "y", "z")
    time_factor: float = 1.0
    rate_hz: float | None = None
    is_given: bool = False
    overrule: bool = False
    sensor: tuple[int, str | None] | None = None
    turn: tuple[int, int] = (0, 1)
    answers: tuple[Answer, ...] = ()
    notes: tuple[Note, ...] = ()

    @cached_property
    def time_name(self) -> str:
        """The column of times."""
        return "" if self.time is None else self.names[self.time]

    @cached_property
    def times(self) -> TimeColumn:
        """The same as a column of times."""
        return TimeColumn(
            self.time_name, self.time_unit, self.rate_hz, self.is_given, self.overrule, self.time_factor
        )

    @cached_property
    def needed(self) -> tuple[int, ...]:
        """Without which a row is no sample: the axes, then the times."""
        return tuple(place for place in (*self.gyro, self.time, self.fine) if place is not None)

    @cached_property
    def time_at(self) -> int | None:
        """Where the times stand among the columns that are read."""
        return None if self.time is None else len(self.gyro)

    @cached_property
    def places(self) -> tuple[int, ...]:
        """All that is read as numbers."""
        return (*self.needed, *self.accel)

    def scale(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Numbers of the columns that are read, (n, places): in place to deg/s or counts, and m/s²."""
        with np.errstate(over="ignore", invalid="ignore"):
            axes = len(self.gyro)
            values[:, :axes] *= self.factor
            if self.time is not None and self.time_factor != 1.0:
                values[:, axes] *= self.time_factor
            if self.fine is not None:
                values[:, axes] += values[:, axes + 1] * self.fine_s
            if self.accel:
                values[:, len(self.needed) :] *= self.accel_ms2
        return values

    @cached_property
    def read(self) -> list[str]:
        """The names at these places."""
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
    """Find what is meant.

    where: for messages, the file and, where there is one, the line of the names. names: of all columns; None:
    they have none, and there are `width`. units: of each, where a line of them follows the names. tag: the
    first field of a row, of files with rows of several kinds.

    Raises:
        NotStated: a fact has no evidence; the text asks for it, with what each candidate would mean.
        UsageError: a column is not there, or twice, or two pieces of evidence contradict each other.
    """
    wanted = wanted_of(how)
    dialect = dialect_of(names or (), facts, tag=tag, fields=width)
    if dialect is not None and dialect.unread:
        raise UsageError(f"{where}: is of {dialect.name}: {dialect.unread}")
    labels, names = _labels(where, names, width, wanted)
    found = Choice(where, labels, names, list(units or ()), wanted, how, facts, dialect)
    gyro, axes = found.gyro()
    sensor = choose_sensor(found, tag, gyro)
    unit, factor, lsb = choose_unit(found, gyro)
    time, unit_of_time, time_factor, fine, fine_s = found.clock(gyro)
    rate_hz = found.rate(time)
    if found.missing:
        raise found.error(
            gyro, rate_hz or (None if time is None else found.measured_hz(time, unit_of_time, time_factor))
        )
    check_clock(found, time, unit_of_time, time_factor, (fine, fine_s))
    accel, accel_ms2 = choose_accelerometer(found, {*gyro, time})
    check_gravity(found, gyro, factor / (lsb or 1.0), accel, accel_ms2)
    if dialect is not None and dialect.note:
        found.notes.append(Note("reading", f"{where}: {dialect.name}: {dialect.note}"))
    return Chosen(
        list(names),
        gyro,
        time,
        unit,
        factor,
        lsb,
        unit_of_time,
        accel,
        accel_ms2,
        fine,
        fine_s,
        axes,
        time_factor,
        rate_hz,
        how.rate_hz is not None,
        how.overrule,
        sensor,
        found.turn,
        tuple(found.answers),
        tuple(found.notes),
    )


def check_sensors(where: str, chosen: Chosen, how: How, facts: Facts) -> None:
    """Look once more for several sensors, as live text has shown more of its rows.

    Raises:
        NotStated: a column tells several apart.
    """
    found = Choice(where, chosen.names, chosen.names, [], wanted_of(how), how, facts, None)
    choose_sensor(found, "", chosen.gyro)
    if found.missing:
        raise found.error(chosen.gyro, None)


def _labels(
    where: str, names: Sequence[str] | None, width: int, wanted: Wanted
) -> tuple[list[str], Sequence[str]]:
    """Return what the user may call the columns, and their names.

    Without names these are positions from 1.
    """
    positions = [str(place + 1) for place in range(width)]
    if wanted.columns is None and wanted.time is None:
        return list(names or positions), names or positions
    if names is not None and all(name in names for name in wanted.names):
        return list(names), names
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
