"""Finds a gyroscope's fields in messages by the fields' names, and their units in the file's texts."""

import re
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from fltea.recording.bag_definition import Definition
from fltea.recording.column_names import (
    accel_axis_of,
    accel_unit_of,
    axis_of,
    is_time,
    named_axis,
    rate_unit_of,
    split_seconds,
    time_scale_of,
)
from fltea.recording.groups import inner_names
from fltea.recording.reading import Evidence
from fltea.recording.sample_times import SECONDS
from fltea.recording.units import accel_unit, rate_unit, time_scale, time_unit
from fltea.records.errors import UsageError
from fltea.records.records import AXES

IS_IMU = re.compile(r"(?:ros\.)?sensor_msgs[./](?:msg[./])?Imu", re.ASCII)
"""Names of the type Imu in ROS 1, in ROS 2, and in programs that convert ROS messages to JSON or protobuf."""

_PLACE = re.compile(r"(.+)(?:\.([xyz])|\[([012])\])")
_LETTERS = "xyz", "XYZ", "012"
"""Letters or digits of the axes. The names of the three axes of a sensor differ only in this character."""

MOST_CHARS = 4000
"""Longest text that is searched for a unit [characters]."""

_CLAUSE_END = re.compile(r"[;,\n]|\.(?=\s|$)")
_NUMBER = re.compile(r"[^\w\s]*\d[\d.]*")
_NOT_OF_VALUES = re.compile(
    r"\b(?:ranges?|full[ -]?scale|scale factor|fsr?|sensitivity|resolution|limit(?:s|ed)?|max(?:imum)?"
    r"|minimum|threshold|saturat\w*|offset|density|lsbs?|counts?|up to|within|not|instead of|formerly"
    r"|previously|used to|multipl\w+|divided?|convert|converted from|conversion)\b|±|\+/-"
)
"""A unit near one of these words may not be the unit of the values, as in `range ±2000 deg/s`."""

UnitOf = Callable[[str], str | None]


class Said(NamedTuple):
    """A unit, and how it is known; the unit is "" where only the rest is used.

    `evidence`: how it is known, such as "stated" or "convention". `why`: text that says what states it.
    `against`: text on another unit that contradicts this one and what states it, or "".
    """

    unit: str
    evidence: Evidence
    why: str
    against: str = ""


# Why more than 12 attributes: each is a fact that the topic's type or first message states of all messages.
class Layout(NamedTuple):
    """Layout of a topic's messages: the names of the fields to read, and what is known of them.

    Attributes:
        gyro, accel: fields that hold the axes.
        by: how it is known that these fields are the axes.
        time: fields of the time (seconds and their fraction, or one number), or empty.
        time_s: unit of each field of the time [s], empty if unknown.
        rate, accel_unit: units of rates and accelerations, None if unknown.
        unread: other fields whose names look like those of a sensor.
        definitions: possible definitions of the ROS type. Each message is read by the first that fits it.
        is_known: whether the message type is made for inertial sensors.
        more: fields that are read besides time and axes, such as a scale in a PX4 message.
        tell: if several sensors send to one topic, the fields whose names show that they distinguish them.
        others: fields that perhaps distinguish such sensors, too.
        several: names of the gyroscopes in one message, if the user has to choose one.
        fixed: fields that hold the name of a unit, with this name. Messages with another name are left out.
        changed: a scale or offset that may still have to be applied to the rates, "" if none is stated.
    """

    gyro: tuple[str, ...]
    accel: tuple[str, ...]
    time: tuple[str, ...]
    time_s: tuple[float, ...]
    rate: Said | None
    accel_unit: Said | None
    by: Said
    unread: tuple[str, ...] = ()
    definitions: tuple[Definition, ...] = ()
    is_known: bool = True
    more: tuple[str, ...] = ()
    tell: tuple[str, ...] = ()
    others: tuple[str, ...] = ()
    several: tuple[str, ...] = ()
    fixed: tuple[tuple[str, str], ...] = ()
    changed: str = ""


