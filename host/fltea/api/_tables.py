"""Results as tables of pandas, which is an extra."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fltea.api._said import PARAMETERS, Said
from fltea.records.whole_file import whole_file
from fltea.settings.extras import load

if TYPE_CHECKING:
    import pandas as pd


def row(axis: str, said: Said) -> dict[str, Any]:
    """One axis: each parameter with `_low` and `_high`, the ends of its interval."""
    found: dict[str, Any] = {"axis": axis, "verdict": said.verdict, "unit": said.unit, "null_p": said.null_p}
    for name in PARAMETERS:
        one = getattr(said, name)
        found |= {name: one.value, f"{name}_low": one.low, f"{name}_high": one.high}
    for name in ("N", "B", "K"):
        found[name] = None if said.allan is None else getattr(said.allan, name)
    return found


def frame(rows: Sequence[Mapping[str, Any]]) -> "pd.DataFrame":
    """Rows as a table, by axis."""
    return _pandas().DataFrame(rows).set_index("axis")


def columns(found: Mapping[str, Any], time_s: Any) -> "pd.DataFrame":
    """Columns over time in s."""
    pandas = _pandas()
    return pandas.DataFrame(dict(found), index=pandas.Index(time_s, name="time_s"))


def parquet(path: Path, found: Mapping[str, Any]) -> None:
    """Write columns to a Parquet file, whole or not at all."""
    arrow = load("pyarrow", "pyarrow", "notebook", "to_parquet() needs")
    writer = load("pyarrow.parquet", "pyarrow", "notebook", "to_parquet() needs")
    with whole_file(path) as file:
        writer.write_table(arrow.table(dict(found)), file)


def _pandas() -> Any:
    return load("pandas", "pandas", "notebook", "to_pandas() needs")
