"""Answers about columns, each with its evidence, one question after the other; and what is missing (pure)."""

import math
import re
from collections.abc import Callable, Sequence

import numpy as np

from fltea.recording import candidates
from fltea.recording.column_names import (
    accel_axis_of,
    accel_unit_of,
    axes_in_units,
    axis_of,
    counts_unknown,
    rate_unit_of,
    split_seconds,
    time_scale_of,
    times_in,
    unit_in,
)
from fltea.recording.dialects import Dialect, Facts, columns_of
from fltea.recording.files import TIME_COLUMN, Note, listed
from fltea.recording.reading import Answer, Evidence, Missing, Question, given_options, not_stated
from fltea.recording.sample_times import EVEN_SHARE, EVENNESS, PLAUSIBLE_HZ, SECONDS
from fltea.recording.units import (
    accel_unit,
    is_physical,
    parse_accel_unit,
    parse_units,
    rate_unit,
    time_scale,
    time_unit,
)
from fltea.recording.wanted import Wanted
from fltea.records.errors import UsageError
from fltea.settings.how import How, TimeUnit

OVERRULE = "If the file is wrong, add --overrule."

PREFERRED_TIMES = (
    lambda name: name == "seconds_elapsed",  # phones' own count of seconds, beside their clock
    lambda name: name.endswith("header.stamp"),  # rostopic echo -p
    lambda name: name not in ("date", "datum"),  # a date beside a time of day
)
"""Which of several columns of times, the first rule that any fits."""

_TWO_FIELDS = re.compile(r"(\d+)\+(\d+)")
"""Whole seconds and nanoseconds, by position."""

ENOUGH = 10
"""Rows that say that a column is empty."""