class Texts(NamedTuple):
    """Functions that take the name of a field and return what the file says about it.

    `words`: descriptions of the field and of the fields that contain it, the innermost first. `unit`: text in
    the message that names the field's unit; another field, next to this one, holds it.
    """

    words: Callable[[str], Iterable[str]] = lambda _: ()
    unit: Callable[[str], str] = lambda _: ""


NO_TEXTS = Texts()


def title(names: Sequence[str]) -> str:
    """Return the names of three axes in a short form for messages, such as `angular_velocity.x, .y, .z`."""
    begin = names[0][:-1]
    if begin and all(name[:-1] == begin for name in names) and begin[-1] in "._":
        return ", ".join([names[0], *(f"{begin[-1]}{name[-1]}" for name in names[1:])])
    return ", ".join(names)


def by_convention(kind: str) -> tuple[Said | None, Said | None]:
    """Return the units of rates and accelerations that a convention gives for a message type, or None."""
    if IS_IMU.fullmatch(kind) is None:
        return None, None
    why = f"{kind} (REP 103)"
    return Said("rad/s", "convention", why), Said("m/s^2", "convention", why)


def named_layout(
    names: Sequence[str], kind: str, texts: Texts = NO_TEXTS, sensor: str | None = None
) -> Layout | None:
    """Return the layout of messages with fields of these names; None if these include no gyroscope's axes.

    `kind`: message type. `sensor`: the gyroscope to read if a message holds several.

    Raises:
        UsageError: the axes of one sensor state different units.
    """
    gyros, accels = _triples(names, axis_of), _triples(names, accel_axis_of)
    if not gyros:
        return None
    called = _called(list(gyros)) if len(gyros) > 1 else {}
    label = called.get(sensor or "", next(iter(gyros)))
    gyro, group = gyros[label], label.rpartition(".")[0]
    near = [one for one in accels if not called or one.rpartition(".")[0] == group]
    accel = accels[near[0]] if len(near) == 1 else ()
    inside = [name for name in names if called and name.startswith(f"{group}.")]
    time, time_s = _clock([*inside, *names], texts)
    rate, accel_said = by_convention(kind)
    by = Said("", "convention", kind) if rate is not None else Said("", "stated", "their names")
    return Layout(
        gyro,
        accel,
        time,
        time_s,
        _stated(gyro, rate_unit_of, texts, _rate_unit) or rate,
        _stated(accel, _accel_unit_of, texts, _accel_unit) or accel_said,
        Said("", "given", "--sensor") if sensor in called else by,
        tuple(title(axes) for axes in (*gyros.values(), *accels.values()) if axes not in (gyro, accel)),
        several=() if sensor in called else tuple(called)[: len(gyros)] if called else (),
    )


def _spoken(name: str) -> str:
    """Return the name of an axis in the form of a column's name: `gyro_dps.x` becomes `gyro_x_dps`."""
    found = _PLACE.fullmatch(name)
    return name if found is None else named_axis(found[1], "xyz012".index(found[2] or found[3]) % len(AXES))


def _triples(names: Sequence[str], axis_in: UnitOf) -> dict[str, tuple[str, ...]]:
    """Return the fields of the axes x, y, z of each sensor. The key is the common part of their names."""
    axes = {
        name: axis
        for name in names
        for axis in filter(None, (axis_in(_spoken(inner)) for _, inner in inner_names(name)))
    }
    of = [[name for name, one in axes.items() if one == axis] for axis in "xyz"]
    if all(len(found) == 1 for found in of):
        return {_without(of[0][0], len(of[0][0]) - 1): tuple(found[0] for found in of)}
    found = {}
    for name in of[0]:
        for at, letters in ((k, some) for k, char in enumerate(name) for some in _LETTERS if char == some[0]):
            three = tuple(f"{name[:at]}{letter}{name[at + 1 :]}" for letter in letters)
            if [axes.get(one) for one in three] == [*"xyz"]:
                found[_without(name, at)] = three
    return found


def _without(name: str, at: int) -> str:
    """Return the name of an axis's field without the letter of the axis at index `at`."""
    return re.sub(r"([._])[._]+", r"\1", name[:at].rstrip("[") + name[at + 1 :].lstrip("]")).strip("._")


