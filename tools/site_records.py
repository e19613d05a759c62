"""Writes the site's tables of all records, and their JSON Schema, from the records' declarations."""

import ast
import functools
import inspect
import textwrap
from collections.abc import Iterator
from typing import get_args

import msgspec
from fltea.records import device_fit, estimate, fit, stats
from fltea.records import records as record_module
from fltea.records.fit import Interval
from fltea.records.records import AnyRecord, Placed, Record
from msgspec import inspect as types

from tools.site_settings import cell, code

WORDS: dict[type, str] = {
    types.IntType: "integer",
    types.FloatType: "number",
    types.StrType: "string",
    types.LiteralType: "string",
    types.BoolType: "boolean",
    types.NoneType: "null",
    types.StructType: "object",
    types.ListType: "list",
    types.VarTupleType: "list",
}
TABLE = "\n| field | type | meaning |\n|---|---|---|\n"
Rows = Iterator[tuple[str, str, str]]


@functools.cache
def texts(struct: type) -> dict[str, str]:
    """Return the docstring of each field of a struct and of its base classes."""
    found: dict[str, str] = {}
    for owner in reversed(struct.__mro__):
        if issubclass(owner, msgspec.Struct) and owner is not msgspec.Struct:
            (tree,) = ast.parse(textwrap.dedent(inspect.getsource(owner))).body
            assert isinstance(tree, ast.ClassDef)
            for field, below in zip(tree.body, tree.body[1:], strict=False):
                match field, below:
                    case ast.AnnAssign(ast.Name(name)), ast.Expr(ast.Constant(str() as text)):
                        found[name] = " ".join(text.split())
    return found


def _text(struct: type, field: str) -> str:
    text = texts(struct).get(field)
    if text is None:
        raise LookupError(f"{struct.__module__}.{struct.__name__}: write a text below the field `{field}`")
    return text


def records() -> str:
    """Return a section for each record, with a table of its fields and of the fields inside them."""
    common = [("class", "string", "Name of the record, such as `hello`."), *rows(Placed, own=False)]
    page = [
        "## In all records\n\nRecords have those of these fields that their class can know.\n"
        + _table(common)
    ]
    page += [
        f"## `{struct.__struct_config__.tag}`\n\n{inspect.getdoc(struct)}\n{_table(rows(struct))}"
        for struct in get_args(AnyRecord)
    ]
    return "\n".join(page)


def rows(struct: type[msgspec.Struct], path: str = "", *, own: bool = True) -> Rows:
    """Yield path, type and meaning of each field.

    `own`: True for the record's own fields; False also yields those that all records have.
    """
    info = types.type_info(struct)
    assert isinstance(info, types.StructType)
    shown = {
        name
        for base in struct.__mro__
        if base not in (Placed, Record)
        for name in inspect.get_annotations(base)
    }
    seen: set[type] = set()
    for field in info.fields:
        if not own or field.name in shown:
            yield from _of(path + field.encode_name, field.type, _text(struct, field.name), seen)


def _of(path: str, kind: types.Type, text: str, seen: set[type]) -> Rows:
    kinds = kind.types if isinstance(kind, types.UnionType) else (kind,)
    for one in kinds:
        if isinstance(one, types.DictType):
            yield from _of(f"{path}.<{_key(path, one)}>", one.value_type, text, seen)
            return
    parts = [one.cls for one in kinds if isinstance(one, types.StructType)]
    words = ["interval" if Interval in parts else WORDS[type(one)] for one in kinds]
    yield path, " or ".join(words), text
    for part in parts:
        if part is not Interval and part not in seen:
            seen.add(part)
            yield from rows(part, f"{path}.")


def _key(path: str, kind: types.DictType) -> str:
    """Return the word that stands for all keys of an object, such as "axis" in `axes.<axis>.bias`."""
    name = path.rpartition(".")[2]
    if isinstance(kind.key_type, types.IntType):
        return "t"
    by_axis = name in ("axes", "restarts") or isinstance(kind.value_type, types.DictType)
    return "output" if name == "outputs" else "axis" if by_axis else "reason"


def _table(found: Rows | list[tuple[str, str, str]]) -> str:
    return TABLE + "".join(f"| {code(path)} | {kind} | {cell(text)} |\n" for path, kind, text in found)


def schema() -> str:
    """Return the JSON Schema of all records as the program writes them, with the meaning of each field."""
    (top,), parts = msgspec.json.schema_components([AnyRecord], ref_template="#/$defs/{name}")
    structs = {
        one.__name__: one
        for module in (record_module, estimate, stats, fit, device_fit)
        for one in vars(module).values()
        if isinstance(one, type) and issubclass(one, msgspec.Struct)
    }
    for name, part in parts.items():
        for field, text in texts(structs[name]).items():
            part["properties"][field]["description"] = text
    whole = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "fltea's records", **top}
    return msgspec.json.format(msgspec.json.encode({**whole, "$defs": parts}), indent=1).decode() + "\n"
