"""Finds what a file's columns hold and in which units, with the evidence, and which facts are missing."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fltea.recording import candidates
from fltea.recording.column_names import (
    axes_in_units,
    axis_of,
    common_beginning,
    counts_unknown,
    is_time,
    states_units,
    time_scale_of,
    times_in,
    unit_in,
)
from fltea.recording.dialects import Dialect, Facts, columns_of, nearest
from fltea.recording.files import TIME_COLUMN, Note, listed
from fltea.recording.reading import (
    Answer,
    Evidence,
    Missing,
    Question,
    given_options,
    not_stated,
    says_otherwise,
)
from fltea.recording.sample_times import EVEN_SHARE, EVENNESS, PLAUSIBLE_HZ, ClockColumns, Floats
from fltea.recording.split_times import SplitTimes, split_times
from fltea.recording.text_head import stated_in
from fltea.recording.text_labels import units_beside
from fltea.recording.timing import rate_of
from fltea.recording.units import (
    time_scale,
    time_unit,
)
from fltea.recording.wanted import Wanted
from fltea.records.errors import UsageError
from fltea.settings.how import How, TimeUnit

PREFERRED_TIMES = (
    lambda name: name == "seconds_elapsed",  # phones write elapsed seconds in addition to the time of day
    lambda name: name.endswith("header.stamp"),  # `rostopic echo -p` writes this name
    lambda name: name not in ("date", "datum"),  # a file may have a date in addition to a time of day
)
"""Rules that choose between several columns of times; the first rule that a column satisfies decides."""

_TWO_FIELDS = re.compile(r"(\d+)\+(\d+)")
"""Matches a dialect's `time` such as `1+2`: positions of a column of seconds and of one of nanoseconds."""

ENOUGH = 10
"""A column without a number in the first rows is taken as empty if there are at least this many first rows.
"""


@dataclass
class Asked:
    """What the user is asked. `missing`: the facts that nothing states. `tables`: what helps to answer.

    `rows`: sentence that says which sensor's rows the other tables show, "" if they show all rows.
    """

    missing: list[Missing] = field(default_factory=list)
    tables: list[str] = field(default_factory=list)
    rows: str = ""


