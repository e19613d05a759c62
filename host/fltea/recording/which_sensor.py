"""Finds the column that shows which of several sensors a row is from, and chooses the sensor to read."""

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from fltea.recording.column_names import accel_axis_of, axis_of, is_time, states_units, tells_sensors, unit_in
from fltea.recording.dialects import columns_of
from fltea.recording.evidence import Choice
from fltea.recording.one_sensor import MOST_IN_TURN, MOST_SENSORS, tells_apart, which_of
from fltea.recording.sample_times import Floats, Marks
from fltea.recording.units import is_physical
from fltea.recording.wanted import is_number
from fltea.records.errors import UsageError

MOST_TURNS = 16
MOST_SHOWN, MOST_FIGURES = 8, 6
"""The table that shows the sensors to the user has at most MOST_SHOWN sensors, and at most MOST_FIGURES
columns.
"""


def choose_sensor(choice: Choice, tag: str, gyro: Sequence[int]) -> tuple[int, str | None] | None:
    """Find the column that distinguishes sensors, and the sensor to read; None if there is no such column.

    Only the first rows of the file are examined. Columns and units are then chosen by the rows of one sensor
    only. This is the sensor to read. If the user still has to name it, it is the one with the most rows.

    `tag`: first field of the rows, in files with rows of several kinds. `gyro`: columns of the axes.

    Raises:
        UsageError: the sensor that the user names is unknown.
    """
    given = choice.how.topic
    if given is not None and (turns := _turns(given)):
        choice.turn = turns
        which = f"row {turns[0] + 1} of every {turns[1]}" if turns[1] > 1 else "all rows are of one"
        choice.answer("sensor", which, "given", "--sensor")
        _only(choice, np.arange(len(choice.facts.sample())) % turns[1] == turns[0])
        return None
    column, mark, value = (given or "").rpartition("=")
    if mark and (place := _place_of(choice, column)) is not None:
        return _read(choice, place, value, column)
    if tag:
        if given is not None:
            choice.answer("rows", f"those that begin with {tag}", "given", "--sensor")
        elif choice.dialect is not None and choice.dialect.tag:
            choice.answer("rows", f"those that begin with {tag}", "dialect", choice.dialect.name)
        return 0, tag
    named = [place for place in _named(choice) if not _counts(choice, place)]
    if given is not None:
        return _of_value(choice, given, named, gyro)
    told = (*named, *_measured(choice, gyro))
    several = (place for place in told if len({*_cells(choice, place)} - {""}) > 1)
    if (place := next(several, None)) is not None:
        _ask(choice, place, gyro)
        return place, None
    return (named[0], None) if named else None


def _of_value(
    choice: Choice, value: str, named: Sequence[int], gyro: Sequence[int]
) -> tuple[int, str | None]:
    """Find the column that contains the sensor name that the user gives."""
    holding = [place for place in (*named, *_measured(choice, gyro)) if value in _cells(choice, place)]
    if not holding and not named and not is_number(value):
        others = [place for place in range(len(choice.names)) if place not in gyro]
        holding = [place for place in others if value in _cells(choice, place)]
    if not (holding or named):
        raise UsageError(
            f"{choice.where}: --sensor {value}: no column is known that tells sensors apart. Name it: "
            "--sensor COLUMN=VALUE, or give --sensor 1/2 for the first of two whose rows take turns."
        )
    place = (holding or list(named))[0]
    return _read(choice, place, value, choice.names[place])


def _read(choice: Choice, place: int, value: str, column: str) -> tuple[int, str]:
    choice.answer("sensor", f"{column} is {value}", "given", "--sensor")
    _only(choice, np.array([cell == value for cell in _cells(choice, place)], np.bool_))
    return place, value


def _place_of(choice: Choice, column: str) -> int | None:
    """Return the column that the user names by label, name, or position from 1; None if it does not exist."""
    for known in (choice.labels, choice.names):
        if column in known:
            return known.index(column)
    inner = [place for place, name in enumerate(choice.names) if name.endswith(f".{column}")]
    if len(inner) == 1:
        return inner[0]
    is_position = column.isdecimal() and 1 <= int(column) <= len(choice.names)
    return int(column) - 1 if is_position else None