class Choice:
    """The answers so far, and what is missing. labels: what the user calls the columns."""

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
        self.missing: list[Missing] = []
        self.notes: list[Note] = []
        self.tables: list[str] = []
        self.shown_of = ""
        self.turn = (0, 1)
        self._by_dialect: Evidence = "convention" if dialect is not None and dialect.convention else "dialect"

    def answer(self, question: Question, value: str, evidence: Evidence, why: str) -> None:
        """Add an answer."""
        self.answers.append(Answer(question, value, evidence, why))

    def gyro(self) -> tuple[tuple[int, ...], tuple[str, ...]]:
        """Find the axes: their places, and what they are called."""
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
            self.answer("columns", _as_axes(names, gyro, "xyz"), self._by_dialect, self._said())
            return gyro, ("x", "y", "z")
        found = axes_of(names, self.units)
        if found:
            gyro = tuple(found.values())
            self.answer("columns", _as_axes(names, gyro, tuple(found)), "stated", "their names")
            return gyro, tuple(found)
        self.missing.append(Missing("which columns are the gyroscope's axes", "--columns ?,?,?"))
        return (), ()

    def _check_twice(self, places: Sequence[int]) -> None:
        for name in (self.labels[place] for place in places):
            if self.labels.count(name) > 1:
                raise UsageError(
                    f"{self.where}: {self.labels.count(name)} columns are called {name}, and which is meant is "
                    "not known. Give them different names, or say their positions: --columns 1,2,3."
                )

    def unit(self, gyro: tuple[int, ...]) -> tuple[str, float, float | None]:
        """Find the unit of the axes: its name, the factor to deg/s or counts, and LSB per deg/s."""
        stated = [rate_unit_of(self.names[p]) or _rate_or_counts(self.units[p]) for p in gyro]
        changed = "" if self.how.overrule else self._changed(gyro)
        known = {one for one in stated if one is not None}
        self._check_names_against_units(gyro, rate_unit_of, rate_unit, "--units")
        if self.how.units is not None:
            parsed = parse_units(self.how.units)
            self._check_given_unit(gyro, stated, parsed)
            if changed and parsed[1] is None:
                raise UsageError(
                    f"{self.where}: {changed}, and --units {self.how.units} says not whether that is done. If "
                    f"they are in {self.how.units} as they stand, add --overrule."
                )
            self.answer("unit", self.how.units, "given", "--units")
            return self.how.units, *self._whole(parsed, gyro)
        if changed:
            what = f"what the numbers are as they stand: {changed}, and not said is how"
            self.missing.append(Missing(what, "--units ? --overrule"))
            return "", 1.0, None
        if not gyro:
            if not any(map(rate_unit_of, self.names)) and not any(map(rate_unit, self.units)):
                self.missing.append(Missing("their unit", "--units ?"))
            return "", 1.0, None
        if len(known) > 1:
            raise UsageError(
                f"{self.where}: the columns of one sensor are in different units, "
                + ", ".join(f"{self.names[p]} in {u}" for p, u in zip(gyro, stated, strict=True))
                + f". Name those that are of one unit with --columns. {OVERRULE}"
            )
        self._refuse_other_units(gyro)
        dialect = self.dialect if self._is_of_dialect(gyro) else None
        if known and (None not in stated or (dialect is not None and not dialect.ask_unit)):
            unit = known.pop()
            self._check_stated_unit(gyro, unit)
            self.answer("unit", unit, *self.facts.units_from)
            return unit, *self._whole(parse_units(unit), gyro)
        if dialect is not None and dialect.gyro_unit and not known:
            scale = self.facts.number(dialect.gyro_scale) if dialect.gyro_scale else 1.0
            if scale is not None and math.isfinite(scale) and scale > 0:
                said = f" times {dialect.gyro_scale} {scale:g} of the head" if dialect.gyro_scale else ""
                self.answer("unit", f"{dialect.gyro_unit}{said}", self._by_dialect, self._said())
                factor, lsb = parse_units(dialect.gyro_unit)
                return dialect.gyro_unit, *self._whole((factor * scale, lsb), gyro)
        what = listed([self.names[p] for p, unit in zip(gyro, stated, strict=True) if unit is None])
        some = f" ({listed([self.names[gyro[0]]])} says {next(iter(known))})" if known else ""
        self.missing.append(Missing(f"the unit of {what}{some}", "--units ?"))
        return "", 1.0, None

    def _changed(self, places: Sequence[int]) -> str:
        """Say which columns may still have to be changed by what the file says, and by what."""
        found = {name: what for p in places if (what := self.facts.changed.get(name := self.names[p]))}
        return f"{listed([*found])} may have to be changed by {listed([*{*found.values()}])}" if found else ""

    def _whole(self, parsed: tuple[float, float | None], gyro: Sequence[int]) -> tuple[float, float | None]:
        """Return a unit as factor and LSB; `lsb:N` of fractions is a scale, and says nothing of a resolution."""
        factor, lsb = parsed
        values = self.facts.sample()
        if lsb is None or not gyro or values.ndim != 2 or values.shape[1] <= max(gyro):
            return factor, lsb
        columns = values[:, list(gyro)]
        is_whole = bool((columns == np.rint(columns))[np.isfinite(columns)].all())
        return (factor, lsb) if is_whole else (factor / lsb, None)

    def _is_of_dialect(self, gyro: Sequence[int]) -> bool:
        """Whether the dialect speaks of these columns."""
        if self.dialect is None:
            return False
        if not self.dialect.gyro:
            return True
        triples = [columns_of([triple], self.names) for triple in self.dialect.gyro]
        return any({*gyro} <= {*triple} for triple in triples)

    def _check_given_unit(
        self, gyro: Sequence[int], stated: Sequence[str | None], given: tuple[float, float | None]
    ) -> None:
        """Compare what the user says with the names and the row of units, and with the dialect."""
        if self.how.overrule:
            return
        self._refuse_other_units(gyro)
        for place, unit in zip(gyro, stated, strict=True):
            if unit is not None and parse_units(unit) != given and self.facts.units_from[0] != "stated":
                text = (
                    f"read in {self.how.units}, as --units says; by {self.facts.units_from[1]} they are in "
                )
                self.notes.append(Note("reading", f"{self.where}: {text}{unit}."))
                break
            if unit is not None and parse_units(unit) != given:
                raise UsageError(
                    f"{self.where}: {listed([self.names[place]])} is in {unit} by its name or the row of units, "
                    f"and --units {self.how.units} says otherwise. Leave --units out. {OVERRULE}"
                )
        dialect = self.dialect
        if self._is_of_dialect(gyro) and dialect is not None and dialect.gyro_unit:
            if parse_units(dialect.gyro_unit) != given or dialect.gyro_scale:
                text = f"read in {self.how.units}, as --units says; by {self._said()} they would be in "
                self.notes.append(Note("reading", f"{self.where}: {text}{dialect.gyro_unit}."))

    def _check_stated_unit(self, gyro: Sequence[int], unit: str) -> None:
        """Compare what the file states with what the dialect says."""
        dialect, (evidence, why) = self.dialect, self.facts.units_from
        if not self._is_of_dialect(gyro) or dialect is None or not dialect.gyro_unit or self.how.overrule:
            return
        is_other = dialect.gyro_scale or parse_units(dialect.gyro_unit) != parse_units(unit)
        if is_other and evidence == "stated":
            raise UsageError(
                f"{self.where}: {listed([self.names[gyro[0]]])} is in {unit} by {why}, and {self._said()} writes "
                f"{dialect.gyro_unit}. Say which is right: --units ? --overrule"
            )

    def _check_names_against_units(
        self,
        places: Sequence[int],
        in_name: Callable[[str], object],
        in_unit: Callable[[str], object],
        flag: str,
    ) -> None:
        for place in places if not self.how.overrule else ():
            name, unit = self.names[place], self.units[place]
            by_name, beside = in_name(name), in_unit(unit)
            if None not in (by_name, beside) and by_name != beside:
                raise UsageError(
                    f"{self.where}: {listed([name])} is in {unit_in(name) or by_name} by its name, and in "
                    f"{unit} by the unit beside it. Say which is right: {flag} ? --overrule"
                )

    def _refuse_other_units(self, gyro: Sequence[int]) -> None:
        """Refuse columns whose unit is none of an angular rate."""
        for place in gyro if not self.how.overrule else ():
            unit = unit_in(self.names[place]) or self.units[place]
            if is_physical(unit) and rate_unit(unit) is None:
                raise UsageError(
                    f"{self.where}: {listed([self.names[place]])} is in {unit} by its name or the row of units, "
                    f"which is no angular rate. Name the gyroscope's columns with --columns. {OVERRULE}"
                )

    def clock(self, gyro: Sequence[int]) -> tuple[int | None, TimeUnit | None, float, int | None, float]:
        """Find the times: place, unit, factor to that unit, and place and unit in s of what is added to them."""
        place, by_dialect = self._time_column(gyro)
        given, factor = self.how.time_unit, 1.0
        if place is None:
            return None, given, 1.0, None, 0.0
        if place in (parts := split_seconds(self.names)) and given in (None, "s"):
            return place, "s", 1.0, *parts[place]
        if by_dialect and self.dialect is not None and given in (None, "s"):
            for two in map(_TWO_FIELDS.fullmatch, self.dialect.time):
                if two is not None and two[1] == self.names[place]:
                    return place, "s", 1.0, self.names.index(two[2]), 1e-9
        self._check_names_against_units([place], time_scale_of, time_scale, "--time-unit")
        name, beside = self.names[place], self.units[place]
        stated = time_scale(beside) or time_scale_of(name)
        if given is not None and stated is not None and (given, 1.0) != stated and not self.how.overrule:
            in_file = stated[0] if stated[1] == 1.0 else beside or unit_in(name)
            raise UsageError(
                f"{self.where}: the column {listed([name])} is in {in_file} by its name or line of "
                f"units, and --time-unit {given} says otherwise. Leave --time-unit out. {OVERRULE}"
            )
        unit: TimeUnit | None = given
        if given is None and stated is not None:
            unit, factor = stated
        dialect = self.dialect
        if unit is None and by_dialect and dialect is not None and dialect.time_unit:
            scale = self.facts.number(dialect.time_scale) if dialect.time_scale else 1.0
            if scale is None or not scale > 0:
                self._ask_clock(place, f"the unit of {listed([self.names[place]])}")
            else:
                unit, factor = time_unit(dialect.time_unit), dialect.time_ticks * scale
        if unit is None and self.how.rate_hz is None and (what := counts_unknown(name, beside)):
            self._ask_clock(
                place, f"what the times of {listed([name])} count (the file says {listed([what])})"
            )
        elif unit is None and self.how.rate_hz is None and (step := self._step(place)) is not None:
            if not PLAUSIBLE_HZ[0] <= 1 / step <= PLAUSIBLE_HZ[1]:
                self._ask_clock(place, f"what the times of {listed([name])} count")
        return place, unit, factor, None, 0.0

    def _ask_clock(self, place: int, what: str) -> None:
        self.missing.append(Missing(what, "--time-unit ?"))
        step = self._step(place)
        if step is not None and (units := candidates.times_table(step)):
            lines = [f"A step of {step:.6g} would be:", *units, "  or in ticks of its own: --rate ?"]
            self.tables.append("\n".join(lines))

    def _step(self, place: int) -> float | None:
        """The step from one of the first times to the next, if it is that of an even clock."""
        values = self.facts.sample()
        if values.ndim != 2 or values.shape[1] <= place or len(values) < ENOUGH:
            return None
        steps = np.diff(values[:, place][np.isfinite(values[:, place])])
        steps = steps[steps != 0]
        step = float(np.median(steps)) if len(steps) else 0.0
        is_even = step > 0 and float((np.abs(steps / step - 1) <= EVENNESS).mean()) >= EVEN_SHARE
        return step if is_even else None

    def _time_column(self, gyro: Sequence[int]) -> tuple[int | None, bool]:
        """Return the place of the times, and whether the dialect says what they count."""
        names = self.names
        dialect = self.dialect
        of_dialect = [
            place
            for pattern in (dialect.time if dialect is not None else ())
            for place in columns_of([[_TWO_FIELDS.sub(r"\1", pattern)]], names)
            if not self._is_empty(place)
        ]
        if self.wanted.time is not None:
            place = self.labels.index(self.wanted.time)
            self._check_twice([place])
            return place, place in of_dialect
        if of_dialect:
            return of_dialect[0], True
        if parts := split_seconds(names):
            return next(iter(parts)), False
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
        for sort in PREFERRED_TIMES if len(found) > 1 else ():
            found = [k for k in found if sort(names[k].lower())] or found
        if len(found) > 1 and self.how.rate_hz is None:
            self.missing.append(
                Missing(
                    f"which column has the times ({listed([names[k] for k in found])})", "--time-column ?"
                )
            )
        return (found[0] if found else None), False

    def _is_empty(self, place: int) -> bool:
        """Whether none of the first rows has a number in a column."""
        values = self.facts.sample()
        least = 1 if self.dialect is not None and self.dialect.rate else ENOUGH
        fits = values.ndim == 2 and values.shape[1] == len(self.names) and len(values) >= least
        return fits and not bool(np.isfinite(values[:, place]).any())

    def rate(self, time: int | None) -> float | None:
        """Find the rate that is given or stated."""
        if self.how.rate_hz is not None:
            self.answer("clock", f"{self.how.rate_hz:g} Hz", "given", "--rate")
            return self.how.rate_hz
        dialect = self.dialect
        rate_hz: float | None
        if dialect is not None and dialect.rate and (said := re.search(dialect.rate, self.facts.head, re.M)):
            why, rate_hz = f"the head: {said[0].strip()}", float(said[1])
        else:
            why, rate_hz = next(iter(self.facts.rates.items()), ("", None))
        if rate_hz is not None and time is None:
            self.answer("clock", f"{rate_hz:g} Hz", "stated", why)
        if rate_hz is None and time is None:
            self.missing.append(Missing("the rate, as there is no column of times", "--rate ?"))
        return rate_hz

    def accelerometer(self, taken: set[int | None]) -> tuple[tuple[int, ...], float]:
        """Find an accelerometer's axes x, y, z, and m/s² in their unit; where that is unclear it is not read."""
        names, dialect = self.names, self.dialect
        by_dialect = columns_of(dialect.accel, names) if dialect is not None else ()
        accel, several = by_dialect, False
        if not accel:
            letters = [accel_axis_of(name, unit) for name, unit in zip(names, self.units, strict=True)]
            found = {axis: [k for k, one in enumerate(letters) if one == axis] for axis in "xyz"}
            several = any(len(places) > 1 for places in found.values())
            accel = tuple(places[0] for places in found.values() if len(places) == 1)
        if len(accel) != 3 or {*accel} & taken:
            if several:
                self._unread("several columns are called alike")
            return (), 1.0
        self._check_names_against_units(accel, accel_unit_of, accel_unit, "--accel-units")
        shown = listed([names[place] for place in accel])
        units = [accel_unit_of(names[place]) or accel_unit(self.units[place]) for place in accel]
        stated = {*units} - {None}
        if self.how.accel_units is not None:
            given = parse_accel_unit(self.how.accel_units)[0]
            if stated and stated != {given} and not self.how.overrule:
                raise UsageError(
                    f"{self.where}: {shown} have another unit by their names or the row of units than "
                    f"--accel-units {self.how.accel_units} says. Leave it out. {OVERRULE}"
                )
            self.answer("accelerometer", f"{shown} in {self.how.accel_units}", "given", "--accel-units")
            return accel, given
        if len(stated) == 1 and None not in units:
            self.answer("accelerometer", shown, "stated", "the unit is in the names or the row of units")
            return accel, float(stated.pop() or 1.0)
        if by_dialect and dialect is not None and dialect.accel_unit and not stated:
            scale = self.facts.number(dialect.accel_scale) if dialect.accel_scale else 1.0
            if scale is not None and scale > 0:
                self.answer(
                    "accelerometer", f"{shown} in {dialect.accel_unit}", self._by_dialect, self._said()
                )
                return accel, scale * (accel_unit(dialect.accel_unit) or 1.0)
        values = self.facts.sample()
        fits = values.ndim == 2 and values.shape[1] == len(names) and len(values) > 0
        measured = candidates.gravity_unit(values[:, list(accel)]) if fits and not stated else None
        if measured is None or measured.startswith("lsb:"):  # the range may be one of its own
            self._unread(f"nothing says the unit of {shown}")
            return (), 1.0
        self.answer("accelerometer", f"{shown} in {measured}", "measured", "their length is that of gravity")
        return accel, float(accel_unit(measured) or 1.0)

    def _unread(self, why: str) -> None:
        self.answer("accelerometer", "not read", "missing", f"{why}; --accel-units says it")

    def _said(self) -> str:
        assert self.dialect is not None
        return f"{self.dialect.name}"

    def measured_hz(self, time: int, unit: TimeUnit | None, factor: float) -> float | None:
        """Return the rate by the first times, if their unit is known."""
        values = self.facts.sample()
        if values.ndim != 2 or values.shape[1] <= time or len(values) < 3:
            return None
        step_s = float(np.nanmedian(np.diff(values[:, time]))) * factor * SECONDS[unit or "s"]
        rate_hz = 1 / step_s if step_s > 0 else math.inf
        return rate_hz if unit is not None or PLAUSIBLE_HZ[0] <= rate_hz <= PLAUSIBLE_HZ[1] else None

    def error(self, gyro: Sequence[int], rate_hz: float | None) -> UsageError:
        """Return what asks for all that is missing."""
        values = self.facts.sample()
        fits = values.ndim == 2 and values.shape[1] == len(self.names)
        tables = []
        has_names = self.names != [str(place + 1) for place in range(len(self.names))]
        if fits and not gyro:
            tables.append(candidates.columns_table(self.names if has_names else None, values))
        elif fits and any(one.option.startswith("--units ?") for one in self.missing):
            when = self.dialect.ask_unit if self._is_of_dialect(gyro) and self.dialect is not None else {}
            tables.append(candidates.units_table(values[:, list(gyro)], rate_hz, when or None))
        tables = [*self.tables, self.shown_of if any(tables) else "", *tables]
        return not_stated(self.where, self.missing, given_options(self.how), "\n".join(filter(None, tables)))


def _rate_or_counts(unit: str) -> str | None:
    return rate_unit(unit) or (unit if unit.startswith("lsb:") else None)


def axes_of(names: Sequence[str], units: Sequence[str] = ()) -> dict[str, int]:
    """Return places of the axes x, y, z: by our names, else those that others use; none if two are of one axis.

    Where no name is a gyroscope's, those in a unit of rates that are called alike but for the axis. units: of the columns, where a row of them stands beside.
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
