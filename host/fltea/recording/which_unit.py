"""Chooses the unit of the gyroscope's axes.

The user, the file and the logger's dialect may state the unit. If several of them do, they must agree.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fltea.recording.column_names import rate_unit_of, unit_in
from fltea.recording.evidence import Choice
from fltea.recording.files import Note, listed
from fltea.recording.reading import OVERRULE, Missing, says_otherwise
from fltea.recording.text_head import stated_in
from fltea.recording.units import is_physical, parse_units, rate_unit
from fltea.records.errors import UsageError

ALIKE = 0.02
"""Two scales count as equal if their relative difference is at most this, since files state rounded scales.
"""


class Unit(NamedTuple):
    """The unit of the axes. `name`: the unit in the notation of `--units`.

    `factor`: factor that converts numbers to deg/s or to counts. `lsb`: number of counts in 1 deg/s, None if
    the numbers are no counts.
    """

    name: str
    factor: float = 1.0
    lsb: float | None = None


_ASKED = Unit("")


def choose_unit(choice: Choice, gyro: tuple[int, ...]) -> Unit:
    """Choose the unit of the axes.

    Raises:
        UsageError: two statements of the unit contradict each other, or the unit is not one of angular rates.
    """
    _use_head(choice, gyro)
    stated = [rate_unit_of(choice.names[p]) or _rate_or_counts(choice.units[p]) for p in gyro]
    changed = "" if choice.how.overrule else _changed(choice, gyro)
    choice.check_names_against_units(gyro, rate_unit_of, rate_unit, "--units")
    if choice.how.units is not None:
        return _given(choice, gyro, stated, changed)
    if changed:
        what = (
            f"the unit of the numbers in the file: {changed}, and nothing says whether that was done already"
        )
        choice.asked.missing.append(Missing(what, "--units ? --overrule"))
        return _ASKED
    known = {one for one in stated if one is not None}
    if len(known) > 1:
        raise UsageError(
            f"{choice.where}: the columns of one sensor are in different units, "
            + ", ".join(f"{choice.names[p]} in {u}" for p, u in zip(gyro, stated, strict=True))
            + f". Name those that are of one unit with --columns. {OVERRULE}"
        )
    _refuse_other_units(choice, gyro)
    dialect = choice.dialect if choice.is_of_dialect(gyro) else None
    if known and (None not in stated or (dialect is not None and not dialect.ask_unit)):
        unit = known.pop()
        _check_against_dialect(choice, gyro, unit)
        choice.answer("unit", unit, *choice.facts.units_from)
        return Unit(unit, *_whole(choice, parse_units(unit), gyro))
    if not known and gyro and (found := _of_dialect(choice, gyro)) is not None:
        return found
    _ask(choice, gyro, stated)
    return _ASKED


def _ask(choice: Choice, gyro: Sequence[int], stated: Sequence[str | None]) -> None:
    """Ask the user for the unit.

    If the axes are unknown, the user is asked for them anyway. Some column may then state a unit of angular
    rate, which may be that of the axes. In this case, the user is not asked for the unit yet.
    """
    if any(one.option.startswith("--units ?") for one in choice.asked.missing):
        return
    if gyro:
        what = listed([choice.names[p] for p, unit in zip(gyro, stated, strict=True) if unit is None])
        known = [f"{listed([choice.names[p]])} says {u}" for p, u in zip(gyro, stated, strict=True) if u]
        some = f" ({known[0]})" if known else ""
        choice.asked.missing.append(Missing(f"the unit of {what}{some}", "--units ?"))
    elif not any(map(rate_unit_of, choice.names)) and not any(map(rate_unit, choice.units)):
        choice.asked.missing.append(Missing("their unit", "--units ?"))


def _use_head(choice: Choice, gyro: Sequence[int]) -> None:
    """Use the unit of the axes that the head of the file (the lines before the column names) states.

    Raise UsageError if this unit contradicts the one in the axes' names or in the row of units.
    """
    units = dict(stated_in(choice.facts.head).units)
    # Numbers with fractions are not counts. So if they have fractions, and the head states counts per deg/s,
    # the head speaks of the sensor, and not of the numbers in the file.
    if not _is_whole(choice, gyro):
        units = {line: unit for line, unit in units.items() if not unit.startswith("lsb:")}
    beside = [choice.units[p] or (rate_unit_of(choice.names[p]) or "") for p in gyro]
    others = {line: unit for line, unit in units.items() if rate_unit(unit)}
    for place, name in zip(gyro, beside, strict=True):
        line, unit = next(iter(others.items()), ("", None))
        if rate_unit(name) and unit and unit != rate_unit(name) and not choice.how.overrule:
            raise UsageError(
                f"{choice.where}: {listed([choice.names[place]])} is in {name} by its name or the row of "
                f'units, and "{line}" stands in the head. Say which is right: --units ? --overrule'
            )
    if len(units) > 1 and not any(beside):
        given = None if choice.how.units is None else parse_units(choice.how.units)
        units = {line: unit for line, unit in units.items() if parse_units(unit) == given}
        if given is None:
            each = " or ".join(f'"{line}"' for line in stated_in(choice.facts.head).units)
            choice.asked.missing.append(Missing(f"which unit of the head is right, {each}", "--units ?"))
    if len(units) == 1 and not any(beside):
        ((line, unit),) = units.items()
        for place in gyro:
            choice.units[place] = unit
        choice.facts = choice.facts._replace(units_from=("stated", f"the head: {line}"))


def _given(choice: Choice, gyro: Sequence[int], stated: Sequence[str | None], changed: str) -> Unit:
    """Use the user's unit, after a comparison with what the file and the dialect state."""
    units = str(choice.how.units)
    parsed = parse_units(units)
    if not choice.how.overrule:
        _refuse_other_units(choice, gyro)
        _check_given(choice, gyro, stated, parsed)
    if changed and parsed[1] is None:
        raise UsageError(
            f"{choice.where}: {changed}, and --units {units} does not say whether that was done. If "
            f"the numbers are in {units} as they stand, add --overrule."
        )
    choice.answer("unit", units, "given", "--units")
    dialect = choice.dialect if choice.is_of_dialect(gyro) and not choice.how.overrule else None
    if dialect is not None and dialect.gyro_unit:
        scale, by_dialect = choice.scale(dialect.gyro_scale), parse_units(dialect.gyro_unit)
        if dialect.gyro_scale and scale is not None and not any(stated):
            read, said = parsed[0] / (parsed[1] or 1.0), by_dialect[0] * scale
            if parsed == by_dialect or abs(read / said - 1) < ALIKE:
                parsed = (said, None) if parsed == by_dialect else parsed
                return Unit(units, *_whole(choice, parsed, gyro))
            fact = f"{dialect.gyro_scale} {scale:g} stands in the head: times that, the numbers are "
            fact += f"{dialect.gyro_unit} ({dialect.name})"
            raise says_otherwise(choice.where, fact, "--units", units)
        if by_dialect != parsed:
            text = (
                f"read in {units}, as --units says; by {dialect.name} they would be in {dialect.gyro_unit}."
            )
            choice.notes.append(Note("reading", f"{choice.where}: {text}"))
    return Unit(units, *_whole(choice, parsed, gyro))