def _named(choice: Choice) -> list[int]:
    """Return the columns that, by their names, tell the sensor of a row; then those that state a unit.

    If the logger's dialect says which column tells the sensor, return only this column.
    """
    pattern = choice.dialect.sensor if choice.dialect is not None else ""
    if pattern and (found := columns_of([[pattern]], choice.names)):
        return [found[0]]
    wanted = {*choice.wanted.names}
    return [
        place
        for tells in (tells_sensors, states_units)
        for place, name in enumerate(choice.names)
        if tells(name) and choice.labels[place] not in wanted
    ]


def _counts(choice: Choice, place: int) -> bool:
    """Return whether a column is a counter: its values only rise, or it has too many different values."""
    cells = _cells(choice, place)
    if len({*cells}) > MOST_SENSORS:
        return True
    numbers = [float(cell) for cell in cells if is_number(cell) and "," not in cell]
    return len(numbers) == len(cells) >= 10 and bool((np.diff(numbers) > 0).all())


def _measured(choice: Choice, gyro: Sequence[int]) -> Iterator[int]:
    """Yield the columns whose values, by `tells_apart`, are the names or numbers of alternating sensors.

    Columns of times and of measurements are not examined.
    """
    values, names = choice.first_rows(), choice.names
    if values is None:
        return
    wanted, clock = {*choice.wanted.names}, None
    free: list[int] = []
    axes = [*gyro]
    seconds = {pair.whole for pairs in choice.split for pair in pairs}
    for place, (name, unit) in enumerate(zip(names, choice.units, strict=True)):
        if choice.labels[place] == choice.wanted.time or (clock is None and is_time(name)):
            clock = values[:, place]
        if axis_of(name, unit) or accel_axis_of(name, unit):
            axes.append(place)
        elif not (place in gyro or place in seconds or is_time(name) or is_physical(unit_in(name) or unit)):
            free += [] if choice.labels[place] in wanted else [place]
    if not axes:  # no axes are known, so columns of many values count as axes
        axes = [k for k in free if len(np.unique(values[:, k])) > MOST_IN_TURN]
    figures = values[:, axes]
    yield from (
        place for place in free if (cells := _cells(choice, place)) and tells_apart(cells, clock, figures)
    )


def _cells(choice: Choice, place: int) -> Sequence[str]:
    cells = choice.facts.cells(place)
    return cells if len(cells) == len(choice.facts.sample()) else ()


def _only(choice: Choice, marks: Marks) -> None:
    """Keep only the marked rows among the file's first rows. Columns and units are then chosen by them."""
    values = choice.facts.sample()
    if len(marks) == len(values) and marks.any():
        values, all_cells = values[marks], choice.facts.cells
        choice.facts = choice.facts._replace(
            sample=lambda: values,
            cells=lambda place: [cell for cell, of in zip(all_cells(place), marks, strict=False) if of],
        )
        choice.state_units()


def _ask(choice: Choice, place: int, gyro: Sequence[int]) -> None:
    """Ask the user which sensor to read, and show what the first rows of each sensor hold."""
    cells, values, name = np.array(_cells(choice, place)), choice.facts.sample(), choice.names[place]
    counts = Counter(cells[cells != ""].tolist())
    choice.asked.missing.append(which_of(name, counts))
    shown = list(gyro) or [k for k in range(len(choice.names)) if k != place and not is_time(choice.names[k])]
    lines = [f"The sensors by the column {name}, and what the first rows show of each (mean ± σ):"]
    for one in sorted(counts)[:MOST_SHOWN]:
        rows = values[cells == one]
        figures = [_figures(choice.names[k], rows[:, k]) for k in shown if np.isfinite(rows[:, k]).any()]
        lines.append(f"  --sensor {one}: {counts[one]} rows; {', '.join(figures[:MOST_FIGURES])}")
    (most, _), *_ = counts.most_common(1)
    lines.append(f"  --sensor 1/1: {name} tells something else, and all rows are of one sensor")
    choice.asked.tables.append("\n".join(lines))
    choice.asked.rows = f"The rest of this message shows rows with {name}={most}."
    _only(choice, cells == most)


def _figures(name: str, values: Floats) -> str:
    spread = np.nanstd(values) if np.nanmin(values) < np.nanmax(values) else 0.0
    return f"{name} {np.nanmean(values):.3g} ± {spread:.2g}"


def _turns(given: str) -> tuple[int, int] | None:
    """Return the index of a sensor, from 0, and the number of sensors that a text such as `1/2` states.

    Return None for other texts.
    """
    first, mark, count = given.partition("/")
    if not (mark and first.isdecimal() and count.isdecimal()):
        return None
    return (int(first) - 1, int(count)) if 1 <= int(first) <= int(count) <= MOST_TURNS else None