def _called(labels: Sequence[str]) -> dict[str, str]:
    """Return the names by which a user may choose a gyroscope, each with the label of that gyroscope.

    A gyroscope's name is its label, which is the common part of its fields' names. The name of the group of
    fields around it is another name, if that group has no other gyroscope.
    """
    groups = [label.rpartition(".")[0] for label in labels]
    by_group = zip(groups, labels, strict=True) if len({*groups} - {""}) == len(groups) else ()
    return {**dict(by_group), **{label: label for label in labels}}


def _clock(names: Sequence[str], texts: Texts) -> tuple[tuple[str, ...], tuple[float, ...]]:
    for whole, (fine, unit_s) in split_seconds(names).items():
        return (names[whole], names[fine]), (1.0, unit_s)
    for name in filter(is_time, names):
        in_words = _in_words([name], texts, time_unit)
        said = time_scale_of(name) or time_scale(texts.unit(name)) or time_scale(in_words or "")
        return (name,), () if said is None else (SECONDS[said[0]] * said[1],)
    return (), ()


def _stated(names: Sequence[str], in_name: UnitOf, texts: Texts, unit_of: UnitOf) -> Said | None:
    """Return the unit of a sensor's axes.

    The unit is stated by the axes' names, by a field of units in the messages, or by the schema.
    """
    said: list[Said] = []
    for why, units in (
        ("the name {}", [in_name(_spoken(name)) for name in names]),
        ("the unit beside {} in the messages", [unit_of(texts.unit(name)) for name in names]),
    ):
        known = {name: unit for name, unit in zip(names, units, strict=True) if unit is not None}
        if len({*known.values()}) > 1:
            each = ", ".join(f"{name} in {unit}" for name, unit in known.items())
            raise UsageError(f"the axes of one sensor are in different units: {each}.")
        said += [Said(unit, "stated", why.format(name)) for name, unit in [*known.items()][:1]]
    if names and (in_words := _in_words(names, texts, unit_of)) is not None:
        said.append(Said(in_words, "stated", f"what the schema says of {title(names)}"))
    against = next((f"{one.unit} by {one.why}" for one in said if one.unit != said[0].unit), "")
    return said[0]._replace(against=against) if said else None


def _in_words(names: Sequence[str], texts: Texts, unit_of: UnitOf) -> str | None:
    """Return the unit that the schema's texts state for these fields; None if the fields differ.

    For each field, the innermost text with a unit counts.
    """
    found = set()
    for name in names:
        units = filter(None, (units_in(text, unit_of) for text in texts.words(name)))
        found.add(frozenset(next(units, set())))
    (only,) = found if len(found) == 1 else (frozenset(),)
    return next(iter(only)) if len(only) == 1 else None


def units_in(text: str, unit_of: UnitOf) -> set[str]:
    """Return the units that `text` names as units of values. A unit may have up to three words.

    Units of ranges and sensitivities, and units after a number, are ignored.
    """
    found = set[str]()
    for clause in _CLAUSE_END.split(text[:MOST_CHARS]):
        words = re.findall(r"[^\s:()\[\]]+", clause)
        taken = set(range(len(words))) if _NOT_OF_VALUES.search(clause.lower()) else set[int]()
        for size in (3, 2, 1):
            for at in range(len(words) - size + 1):
                unit = None if at in taken else unit_of(" ".join(words[at : at + size]).rstrip("."))
                if unit is not None:
                    taken.update(range(at, at + size))
                    found |= set() if at and _NUMBER.fullmatch(words[at - 1]) else {unit}
    return found


def _rate_unit(text: str) -> str | None:
    return text if text.startswith("lsb:") else rate_unit(text)


def _accel_unit(text: str) -> str | None:
    return _accel_name(accel_unit(text))


def _accel_unit_of(name: str) -> str | None:
    return _accel_name(accel_unit_of(name))


def _accel_name(ms2: float | None) -> str | None:
    if ms2 is None:
        return None
    known = (name for name in ("m/s^2", "g", "mg", "mm/s^2") if accel_unit(name) == ms2)
    return next(known, f"{ms2:g} m/s^2")