def _check_given(
    choice: Choice, gyro: Sequence[int], stated: Sequence[str | None], given: tuple[float, float | None]
) -> None:
    evidence, why = choice.facts.units_from
    for place, unit in zip(gyro, stated, strict=True):
        if unit is None or parse_units(unit) == given:
            continue
        if evidence != "stated":
            text = f"read in {choice.how.units}, as --units says; by {why} they are in {unit}."
            choice.notes.append(Note("reading", f"{choice.where}: {text}"))
            return
        by = why if why.startswith("the head") else "its name or the row of units"
        fact = f"{listed([choice.names[place]])} is in {unit} by {by}"
        raise says_otherwise(choice.where, fact, "--units", choice.how.units)


def _of_dialect(choice: Choice, gyro: Sequence[int]) -> Unit | None:
    """Return the unit that the logger's dialect prescribes, or None.

    If the dialect says that the file's head states a scale, the unit is multiplied by this scale.
    """
    dialect = choice.dialect if choice.is_of_dialect(gyro) else None
    scale = None if dialect is None else choice.scale(dialect.gyro_scale)
    if dialect is None or not dialect.gyro_unit or scale is None:
        return None
    said = f" times {dialect.gyro_scale} {scale:g} of the head" if dialect.gyro_scale else ""
    choice.answer("unit", f"{dialect.gyro_unit}{said}", choice.by_dialect, dialect.name)
    factor, lsb = parse_units(dialect.gyro_unit)
    return Unit(dialect.gyro_unit, *_whole(choice, (factor * scale, lsb), gyro))


