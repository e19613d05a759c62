"""Finds groups of columns by the columns' names.

The column `left.gyro_x`, for instance, is in the group `left`.
"""

from collections.abc import Iterator, Mapping, Sequence

from fltea.recording.column_names import accel_axis_of, axis_of, is_time
from fltea.recording.files import LONGEST_NAME

DEEPEST = 4
"""Largest number of nested groups around a column that are examined."""


def group_of(name: str) -> str:
    """Return the path of the innermost group that a column is in; "" if it is in no group."""
    return name.rpartition(".")[0]


def around(name: str) -> list[str]:
    """Return the paths of the groups that contain a column, the innermost group first."""
    parts = name.split(".")[:-1]
    return [".".join(parts[:end]) for end in range(len(parts), 0, -1)]


def gyroscopes_in(names: Sequence[str], units: Sequence[str] = ()) -> dict[str, list[int]]:
    """Return, for each group that has gyroscope axes, the columns of these axes.

    The name of a group may identify the sensor: `gyroscope.x` is an axis of a gyroscope, and
    `accelerometer.x` is not. Several such groups, for instance `gyro1` and `gyro2`, are separate gyroscopes.
    """
    groups: dict[str, list[tuple[int, str]]] = {}
    for place, name in enumerate(names):
        unit = units[place] if units else ""
        for group, inner in inner_names(name):
            if (axis := axis_of(inner, unit)) is not None and not (
                "." not in inner and is_of_accelerometer(name)
            ):
                groups.setdefault(group, []).append((place, axis))
                break
    found: dict[str, list[int]] = {}
    for group, axes in groups.items():
        is_one = len({axis for _, axis in axes}) == len(axes)
        for place, _ in axes:
            found.setdefault(group if is_one else group_of(names[place]), []).append(place)
    return found


def is_of_accelerometer(name: str) -> bool:
    """Return whether a column's name, alone or with those of its groups, is that of an accelerometer axis."""
    return any(accel_axis_of(inner) is not None for _, inner in inner_names(name))


def tells_gyroscope(group: str) -> bool:
    """Return whether a group's name alone shows that the group is a gyroscope."""
    return axis_of(f"{group.rpartition('.')[2]}_x") is not None


def with_clocks(names: Sequence[str], of: Sequence[str]) -> list[str]:
    """Return the groups of columns that hold a sensor with its own column of times, without the groups `of`.

    Such a sensor was sampled at other times than the sensors in `of`, so their rows do not belong together.
    The result is empty if no column of times is in a group of `of` or outside all groups.
    """
    times = {group_of(name) for name in names if is_time(name.rpartition(".")[2])}
    if not times & {*of, ""}:
        return []
    sensors = {
        group
        for name in names
        if is_of_accelerometer(name) or any(axis_of(inner) for _, inner in inner_names(name))
        for group in around(name)
    }
    return [one for one in times & sensors if one and one not in of]


def short_names(
    names: Sequence[str], of: Sequence[str], fixed: Mapping[int, str], keep: Sequence[int]
) -> dict[int, str]:
    """Return names of columns without the names of their groups, by column index.

    `of`: groups whose names are left out, the innermost first: with `imu`, `imu.gx` becomes `gx`. `fixed`:
    names to use for certain columns instead. `keep`: the columns wanted. If several columns would get the
    same name, the result has only the column in the innermost group.
    """
    found: dict[int, tuple[int, str]] = {}
    nearest = dict.fromkeys(fixed.values(), -1)
    for place in keep:
        name = names[place]
        level = next((k for k, group in enumerate(of) if name.startswith(f"{group}.")), len(of))
        short = name.removeprefix(f"{of[level]}.") if level < len(of) else name
        found[place] = (-1, fixed[place]) if place in fixed else (level, short)
        nearest[found[place][1]] = min(nearest.get(found[place][1], level), found[place][0])
    return {place: short for place, (level, short) in found.items() if level == nearest[short]}


def inner_names(name: str) -> Iterator[tuple[str, str]]:
    """Yield the groups around a column, the innermost first, each with the rest of the column's name.

    For `a.b.x`, these are `a.b` with `x`, then `a` with `b.x`, then "" with `a.b.x`.
    """
    parts = name.split(".") if len(name) < LONGEST_NAME else [name]
    for first in range(len(parts) - 1, max(-1, len(parts) - 1 - DEEPEST), -1):
        yield ".".join(parts[:first]), ".".join(parts[first:])
