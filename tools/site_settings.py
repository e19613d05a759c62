"""The tables of all settings on the site, written from the structs that read the TOML file."""

import html
import re
from collections.abc import Iterator
from typing import Any

import msgspec
from fltea.settings.config import Config
from msgspec import inspect as types


def cell(text: str) -> str:
    """Return text as one cell of a table."""
    return re.sub(r"(?<!\\)\|", r"\\|", " ".join(text.split())).replace("<", "&lt;")


def code(text: str) -> str:
    """Return text as code in a cell of a table."""
    return (
        f"<code>{html.escape(text, quote=False).replace('|', '&#124;')}</code>"
        if "|" in text
        else f"`{text}`"
    )


def settings() -> str:
    """Every setting of `Config`, table by table of its TOML file."""
    text: list[str] = []
    for path, struct in tables(Config):
        text += ["", f"## [{path}]" if path else "## At the top of the file", ""]
        docs = explained(struct)
        text += [_first(struct), "", "| setting | takes | default | meaning |", "|---|---|---|---|"]
        for field in fields(struct):
            name = field.encode_name
            shown = f"{path}.{name}" if path else name
            row = (code(shown), cell(takes(field.type)), code(default_of(field)), cell(docs.get(name, "")))
            text.append(f"| {' | '.join(row)} |")
    return "\n".join(text)


def tables(struct: type[msgspec.Struct], path: str = "") -> Iterator[tuple[str, type[msgspec.Struct]]]:
    """Yield every table of the TOML file with the struct that reads it; the file itself has no name."""
    yield path, struct
    for field in _all_fields(struct):
        below = _struct_of(field.type)
        if below is not None:
            yield from tables(below, f"{path}.{field.encode_name}" if path else field.encode_name)


def fields(struct: type[msgspec.Struct]) -> list[types.Field]:
    """Return the settings of a table, without the tables in it."""
    return [field for field in _all_fields(struct) if _struct_of(field.type) is None]


def _all_fields(struct: type[msgspec.Struct]) -> tuple[types.Field, ...]:
    found = types.type_info(struct)
    assert isinstance(found, types.StructType)
    return found.fields


def _struct_of(kind: types.Type) -> type[msgspec.Struct] | None:
    return kind.cls if isinstance(kind, types.StructType) else None


def takes(kind: types.Type) -> str:
    """Return what a setting takes, in words."""
    if isinstance(kind, types.UnionType):
        return ", or ".join(takes(one) for one in kind.types if not isinstance(one, types.NoneType))
    if isinstance(kind, types.LiteralType):
        return ", ".join(f"`{value}`" for value in kind.values)
    if isinstance(kind, types.ListType | types.VarTupleType):
        return f"list of {takes(kind.item_type)}"
    if isinstance(kind, types.DictType):
        return "tables"
    words = {
        types.StrType: "text",
        types.IntType: "integer",
        types.FloatType: "number",
        types.BoolType: "true or false",
    }
    return words.get(type(kind), type(kind).__name__.removesuffix("Type").lower())


def default_of(field: types.Field) -> str:
    """Return the default as TOML writes it."""
    default: Any = field.default
    if default is msgspec.NODEFAULT:
        default = field.default_factory() if field.default_factory is not msgspec.NODEFAULT else None
    if default is None:
        return "unset"
    return msgspec.json.encode(default).decode()


def explained(struct: type[msgspec.Struct]) -> dict[str, str]:
    """Return what the docstrings say of each setting: `name: text.` or `name, other: text.`."""
    names = {field.encode_name for field in _all_fields(struct)}
    found: dict[str, str] = {}
    own = [cls for cls in struct.__mro__ if cls not in (msgspec.Struct, object)]
    for cls in reversed(own):
        text = " ".join((cls.__dict__.get("__doc__") or "").split())
        marks = re.finditer(r"(?:^|(?<=[.;] ))((?:\w+)(?:, \w+)*): ", text)
        starts = [mark for mark in marks if names & set(mark[1].split(", "))]
        for start, after in zip(starts, [*starts[1:], None], strict=False):
            meaning = text[start.end() : after.start() if after else None].strip().rstrip(";")
            for name in start[1].split(", "):
                if name in names:
                    found[name] = re.sub(r"\bNone\b", "unset", meaning[:1].upper() + meaning[1:])
    return found


def _first(struct: type[msgspec.Struct]) -> str:
    text = (struct.__doc__ or "").strip().split("\n\n")[0]
    sentences = re.split(r"(?<=[.;]) (?=\w+(?:, \w+)*: )", " ".join(text.split()))
    return cell(sentences[0])