def _check_against_dialect(choice: Choice, gyro: Sequence[int], unit: str) -> None:
    """Raise UsageError if the unit that the file states contradicts the unit of the dialect."""
    dialect, (evidence, why) = choice.dialect, choice.facts.units_from
    if not choice.is_of_dialect(gyro) or dialect is None or not dialect.gyro_unit or choice.how.overrule:
        return
    is_other = dialect.gyro_scale or parse_units(dialect.gyro_unit) != parse_units(unit)
    if is_other and evidence == "stated":
        raise UsageError(
            f"{choice.where}: {listed([choice.names[gyro[0]]])} is in {unit} by {why}, and {dialect.name} "
            f"writes {dialect.gyro_unit}. Say which is right: --units ? --overrule"
        )


def _refuse_other_units(choice: Choice, gyro: Sequence[int]) -> None:
    """Raise UsageError if the unit of an axis is that of a quantity other than angular rate."""
    for place in gyro if not choice.how.overrule else ():
        unit = unit_in(choice.names[place]) or choice.units[place]
        if is_physical(unit) and rate_unit(unit) is None:
            raise UsageError(
                f"{choice.where}: {listed([choice.names[place]])} is in {unit} by its name or the row of "
                f"units, which is no angular rate. Name the gyroscope's columns with --columns. {OVERRULE}"
            )


def _changed(choice: Choice, places: Sequence[int]) -> str:
    """Return a text for the user: by the file's own words, these columns may need a scale or an offset.

    The text is empty if there are no such columns.
    """
    found = {name: what for p in places if (what := choice.facts.changed.get(name := choice.names[p]))}
    return f"{listed([*found])} may have to be changed by {listed([*{*found.values()}])}" if found else ""


def _whole(
    choice: Choice, parsed: tuple[float, float | None], gyro: Sequence[int]
) -> tuple[float, float | None]:
    """Return the factor that converts the numbers to deg/s or counts, and the counts in 1 deg/s.

    Numbers with fractions are no counts, even if the unit is `lsb:N` (N counts in 1 deg/s). They are then
    converted to deg/s by the factor 1/N, and None is returned in place of N.
    """
    factor, lsb = parsed
    return (factor, lsb) if lsb is None or _is_whole(choice, gyro) else (factor / lsb, None)


def _is_whole(choice: Choice, gyro: Sequence[int]) -> bool:
    """Return whether the axes' numbers in the first rows are known to be whole numbers."""
    values = choice.facts.sample()
    if not gyro or values.ndim != 2 or values.shape[1] <= max(gyro):
        return True
    columns = values[:, list(gyro)]
    return bool((columns == np.rint(columns))[np.isfinite(columns)].all())


def _rate_or_counts(unit: str) -> str | None:
    return rate_unit(unit) or (unit if unit.startswith("lsb:") else None)