class Choice:
    """The answers about a file's columns so far, and the facts that are still missing.

    `labels`: names by which the user may name the columns in options.
    """

    def __init__(
        self,
        where: str,
        labels: list[str],
        names: Sequence[str],
        units: list[str],
        wanted: Wanted,
        how: How,
        facts: Facts,
        dialect: Dialect | None,
    ) -> None:
        self.where, self.labels, self.names, self.wanted, self.how = where, labels, list(names), wanted, how
        self.facts, self.dialect = facts, dialect
        self.units = [*units, *[""] * (len(self.names) - len(units))]
        self.answers: list[Answer] = []
        self.notes: list[Note] = []
        self.asked = Asked()
        self.turn = (0, 1)
        self.state_units()

    @property
    def by_dialect(self) -> Evidence:
        """Kind of evidence: a mere "convention" if other loggers use the dialect's names for other units."""
        return "convention" if self.dialect is not None and self.dialect.convention else "dialect"

    def answer(self, question: Question, value: str, evidence: Evidence, why: str) -> None:
        """Add an answer about the columns with its evidence."""
        self.answers.append(Answer(question, value, evidence, why))

    def state_units(self) -> None:
        """Take units from columns of texts, such as `gyro_unit`, if all rows of such a column are equal."""
        columns = {
            name: {*self.facts.cells(k)} - {""} for k, name in enumerate(self.names) if states_units(name)
        }
        texts = {name: next(iter(found)) for name, found in columns.items() if len(found) == 1}
        said = units_beside({**dict.fromkeys(self.names), **texts}) if texts else []
        units = dict(zip(dict.fromkeys([*self.names, *texts]), said, strict=False))
        self.units = [unit or units.get(name, "") for name, unit in zip(self.names, self.units, strict=True)]

    def first_rows(self) -> Floats | None:
        """Return the numbers in the first rows (n, width); None if they are not available for all columns."""
        values = self.facts.sample()
        return values if values.ndim == 2 and values.shape[1] == len(self.names) else None

    def gyro(self) -> tuple[tuple[int, ...], tuple[str, ...]]:
        """Return the columns of the gyroscope's axes, and the letter of each axis.

        If they are unknown, add a question for the user.
        """
        names = self.names
        if self.wanted.columns is not None:
            gyro = tuple(self.labels.index(name) for name in self.wanted.columns)
            self._check_twice(gyro)
            letters = [axis_of(names[place], self.units[place]) for place in gyro]
            known = None not in letters and len({*letters}) == len(letters)
            axes = tuple(str(one) for one in letters) if known else tuple("xyz"[: len(gyro)])
            self.answer("columns", _as_axes(names, gyro, axes), "given", "--columns")
            return gyro, axes
        if self.dialect is not None and (gyro := columns_of(self.dialect.gyro, names)):
            self.answer("columns", _as_axes(names, gyro, "xyz"), self.by_dialect, self.dialect.name)
            return gyro, ("x", "y", "z")
        found = axes_of(names, self.units)
        if found:
            gyro = tuple(found.values())
            self.answer("columns", _as_axes(names, gyro, tuple(found)), "stated", "their names")
            return gyro, tuple(found)
        self.asked.missing.append(Missing("which columns are the gyroscope's axes", "--columns ?,?,?"))
        return (), ()

    def _check_twice(self, places: Sequence[int]) -> None:
        for name in (self.labels[place] for place in places):
            if self.labels.count(name) > 1:
                raise UsageError(
                    f"{self.where}: {self.labels.count(name)} columns are called {name}, and which is meant "
                    "is not known. Give them different names, or say their positions: --columns 1,2,3."
                )

    def scale(self, name: str) -> float | None:
        """Return the factor that the lines before the column names give for `name`; 1 if `name` is empty.

        The result is None if these lines give no positive number for `name`.
        """
        scale = self.facts.number(name) if name else 1.0
        return scale if scale is not None and math.isfinite(scale) and scale > 0 else None

    def is_of_dialect(self, gyro: Sequence[int]) -> bool:
        """Return whether the file's dialect describes these columns of the gyroscope's axes."""
        if self.dialect is None:
            return False
        if not self.dialect.gyro:
            return True
        names = [self.names[place] for place in gyro]
        return any(
            all(any(re.fullmatch(pattern, name) for pattern in triple) for name in names)
            for triple in self.dialect.gyro
        )

    def check_names_against_units(
        self,
        places: Sequence[int],
        in_name: Callable[[str], object],
        in_unit: Callable[[str], object],
        flag: str,
    ) -> None:
        """Raise UsageError if a column's name and its unit contradict each other.

        `in_name`, `in_unit`: functions that return the unit in a name, and in a text beside the name. `flag`:
        option that the message names.
        """
        for place in places if not self.how.overrule else ():
            name, unit = self.names[place], self.units[place]
            by_name, beside = in_name(name), in_unit(unit)
            if None not in (by_name, beside) and by_name != beside:
                raise UsageError(
                    f"{self.where}: {listed([name])} is in {unit_in(name) or by_name} by its name, and in "
                    f"{unit} by the unit beside it. Say which is right: {flag} ? --overrule"
                )

    def clock(self, gyro: Sequence[int]) -> ClockColumns:
        """Find the column of times and its unit."""
        place, by_dialect = self._time_column(gyro)
        given, factor = self.how.time_unit, 1.0
        if place is None:
            return ClockColumns(unit=given)
        for whole, fine, fine_s, coarse in self.split.found if given in (None, "s") else ():
            if place in (whole, fine):
                return ClockColumns(whole, "s", 1.0, fine, fine_s, coarse)
        if by_dialect and self.dialect is not None and given in (None, "s"):
            for two in map(_TWO_FIELDS.fullmatch, self.dialect.time):
                if two is not None and two[1] == self.names[place]:
                    return ClockColumns(place, "s", 1.0, self.names.index(two[2]), 1e-9)
        is_free = self.wanted.time is None and self.how.rate_hz is None
        if is_free and place in [pair.whole for pair in self.split.doubtful]:
            part = listed([self.names[self.split.doubtful[0].fine]])
            what = f"the times: by its values {part} is a fraction of {listed([self.names[place]])}, "
            self.asked.missing.append(Missing(f"{what}but not in the unit of its name", "--time-column ?"))
            return ClockColumns(place, given)
        self.check_names_against_units([place], time_scale_of, time_scale, "--time-unit")
        name, beside = self.names[place], self.units[place]
        stated = time_scale(beside) or time_scale_of(name)
        if given is not None and stated is not None and (given, 1.0) != stated and not self.how.overrule:
            in_file = stated[0] if stated[1] == 1.0 else beside or unit_in(name)
            fact = f"the column {listed([name])} is in {in_file} by its name or line of units"
            raise says_otherwise(self.where, fact, "--time-unit", given)
        unit: TimeUnit | None = given
        if given is None and stated is not None:
            unit, factor = stated
        dialect = self.dialect
        if unit is None and by_dialect and dialect is not None and dialect.time_unit:
            if (scale := self.scale(dialect.time_scale)) is None:
                self._ask_clock(place, f"the unit of {listed([self.names[place]])}")
            else:
                unit, factor = time_unit(dialect.time_unit), dialect.time_ticks * scale
        if unit is None and self.how.rate_hz is None and (what := counts_unknown(name, beside)):
            self._ask_clock(
                place, f"what the times of {listed([name])} count (the file says {listed([what])})"
            )
        elif unit is None and self.how.rate_hz is None:
            step = self._step(place)
            if step is not None and not PLAUSIBLE_HZ[0] <= 1 / step <= PLAUSIBLE_HZ[1]:
                self._ask_clock(place, f"what the times of {listed([name])} count")
        return ClockColumns(place, unit, factor)

    @cached_property
    def split(self) -> SplitTimes:
        """Pairs of columns that say the time together, as whole seconds and their fraction."""
        return split_times(self.names, self.first_rows())

    def _ask_clock(self, place: int, what: str) -> None:
        self.asked.missing.append(Missing(what, "--time-unit ?"))
        step = self._step(place)
        if step is not None and (units := candidates.times_table(step)):
            self.asked.tables.append(candidates.ticks_table(step, units))

    def _step(self, place: int) -> float | None:
        """Return the median step between the first times in a column; None if the steps are uneven."""
        values = self.facts.sample()
        if values.ndim != 2 or values.shape[1] <= place or len(values) < ENOUGH:
            return None
        steps = np.diff(values[:, place][np.isfinite(values[:, place])])
        steps = steps[steps != 0]
        step = float(np.median(steps)) if len(steps) else 0.0
        is_even = step > 0 and float((np.abs(steps / step - 1) <= EVENNESS).mean()) >= EVEN_SHARE
        return step if is_even else None

    def _time_column(self, gyro: Sequence[int]) -> tuple[int | None, bool]:
        """Return the column of times (None if there is none), and whether the dialect describes it."""
        names = self.names
        dialect, near = self.dialect, common_beginning([names[place] for place in gyro])
        of_dialect = [
            place
            for pattern in (dialect.time if dialect is not None else ())
            for place in columns_of([[_TWO_FIELDS.sub(r"\1", pattern)]], names, near)
            if not self._is_empty(place)
        ]
        if self.wanted.time is not None:
            place = self.labels.index(self.wanted.time)
            self._check_twice([place])
            return place, place in of_dialect
        if of_dialect:
            return of_dialect[0], True
        if pairs := self.split.found:
            return pairs[0].whole, False
        if self.split.doubtful and self.how.rate_hz is None:
            return self.split.doubtful[0].whole, False
        none = dialect.no_time if dialect is not None else ()
        left = [
            place
            for place, name in enumerate(names)
            if place not in gyro
            and not self._is_empty(place)
            and not any(re.fullmatch(pattern, name) for pattern in none)
        ]
        named = times_in([names[k] for k in left])
        found = [k for k in left if names[k] == TIME_COLUMN] or [k for k in left if names[k] in named]
        found = nearest(found, names, near)
        for sort in PREFERRED_TIMES if len(found) > 1 else ():
            found = [k for k in found if sort(names[k].lower())] or found
        if len(found) > 1 and self.how.rate_hz is None:
            self.asked.missing.append(
                Missing(
                    f"which column has the times ({listed([names[k] for k in found])})", "--time-column ?"
                )
            )
        return (found[0] if found else None), False

    def _is_empty(self, place: int) -> bool:
        """Return whether a column has no number in the first rows; False if these are too few to tell."""
        values = self.first_rows()
        least = 1 if self.stated_rates() else ENOUGH
        if values is None or len(values) < least:
            return False
        return not bool(np.isfinite(values[:, place]).any())

    def rate(self, time: int | None) -> float | None:
        """Return the sampling rate that the user or the file states; if nothing gives it, add a question."""
        if self.how.rate_hz is not None:
            self.answer("clock", f"{self.how.rate_hz:g} Hz", "given", "--rate")
            return self.how.rate_hz
        rates = self.stated_rates()
        why, rate_hz = next(iter(rates.items()), ("", None)) if len(rates) < 2 else ("", None)
        if rate_hz is not None and time is None:
            self.answer("clock", f"{rate_hz:g} Hz", "stated", why)
        elif time is None and not self._has_times_beside_columns():
            several = f"which rate is right: {', '.join(rates)}"
            what = several if rates else "the rate, as there is no column of times"
            self.asked.missing.append(Missing(what, "--rate ?"))
        return rate_hz

    def _has_times_beside_columns(self) -> bool:
        """Return whether the user is asked to name the axes, and some column's name may mean times.

        In this case the user is not asked for the rate as well, since these times may give it.
        """
        is_asked = any(one.option.startswith("--columns") for one in self.asked.missing)
        return is_asked and any(is_time(name.rpartition(".")[2]) for name in self.names)

    def stated_rates(self) -> Mapping[str, float]:
        """Return the sampling rates that the file states [Hz], by where in the file each was found.

        Several rates may contradict each other.
        """
        dialect, head = self.dialect, self.facts.head
        if dialect is not None and dialect.rate and (said := re.search(dialect.rate, head, re.M)):
            return {f"the head: {said[0].strip()}": float(said[1])}
        return self.facts.rates or {f"the head: {line}": hz for line, hz in stated_in(head).rates.items()}

    def measured_hz(self, clock: ClockColumns) -> float | None:
        """Return the sampling rate by the first times; None if these times are uneven or have no unit."""
        values = self.facts.sample()
        if clock.time is None or values.ndim != 2 or values.shape[1] <= clock.time or len(values) < 3:
            return None
        return rate_of(values[:, clock.time] * clock.factor, clock.unit)

    def error(self, gyro: Sequence[int], rate_hz: float | None) -> UsageError:
        """Return the error that asks the user for all missing facts."""
        values = self.first_rows()
        tables = []
        has_names = self.names != [str(place + 1) for place in range(len(self.names))]
        if values is not None and not gyro:
            tables.append(candidates.columns_table(self.names if has_names else None, values))
        elif values is not None and any(one.option.startswith("--units ?") for one in self.asked.missing):
            when = self.dialect.ask_unit if self.is_of_dialect(gyro) and self.dialect is not None else {}
            tables.append(candidates.units_table(values[:, list(gyro)], rate_hz, when or None))
        tables = [*self.asked.tables, self.asked.rows if any(tables) else "", *tables]
        return not_stated(
            self.where, self.asked.missing, given_options(self.how), "\n".join(filter(None, tables))
        )


def axes_of(names: Sequence[str], units: Sequence[str] = ()) -> dict[str, int]:
    """Return the column of each axis (x, y, z) by the columns' names.

    If several columns have the same axis, only fltea's own names, such as `gyro_x_dps`, count. The result is
    empty if this leaves an axis without its one column. If no name is that of a gyroscope's axis,
    `axes_in_units` finds the columns. `units`: unit of each column, if the file has a row of units.
    """
    places: dict[str, list[int]] = {}
    for place, name in enumerate(names):
        if axis := axis_of(name, units[place] if place < len(units) else ""):
            places.setdefault(axis, []).append(place)
    if not places:
        return axes_in_units(names, units)
    if any(len(found) > 1 for found in places.values()):
        places = {
            axis: [k for k in found if names[k] == f"gyro_{axis}_dps"] for axis, found in places.items()
        }
    return (
        {axis: places[axis][0] for axis in "xyz" if axis in places}
        if all(len(k) == 1 for k in places.values())
        else {}
    )


def _as_axes(names: Sequence[str], places: Sequence[int], axes: Sequence[str]) -> str:
    return f"{listed([names[place] for place in places])} as {', '.join(axes)}"
