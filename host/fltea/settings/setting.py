"""Declare each setting once, as a field of the struct for its table in the TOML file.

    target: Annotated[float, Setting("Half the width of α's interval.", least=0.001, most=1)] = 0.05

The field gives the setting's name, type and default. Meaning, unit, range and flag are in a `Setting` that
annotates the type. All of the following use these declarations: the reader of TOML, `--set`, the flags of
`fltea run`, the checks, the tables of the documentation, and the generator of the board's header. The range
is not declared by msgspec's `Meta`, for three reasons: `Meta` is ignored when a struct is made in Python, it
accepts NaN, and its message states neither unit nor value.
"""

import math
from collections.abc import Iterator
from dataclasses import KW_ONLY, dataclass
from functools import cache
from typing import Any, NamedTuple, get_type_hints

import msgspec
from msgspec import inspect as types

from fltea.settings.duration import EXAMPLE, in_seconds

END = 2.0**63
"""Largest absolute value of a number if the setting states no limit. Whole numbers beyond it do not fit into
64 bits.
"""

MOST_SHOWN = 200
"""A message quotes at most this number of characters from a wrong value."""


@dataclass(frozen=True)
class Setting:
    """Declaration of a setting, except its name, type and default.

    A number is allowed if it is at least `least`, at most `most`, and greater than `above`.
    """

    meaning: str
    """one or two sentences, shown in the help of the flag and in tables of the documentation"""
    _: KW_ONLY
    unit: str = ""
    least: float = -END
    above: float = -math.inf
    most: float = END
    text: str = ""
    """what a value that is text must be, such as "the name of a folder". If this is given, the setting
    accepts no empty text.
    """
    time: bool = False
    """whether a value that is text must be a time, such as "30 s". The range applies to it only if `unit` is
    "s".
    """
    flags: tuple[str, ...] = ()
    """flags of `fltea run` that set the setting"""
    metavar: str = ""
    example: Any = None
    """a value for the documentation if there is no default"""
    board: bool = False
    """whether the firmware has the same default, in a header file that is generated from the settings"""

    def contains(self, number: Any) -> Any:
        """Return whether a number is in the allowed range. A number that is not finite is never in range.

        For an array, return an array with the answer for each element.
        """
        return (number >= self.least) & (number > self.above) & (number <= self.most)

    def accepts(self, value: Any) -> bool:
        """Return whether a value of the right type is allowed.

        A list is allowed if all its values are allowed.
        """
        if isinstance(value, list | tuple):
            return all(map(self.accepts, value))
        if isinstance(value, str):
            if not self.time:
                return "\0" not in value and (bool(value) or not self.text)
            seconds = in_seconds(value)
            return seconds is not None and (self.unit != "s" or bool(self.contains(seconds)))
        return value is None or isinstance(value, bool) or bool(self.contains(value))

    @property
    def range(self) -> str:
        """The range of allowed numbers in words, after a blank; empty if there is no range."""
        if self.least != -END:
            low = f"{self.least:.15g}"
            return f" from {low} to {self.most:.15g}" if self.most != END else f" of at least {low}"
        up = f" and up to {self.most:.15g}" if self.most != END else ""
        return f" above {self.above:g}{up}" if self.above > -math.inf else ""

    def words(self, kind: types.Type) -> list[str]:
        """Return what a value of type `kind` must be, in words, such as "a whole number from 1 to 9".

        If the type is a union, such as int | str, there is one text for each of its types.
        """
        if isinstance(kind, types.UnionType):
            parts = [part for one in kind.types for part in self.words(one)]
            return parts[1:] + parts[:1] if isinstance(kind.types[0], types.StrType) else parts
        unit = f" {self.unit}" if self.unit else ""
        match kind:
            case types.NoneType():
                return []
            case types.LiteralType():
                return [f'"{value}"' if isinstance(value, str) else str(value) for value in kind.values]
            case types.IntType():
                return [f"a whole number{self.range}{unit}"]
            case types.FloatType():
                return [f"a number{self.range or ' that is finite'}{unit}"]
            case types.BoolType():
                return ["true or false"]
            case types.StrType() if self.time:
                return [f'a time such as "{EXAMPLE}"' + (f"{self.range}{unit}" if unit == " s" else "")]
            case types.StrType():
                return [self.text or "text"]
            case types.ListType() | types.VarTupleType():
                inner = self.words(kind.item_type)
                if isinstance(kind.item_type, types.FloatType):
                    inner = ["such numbers"]
                return [f"a list of {_either(inner)}"]
        return ["a table"]


