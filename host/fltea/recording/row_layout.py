"""The layout of a text's rows: where each number stands. Says why a line does not fit the layout."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from fltea.recording.columns import Chosen
from fltea.recording.files import Note
from fltea.recording.raw_lines import shown
from fltea.recording.wanted import is_missing, is_number


class Layout(NamedTuple):
    """The layout of the rows in a text, which says where in a row each number stands.

    `separator`: text between two fields; None means white space. `parse`: function that returns the numbers
    in a line by name, for JSON objects and labelled lines; else None. `usual`: number of fields in the first
    row. `least`: a line with fewer fields is no row. `most`: number of columns; a row with numbers in more
    fields is refused. `begin`: line number of the first row, from 1. `notes`: warnings for the user. `again`:
    the line of column names, and the line of units. If such a line occurs again among the rows, it is
    skipped.
    """

    chosen: Chosen
    separator: str | None
    parse: Callable[[str], Mapping[str, Any]] | None
    usual: int
    least: int
    most: int
    begin: int
    notes: tuple[Note, ...] = ()
    again: tuple[str, ...] = ()


def layout_of(
    chosen: Chosen,
    separator: str | None,
    fields: Sequence[str],
    columns: int,
    number: int,
    notes: tuple[Note, ...] = (),
    again: tuple[str, ...] = (),
) -> Layout:
    """Return the layout of a text by the fields of its first row, which is line `number`."""
    filled = len(fields)
    while filled and not fields[filled - 1].strip():
        filled -= 1
    least = max(min(filled, columns), max(chosen.needed) + 1)
    return Layout(chosen, separator, None, len(fields), least, columns, number, notes, again)


def why_too_many(fields: Sequence[str], columns: int) -> str:
    """Return why a row is refused if it has numbers in more fields than there are columns, else "".

    Such a row may have decimal commas that were taken for separators, as in `1,5,2,5`.
    """
    if not any(map(is_number, fields[columns:])):
        return ""
    return (
        f"has {len(fields)} fields, and there are {columns} columns. If the numbers have decimal commas, "
        "separate the columns by ';' or write decimal points."
    )


def why_no_row(chosen: Chosen, fields: Sequence[str], separator: str | None) -> str:
    """Return why the needed numbers cannot be read from a row's fields; "" if they can be read.

    Words for missing numbers, such as `nan`, can be read.
    """
    for place, name in zip(chosen.needed, chosen.read, strict=False):
        if place >= len(fields):
            return f"has {len(fields)} fields; column {shown(name)} is number {place + 1}."
        field = fields[place].strip()
        in_quotes = separator == "," and "," in field
        if is_missing(field) or (is_number(field) and not in_quotes):
            continue
        hint = ""
        if in_quotes and is_number(field):
            hint = " Decimal commas are read where ';', a tab or blanks separate the columns."
        elif place == chosen.time:
            hint = " Times as text are not read, so give the rate: --rate ?"
        return f"column {shown(name)}: {shown(field)} is not a number.{hint}"
    return ""
