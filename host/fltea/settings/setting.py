"""How a setting is declared, once: as a field of the struct of its table in the TOML file.

    target: Annotated[float, Setting("Half the width of α's interval.", least=0.001, most=1)] = 0.05

Name, type and default are the field's own. What it means, its unit, its range and its flag are a `Setting`
beside the type. The reader of TOML, `--set`, the flags of `fltea run`, the checks, the tables of the
documentation and the board's header all come from these. The range is not msgspec's `Meta`, which a struct
made in Python passes by, which lets NaN through, and whose message knows neither unit nor value.
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
"""No number goes so far whose setting has no end of its own: beyond, whole numbers have no room."""

MOST_SHOWN = 200
"""Characters of a wrong value that a sentence repeats."""


@dataclass(frozen=True)
class Setting:
    """All of a setting but name, type and default. A range includes its ends, but for `above`."""

    meaning: str
    """a sentence or two, for the help of a flag as well as for a table"""
    _: KW_ONLY
    unit: str = ""
    least: float = -END
    above: float = -math.inf
    most: float = END
    text: str = ""
    """what a text has to be, such as "the name of a folder"; it must then not be empty"""
    time: bool = False
    """whether a text is a time such as "30 s"; where nothing but a text is taken, the range is in `unit` s"""
    flags: tuple[str, ...] = ()
    """of `fltea run`"""
    metavar: str = ""
    example: Any = None
    """a value for documents, where there is no default"""
    board: bool = False
    """whether the board's header has this default too"""

    def contains(self, number: Any) -> Any:
        """Whether a number is in range, and so finite; of an array, for each of its numbers."""
        return (number >= self.least) & (number > self.above) & (number <= self.most)

    def accepts(self, value: Any) -> bool:
        """Whether a value of the right type can be used; of a list, each of its values."""
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
        """The range in words, with a blank before them; nothing where there is none."""
        if self.least != -END:
            low = f"{self.least:.15g}"
            return f" from {low} to {self.most:.15g}" if self.most != END else f" of at least {low}"
        up = f" and up to {self.most:.15g}" if self.most != END else ""
        return f" above {self.above:g}{up}" if self.above > -math.inf else ""

    def words(self, kind: types.Type) -> list[str]:
        """What a value of this type has to be, one text for each alternative."""
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
    """A setting where it is declared."""

    path: str
    """of its tables and itself, such as `estimator.order.Q0`"""
    kind: types.Type
    default: Any
    setting: Setting

    @property
    def name(self) -> str:
        """The last part of the path."""
        return self.path.rpartition(".")[2]

    @property
    def unit(self) -> str:
        """The unit, that of the accelerometer where it is of one."""
        return of_sensor(self.path, self.setting.unit)

    @property
    def kinds(self) -> tuple[types.Type, ...]:
        """The types that it takes, one or several."""
        return self.kind.types if isinstance(self.kind, types.UnionType) else (self.kind,)

    @property
    def words(self) -> list[Any]:
        """The words, or whole numbers, of which it takes one as they are."""
        return [word for one in self.kinds if isinstance(one, types.LiteralType) for word in one.values]

    @property
    def takes(self) -> str:
        """What it takes, in words, with range and unit."""
        return of_sensor(self.path, _either(self.setting.words(self.kind)))

    def accepts(self, value: Any) -> bool:
        """Whether it takes a value of a right type."""
        words, is_number = self.words, types.FloatType in map(type, self.kinds)
        if words and isinstance(value, str if is_number else str | int):
            return value in words
        return self.setting.accepts(value)

    def wrong(self, value: Any) -> str:
        """The one sentence about a value that it does not take."""
        return f"{self.path} must be {self.takes}, got {shown(value)}"

    def read(self, text: str) -> Any:
        """What the text of a flag means here: numbers and lists where they are taken, else the text."""
        lists = [one for one in self.kinds if isinstance(one, types.ListType | types.VarTupleType)]
        scalars = tuple(map(type, self.kinds))
        if lists and ("," in text or not {types.IntType, types.FloatType} & {*scalars}):
            parts = [part.strip() for part in text.split(",")]
            return [_scalar(part, (type(lists[0].item_type),)) for part in parts if part]
        return _scalar(text, scalars)


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of settings. ValueError names a setting that does not take its value."""

    def __post_init__(self) -> None:
        for name, kind, setting in _declared_in(type(self)):
            value, own = getattr(self, name), Declared(name, kind, None, setting)
            if not own.accepts(value):
                raise ValueError(own.wrong(value))


def tables(table: Table, path: str = "") -> dict[str, Table]:
    """The table at each path, this one (at `path`) and those in it, as they are by default."""
    found = {path: table}
    for name in table.__struct_fields__:
        below = getattr(table, name)
        if isinstance(below, Table):
            found |= tables(below, joined(path, name))
    return found


def declared(table: Table, path: str = "") -> Iterator[Declared]:
    """The settings of a table that lies at `path`, without those of tables in it."""
    for name, kind, setting in _declared_in(type(table)):
        yield Declared(joined(path, name), kind, getattr(table, name), setting)


def all_declared(table: Table) -> dict[str, Declared]:
    """Every setting of a table and of those in it, by its path."""
    return {one.path: one for path, part in tables(table).items() for one in declared(part, path)}


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
    """The path of what is called `name` in the table at `path`; the file itself has none."""
    return f"{path}.{name}" if path else name


def of_sensor(path: str, text: str) -> str:
    """A text on a setting with the unit of its sensor: the accelerometer has the gyroscope's settings."""
    return text.replace("deg/s", "m/s²") if path.startswith("accel.") else text


def shown(value: Any) -> str:
    """A wrong value as a sentence repeats it: whoever is wrong by accident is so within some characters."""
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