class Declared(NamedTuple):
    """A setting with its path, type and default."""

    path: str
    """names of the tables around the setting, and its own name, such as `estimator.order.Q0`"""
    kind: types.Type
    default: Any
    setting: Setting

    @property
    def name(self) -> str:
        """Last part of the setting's path, which is the setting's own name."""
        return self.path.rpartition(".")[2]

    @property
    def unit(self) -> str:
        """Unit of the setting. In settings of the accelerometer, deg/s is replaced by m/s²."""
        return of_sensor(self.path, self.setting.unit)

    @property
    def kinds(self) -> tuple[types.Type, ...]:
        """Types of values that the setting takes."""
        return self.kind.types if isinstance(self.kind, types.UnionType) else (self.kind,)

    @property
    def words(self) -> list[Any]:
        """The words or whole numbers among which the value must be; empty if the setting has no such list."""
        return [word for kind in self.kinds if isinstance(kind, types.LiteralType) for word in kind.values]

    @property
    def takes(self) -> str:
        """Description of the values that the setting takes, with range and unit."""
        return of_sensor(self.path, _either(self.setting.words(self.kind)))

    def accepts(self, value: Any) -> bool:
        """Return whether the setting takes `value`, which has one of its types."""
        words, is_number = self.words, types.FloatType in map(type, self.kinds)
        if words and isinstance(value, str if is_number else str | int):
            return value in words
        return self.setting.accepts(value)

    def wrong(self, value: Any) -> str:
        """Return the error message for a value that the setting does not take."""
        return f"{self.path} must be {self.takes}, got {shown(value)}"

    def read(self, text: str) -> Any:
        """Return the value that the text after a flag means.

        It is a number or list if the setting takes such values, else the text.
        """
        lists = [kind for kind in self.kinds if isinstance(kind, types.ListType | types.VarTupleType)]
        scalars = tuple(map(type, self.kinds))
        if lists and ("," in text or not {types.IntType, types.FloatType} & {*scalars}):
            parts = [part.strip() for part in text.split(",")]
            return [_scalar(part, (type(lists[0].item_type),)) for part in parts if part]
        return _scalar(text, scalars)


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of tables of settings.

    If a setting has a value that is not allowed, the constructor of the table raises a ValueError with the
    setting's name.
    """

    def __post_init__(self) -> None:
        for name, kind, setting in _declared_in(type(self)):
            value, own = getattr(self, name), Declared(name, kind, None, setting)
            if not own.accepts(value):
                raise ValueError(own.wrong(value))


def tables(table: Table, path: str = "") -> dict[str, Table]:
    """Return `table`, whose path is `path`, and all tables inside it, by path."""
    by_path = {path: table}
    for name in table.__struct_fields__:
        below = getattr(table, name)
        if isinstance(below, Table):
            by_path |= tables(below, joined(path, name))
    return by_path


def declared(table: Table, path: str = "") -> Iterator[Declared]:
    """Yield the settings of a table, but not those of tables inside it. `path`: path of the table."""
    for name, kind, setting in _declared_in(type(table)):
        yield Declared(joined(path, name), kind, getattr(table, name), setting)


def all_declared(table: Table) -> dict[str, Declared]:
    """Return all settings of a table and of the tables inside it, by path."""
    parts = tables(table).items()
    return {setting.path: setting for path, part in parts for setting in declared(part, path)}


@cache
def _declared_in(table: type[Table]) -> tuple[tuple[str, types.Type, Setting], ...]:
    hints = get_type_hints(table, include_extras=True)
    found = types.type_info(table)
    assert isinstance(found, types.StructType)
    return tuple(
        (field.name, field.type, extra)
        for field in found.fields
        for extra in getattr(hints[field.name], "__metadata__", ())
        if isinstance(extra, Setting)
    )


def joined(path: str, name: str) -> str:
    """Return the path of the setting or table `name` in the table at `path`.

    The path of the top table is empty.
    """
    return f"{path}.{name}" if path else name


def of_sensor(path: str, text: str) -> str:
    """Return a text about a setting. If the setting is the accelerometer's, deg/s is replaced by m/s²."""
    return text.replace("deg/s", "m/s²") if path.startswith("accel.") else text


def shown(value: Any) -> str:
    """Return a wrong value as text for a message, cut after `MOST_SHOWN` characters."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):
        return "a number of thousands of digits, or a list in lists without end"
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}…"


def _scalar(text: str, kinds: tuple[type[types.Type], ...]) -> Any:
    for kind, read in ((types.IntType, int), (types.FloatType, float)):
        if kind in kinds:
            try:
                return read(text)
            except ValueError:
                pass
    return {"true": True, "false": False}.get(text, text) if types.BoolType in kinds else text.strip()


def _either(words: list[str]) -> str:
    return " or ".join(words) if len(words) < 3 else f"{', '.join(words[:-1])} or {words[-1]}"
