"""Groups of columns by their names, as files hold them: `left.gyro_x` is in `left` (pure)."""

from collections.abc import Iterator, Mapping, Sequence

from fltea.recording.column_names import accel_axis_of, axis_of, is_time
from fltea.recording.files import LONGEST_NAME

DEEPEST = 4
"""Groups around a column that are looked at."""


def group_of(name: str) -> str:
    """Return the path of the group that a column is in, "" where it is in none."""
    return name.rpartition(".")[0]


def around(name: str) -> list[str]:
    """Return the paths of the groups that a column is in, the nearest first."""
    parts = name.split(".")[:-1]
    return [".".join(parts[:end]) for end in range(len(parts), 0, -1)]


def gyroscopes_in(names: Sequence[str], units: Sequence[str] = ()) -> dict[str, list[int]]:
    """Return the places of the axes of gyroscopes, by their group.

    What the group is called may tell the sensor: `gyroscope.x` is an axis, and `accelerometer.x` is none. If
    several groups do, as `gyro1` and `gyro2`, each is one.
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
    """Whether a column or the group that it is in is called as an axis of an accelerometer is."""
    return any(accel_axis_of(inner) is not None for _, inner in inner_names(name))


def tells_gyroscope(group: str) -> bool:
    """Whether a group is called as a gyroscope is, whatever is in it."""
    return axis_of(f"{group.rpartition('.')[2]}_x") is not None


def with_clocks(names: Sequence[str], of: Sequence[str]) -> list[str]:
    """Return the groups of other sensors that have times of their own, if the groups `of` ours have some.

    Which of their rows belong to which of ours is then not known.
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
    """Return what columns are called from within the groups `of`, the nearest first, by their places.

    fixed: names that stay. keep: places of all; those that are called as one that is nearer are left out.
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
    """Yield the groups around a column, the nearest first, and the rest of its name."""
    parts = name.split(".") if len(name) < LONGEST_NAME else [name]
    for first in range(len(parts) - 1, max(-1, len(parts) - 1 - DEEPEST), -1):
        yield ".".join(parts[:first]), ".".join(parts[first:])
