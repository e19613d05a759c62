"""Reads tables that pandas has written to HDF5 files by means of PyTables.

The columns of a table that have the same type are stored together, as a block.
"""

import pickletools
from collections.abc import Iterator
from typing import Any

import numpy as np

STRINGS = "UNICODE", "BINUNICODE", "SHORT_BINUNICODE"
TABLES = "frame", "frame_table"


class BlockColumn:
    """One column of a table of pandas, as an array of numbers or times.

    The file stores columns of one type as a block.

    `field`: name of the field that holds the column in the rows of a PyTables table. None if the block is
    stored as an array instead.
    """

    def __init__(self, data: Any, field: str | None, place: int | None, kind: str) -> None:
        self.shape = (data.shape[0],)
        inner = data.dtype if field is None else data.dtype[field].base
        self._times = kind.startswith("datetime64")
        self.dtype = np.dtype(kind if "[" in kind else "M8[ns]") if self._times else inner
        self._data, self._field, self._place = data, field, place

    def __getitem__(self, rows: Any) -> Any:
        values = self._data[rows]
        values = values if self._field is None else values[self._field]
        values = values if self._place is None else values[..., self._place]
        return values.view(self.dtype) if self._times else values


def is_table(group: Any) -> bool:
    """Return whether a group holds a table of pandas."""
    return _text(group, "pandas_type") in TABLES


def columns_of(group: Any) -> dict[str, BlockColumn]:
    """Return the columns of a table by name; the index is a column if it has a name or holds times.

    Raises:
        KeyError, ValueError: the group lacks parts that PyTables writes for each table of pandas.
    """
    return dict(_of_rows(group, group["table"]) if "table" in group else _of_blocks(group))


def _of_blocks(group: Any) -> Iterator[tuple[str, BlockColumn]]:
    index = group["axis1"]
    yield from _of_index(index, None, _text(index, "kind"), _text(index, "name"))
    for k in range(int(group.attrs["nblocks"])):
        values = group[f"block{k}_values"]
        for place, name in enumerate(group[f"block{k}_items"][()] if len(values.shape) == 2 else ()):
            yield _decoded(name), BlockColumn(values, None, place, _text(values, "value_type"))


def _of_rows(group: Any, table: Any) -> Iterator[tuple[str, BlockColumn]]:
    said = _strings(group.attrs.get("info", b""))
    named = said[said.index("index_name") + 1] if "index_name" in said[:-1] else ""
    if table.dtype.names is None:
        raise ValueError("the table of pandas has no fields")
    for field in table.dtype.names:
        if field == "index":
            yield from _of_index(table, field, _text(table, "index_kind"), named)
            continue
        is_block = bool(table.dtype[field].shape)
        names = _strings(table.attrs.get(f"{field}_kind", b"")) if is_block else [field]
        for place, name in enumerate(names):
            yield name, BlockColumn(table, field, place if is_block else None, _text(table, f"{field}_dtype"))


def _of_index(data: Any, field: str | None, kind: str, name: str) -> Iterator[tuple[str, BlockColumn]]:
    name = "" if name == "N." else name  # an index without a name has None as its name, pickled as "N."
    if name or kind.startswith("datetime64"):
        yield name or "time", BlockColumn(data, field, None, kind)


def _text(item: Any, name: str) -> str:
    return _decoded(item.attrs.get(name, ""))


def _decoded(value: Any) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _strings(pickled: bytes) -> list[str]:
    """Return the texts in a pickle of pandas without loading it, since loading may run any program.

    `pickled`: the pickle, or empty if the file has none. Then no texts are returned.

    Raises:
        ValueError: the pickle is damaged.
    """
    if not pickled:
        return []
    return [str(text) for code, text, _ in pickletools.genops(bytes(pickled)) if code.name in STRINGS]
