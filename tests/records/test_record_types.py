"""Tests that a key has the same JSON type in all records.

Programs that read JSON into columns can then read all records of a run.
"""

import io
import typing
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pandas as pd
import polars as pl
import pyarrow.json
import pytest
from fltea.records.records import AnyRecord, Sample
from fltea.sinks.record_json import OBJECTS
from msgspec import inspect

from tests.rig.host_support import QUICK, fltea_here

CLASSES = typing.get_args(AnyRecord)


def members(of: inspect.Type) -> tuple[inspect.Type, ...]:
    return of.types if isinstance(of, inspect.UnionType) else (of,)


def kind(of: inspect.Type) -> str:
    """Return the name of a type in JSON, in which all numbers have the same type."""
    match of:
        case inspect.IntType() | inspect.FloatType():
            return "number"
        case inspect.BoolType():
            return "boolean"
        case inspect.StrType() | inspect.LiteralType():
            return "string"
        case inspect.ListType() | inspect.VarTupleType() | inspect.TupleType():
            return "array"
        case inspect.StructType() | inspect.DictType():
            return "object"
    raise TypeError(of)


def walk(of: inspect.Type, path: str) -> Iterator[tuple[str, str]]:
    """Yield the path and the JSON type of everything in a type. `*` stands for any key, `[]` for any item."""
    for one in members(of):
        if isinstance(one, inspect.NoneType):
            continue
        yield path, kind(one)
        match one:
            case inspect.StructType():
                for field in one.fields:
                    yield from walk(field.type, f"{path}.{field.encode_name}")
            case inspect.DictType():
                yield from walk(one.value_type, f"{path}.*")
            case inspect.ListType() | inspect.VarTupleType():
                yield from walk(one.item_type, f"{path}[]")
            case inspect.TupleType():
                for item in one.item_types:
                    yield from walk(item, f"{path}[]")


def test_a_key_has_one_type_in_all_records() -> None:
    found: dict[str, dict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    for record in CLASSES:
        for path, its in walk(inspect.type_info(record), ""):
            found[path][its].add(record.__name__)
    assert {path: dict(kinds) for path, kinds in found.items() if len(kinds) > 1} == {}


def absent(of: inspect.Type, key: str = "") -> Iterator[str]:
    """Yield the keys of a record whose value may be null in place of an object or a list."""
    some = [one for one in members(of) if not isinstance(one, inspect.NoneType)]
    for one in some:
        if len(some) < len(members(of)) and kind(one) in ("object", "array"):
            yield key
        match one:
            case inspect.StructType():
                for field in one.fields:
                    yield from absent(field.type, field.encode_name)
            case inspect.DictType():
                yield from absent(one.value_type, key)


def test_objects_that_may_be_absent_are_left_out_of_lines() -> None:
    """The record `sample` keeps its accelerometer even if it is null, since it is then null in all lines of
    the run.
    """
    found = {key for record in CLASSES if record is not Sample for key in absent(inspect.type_info(record))}
    assert found == set(OBJECTS)
    numbers = {
        path.rpartition(".")[2]
        for record in CLASSES
        for path, its in walk(inspect.type_info(record), "")
        if its not in ("object", "array")
    }
    assert not numbers & set(OBJECTS)


def filled(of: inspect.Type) -> Any:
    """Return an example of a type in which no field is null."""
    one = next(one for one in members(of) if not isinstance(one, inspect.NoneType))
    match one:
        case inspect.IntType():
            return 3
        case inspect.FloatType():
            return 2.5
        case inspect.BoolType():
            return True
        case inspect.StrType():
            return "a"
        case inspect.LiteralType():
            return one.values[0]
        case inspect.StructType():
            head = {one.tag_field: one.tag} if one.tag_field else {}
            return head | {field.encode_name: filled(field.type) for field in one.fields}
        case inspect.DictType():
            key = "gyro_x" if isinstance(one.key_type, inspect.StrType) else "60"
            return {key: filled(one.value_type)}
        case inspect.ListType() | inspect.VarTupleType():
            return [filled(one.item_type)] * 2
        case inspect.TupleType():
            return [filled(item) for item in one.item_types]
    raise TypeError(of)


def read_by_all(lines: bytes, path: Path) -> None:
    """Read JSON lines with three libraries; check that each finds all rows, and all keys as columns."""
    rows = [msgspec.json.decode(line) for line in lines.splitlines()]
    names = {name for row in rows for name in row}
    path.write_bytes(lines)
    arrow = pyarrow.json.read_json(path)
    assert (arrow.num_rows, set(arrow.column_names)) == (len(rows), names)
    frame = pl.read_ndjson(path, infer_schema_length=None)
    assert (frame.height, set(frame.columns)) == (len(rows), names)
    table = pd.read_json(io.BytesIO(lines), lines=True)
    assert (len(table), set(table.columns)) == (len(rows), names)
    for at, row in enumerate(rows):
        for found in (arrow.column("class")[at].as_py(), frame["class"][at], table["class"][at]):
            assert found == row["class"]


def test_all_records_with_all_fields_are_read_as_one_table(tmp_path: Path) -> None:
    records = [filled(inspect.type_info(record)) for record in CLASSES]
    for one in records:
        msgspec.convert(one, AnyRecord, strict=False)
    read_by_all(b"\n".join(map(msgspec.json.encode, [*records, *records])), tmp_path / "all.ndjson")


def test_a_key_of_two_types_is_found(tmp_path: Path) -> None:
    """A key with two JSON types is found. `samples` was once such a key: a number in the record `fit`, and an
    object in the record `stats`.
    """
    lines = b'{"class": "fit", "samples": 3}\n{"class": "stats", "samples": {"lost": 0}}\n'
    with pytest.raises(pyarrow.ArrowInvalid, match="changed from"):
        read_by_all(lines, tmp_path / "two.ndjson")


def test_a_run_is_read_as_one_table(tmp_path: Path) -> None:
    run = fltea_here(
        "run", "-s", "synthetic:?n=2000", "--pace", "fast", "--once", "--samples", "--corrected", *QUICK
    )
    assert run.stdout.count('"allan":{') > 0
    assert len(run.stdout) > 1 << 20, "as much as Arrow looks at to learn the types"
    read_by_all(run.stdout.encode(), tmp_path / "run.ndjson")
