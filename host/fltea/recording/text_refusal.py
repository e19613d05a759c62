"""Explains why no row of a text can be read, and asks the user for the facts that are needed to read rows."""

from collections.abc import Callable, Iterable, Mapping, Sequence

from fltea.recording.axis_titles import without_titles
from fltea.recording.candidates import columns_table
from fltea.recording.columns import choose
from fltea.recording.dialects import Facts
from fltea.recording.raw_lines import shown
from fltea.recording.reading import Missing, given_options, not_stated
from fltea.recording.text_fields import (
    all_numbers,
    bare_fields,
    rows_alike,
    sample_of,
    separator_of,
    split,
    units_in,
)
from fltea.recording.text_forms import WRONG_SUM
from fltea.recording.text_head import stated_in
from fltea.recording.text_labels import decode_object, values_in
from fltea.recording.wanted import is_number, wanted_of
from fltea.records.errors import UsageError
from fltea.settings.how import How

MOST_TABLES = 4
"""Largest number of kinds of rows of which the message shows the columns."""

FactsOf = Callable[[Sequence[str] | None, int, str], Facts]
"""Function that returns what is known of a file. Its arguments are the names of the columns, the number of
columns, and the first field of the rows.
"""

NamesAbove = tuple[int | None, list[str] | None, list[str] | None]


def refusal(
    where: str, how: How, lines: Sequence[str], kinds: Mapping[str, int], facts: FactsOf
) -> UsageError:
    """Return the error that tells the user why no row of a text can be read.

    `lines`: first lines of the text. `kinds`: the first fields that tell the kind of a row, each with the
    number of fields of such a row. `facts`: function that returns what is known of the file.
    """
    wanted = wanted_of(how)
    has_numbers = any(is_number(field) for line in lines for field in bare_fields(line))
    kind, rows = rows_alike(lines)
    if not rows or (kind == "row" and not has_numbers and wanted.columns is None):
        if wanted.columns is not None and not wanted.by_position:
            names = next((found for found in map(bare_fields, lines) if len(found) > 1), None)
            return UsageError(f"{where}: {wanted.lacking(names)}.")
        if not has_numbers:
            return UsageError(f"{where}: is no recording: none of its first lines holds a number.")
        return UsageError(f"{where}: no line of numbers; the first line is {shown(lines[0].strip())}.")
    try:
        if kind == "row":
            _choose_row(where, how, rows[0], lines, kinds, facts)
        else:
            names = list(decode_object(rows[0]) if kind == "object" else values_in(rows[0]))
            at = f"{where}:{lines.index(rows[0]) + 1}"
            if names:
                choose(at, names, None, len(names), how, facts(names, len(names), ""))
    except UsageError as error:
        return error
    return UsageError(f"{where}: no line of numbers; the first line is {shown(lines[0].strip())}.")


def _choose_row(
    where: str, how: How, row: str, lines: Sequence[str], kinds: Mapping[str, int], facts: FactsOf
) -> None:
    """Try to choose the columns of `row`, and so raise the error that asks for the missing facts."""
    fields = split(row, separator_of(row))
    if len(kinds) > 1 and fields[0] in kinds and how.topic is None:
        raise _which_rows(where, how, lines, kinds)
    before = [(k, line) for k, line in enumerate(lines[: lines.index(row)], 1)]
    number, names, units = names_above(before, len(fields))
    at = f"{where}:{number or len(before) + 1}"
    choose(at, names, units, len(fields), how, facts(names, len(fields), ""))


def _which_rows(where: str, how: How, lines: Sequence[str], kinds: Mapping[str, int]) -> UsageError:
    """Return the error that asks which of several kinds of rows to read, and shows what each kind holds."""
    tables = [
        f"Rows that begin with {kind}. {columns_table(None, sample_of(lines, None, width, kind))}"
        for kind, width in list(kinds.items())[:MOST_TABLES]
    ]
    missing = [Missing(f"which rows are the gyroscope's (they begin with {', '.join(kinds)})", "--sensor ?")]
    for option, what, given in (
        ("--columns ?,?,?", "which of their columns are its axes", how.columns),
        ("--units ?", "their unit", how.units),
        ("--time-column ?", "their column of times (or --rate)", how.time_column or how.rate_hz),
    ):
        if given is None:
            missing.append(Missing(what, option))
    return not_stated(where, missing, given_options(how), "\n".join(tables))


def names_above(lines: Iterable[tuple[int, str]], width: int) -> NamesAbove:
    """Return the nearest header above rows of `width` fields: number of the line, names, and units."""
    units = None
    for number, line in reversed([*lines]):
        found = bare_fields(line)
        found = each if len(each := without_titles(found)) == width else found
        if len(found) != width or all_numbers(line) or is_number(found[0]) or WRONG_SUM in found:
            continue
        # such a line is no list of names: it states a rate or a unit in words
        if separator_of(line) is None and any(stated_in(line)):
            continue
        if units is None and units_in(line) is not None:
            units = found
        elif sum(map(is_number, found)) <= width // 2:
            return number, found, units
    return None, None, None
