"""Chooses the columns of the accelerometer's axes, and their unit.

If it is unclear which columns or which unit are right, no accelerometer is read, since only the gyroscope is
needed.
"""

from fltea.recording import candidates
from fltea.recording.column_names import accel_axis_of, accel_unit_of, common_beginning
from fltea.recording.dialects import columns_of
from fltea.recording.evidence import Choice
from fltea.recording.files import listed
from fltea.recording.reading import OVERRULE
from fltea.recording.units import accel_unit, parse_accel_unit
from fltea.records.errors import UsageError

Accelerometer = tuple[tuple[int, ...], float]
"""The columns of the accelerometer's axes x, y, z, and the size of their unit [m/s²]. There are no columns if
no accelerometer is read.
"""


def choose_accelerometer(choice: Choice, taken: set[int | None]) -> Accelerometer:
    """Choose the accelerometer. `taken`: columns of the gyroscope's axes and of the times.

    Raises:
        UsageError: two statements of the accelerometer's unit contradict each other.
    """
    accel, is_of_dialect = _axes(choice, taken)
    if not accel:
        return (), 1.0
    choice.check_names_against_units(accel, accel_unit_of, accel_unit, "--accel-units")
    names, dialect = choice.names, choice.dialect
    shown = listed([names[place] for place in accel])
    units = [accel_unit_of(names[place]) or accel_unit(choice.units[place]) for place in accel]
    stated = {*units} - {None}
    by_dialect = scale = None
    if is_of_dialect and dialect is not None and dialect.accel_unit and not stated:
        scale, by_dialect = choice.scale(dialect.accel_scale), accel_unit(dialect.accel_unit)
    if choice.how.accel_units is not None:
        given = parse_accel_unit(choice.how.accel_units)[0]
        if stated and stated != {given} and not choice.how.overrule:
            raise UsageError(
                f"{choice.where}: {shown} have another unit by their names or the row of units than "
                f"--accel-units {choice.how.accel_units} says. Leave it out. {OVERRULE}"
            )
        choice.answer("accelerometer", f"{shown} in {choice.how.accel_units}", "given", "--accel-units")
        return accel, given * (scale or 1.0) if given == by_dialect and not choice.how.overrule else given
    if len(stated) == 1 and None not in units:
        choice.answer("accelerometer", shown, "stated", "the unit is in the names or the row of units")
        return accel, float(stated.pop() or 1.0)
    if dialect is not None and by_dialect is not None and scale is not None:
        choice.answer("accelerometer", f"{shown} in {dialect.accel_unit}", choice.by_dialect, dialect.name)
        return accel, scale * by_dialect
    values = choice.first_rows()
    measured: list[str] = []
    if values is not None and len(values) and not stated:
        measured = candidates.gravity_units(values[:, list(accel)])
    # The length of gravity also gives the scale of counts, but this scale is not used, since it is uncertain.
    if len(measured) == 1 and not measured[0].startswith("lsb:"):
        choice.answer(
            "accelerometer", f"{shown} in {measured[0]}", "measured", "their length is that of gravity"
        )
        return accel, float(accel_unit(measured[0]) or 1.0)
    why = f", which have the length of gravity in {' or '.join(measured)}" if len(measured) > 1 else ""
    _unread(choice, f"nothing says the unit of {shown}{why}")
    return (), 1.0


def _axes(choice: Choice, taken: set[int | None]) -> tuple[tuple[int, ...], bool]:
    """Return the columns of the accelerometer's axes, and whether the logger's dialect names them."""
    names, dialect = choice.names, choice.dialect
    near = common_beginning([names[place] for place in taken if place is not None])
    accel: tuple[int, ...] = columns_of(dialect.accel, names, near) if dialect is not None else ()
    is_of_dialect, several = bool(accel), False
    if not accel:
        letters = [accel_axis_of(name, unit) for name, unit in zip(names, choice.units, strict=True)]
        found = {axis: [k for k, one in enumerate(letters) if one == axis] for axis in "xyz"}
        several = any(len(places) > 1 for places in found.values())
        accel = tuple(places[0] for places in found.values() if len(places) == 1)
    if len(accel) == 3 and not {*accel} & taken:
        return accel, is_of_dialect
    elsewhere = [name for name in choice.facts.beside if accel_axis_of(name)]
    if several:
        _unread(choice, "several columns are called alike")
    elif elsewhere:
        why = f"{listed(elsewhere)} stand on other lines, and it is unclear which of them are of one sample"
        choice.answer("accelerometer", "not read", "missing", why)
    return (), False


def _unread(choice: Choice, why: str) -> None:
    choice.answer("accelerometer", "not read", "missing", f"{why}; --accel-units says it")
