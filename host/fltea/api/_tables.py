"""Convert results to tables of pandas. The package pandas is optional."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from fltea.identification.axis import AxisResult
from fltea.identification.quantities import quantities
from fltea.records.fit import FitAllan, FittedAxis, Interval
from fltea.records.quantity import Quantity, coefficient_units, quantity_of
from fltea.records.whole_file import whole_file
from fltea.settings.extras import load

if TYPE_CHECKING:
    import pandas as pd


PARAMETERS = ("alpha", "f", "F", "s2", "R")


T_co = TypeVar("T_co", bound=FittedAxis, covariant=True)


class ByAxis(Mapping[str, T_co]):
    """The results of all axes: a mapping from the axis's name to its result. A notebook shows all axes."""

    def __init__(self, axes: Mapping[str, T_co]) -> None:
        self._axes = dict(axes)

    def __getitem__(self, axis: str) -> T_co:
        return self._axes[axis]

    def __iter__(self) -> Iterator[str]:
        return iter(self._axes)

    def __len__(self) -> int:
        return len(self._axes)

    def to_pandas(self) -> "pd.DataFrame":
        """Return a table with one row for each axis.

        The columns are the verdict, and each figure with the ends of its interval.

        Raises:
            UsageError: pandas is not installed.
        """
        return frame([row(name, found) for name, found in self.items()])


def row(axis: str, fitted: FittedAxis) -> dict[str, Any]:
    """Return the row of one axis.

    Each parameter has three columns: one for its value, and two for the ends of its interval. The names of
    these two end in `_low` and `_high`.

    N, B and K of a recording also have a column whose name ends in `_at_most`. It holds the upper bound if
    the value is not known.
    """
    found: dict[str, Any] = {
        "axis": axis,
        "verdict": fitted.verdict,
        "unit": fitted.unit,
        "null_p": fitted.null_p,
    }
    for name in PARAMETERS:
        one = getattr(fitted, name)
        found |= {name: one.value, f"{name}_low": one.low, f"{name}_high": one.high}
    for name, one in zip("NBK", figures(fitted), strict=True):
        found[name] = one.value
        if _details(fitted) is not None:
            found |= {f"{name}_low": one.low, f"{name}_high": one.high, f"{name}_at_most": one.at_most}
    return found


def figures(fitted: FittedAxis) -> tuple[Quantity, Quantity, Quantity]:
    """Return N, B and K in the unit of the samples; those of a live fit have no intervals."""
    if (details := _details(fitted)) is not None:
        return quantities(fitted.unit, details.level, getattr(fitted, "allan_curve", None), None)[:3]
    values = fitted.allan or FitAllan([], [], [], [], [], None, None, None)
    of = coefficient_units(fitted.unit)
    return (
        quantity_of(Interval(values.N), of.N),
        quantity_of(Interval(values.B), of.B),
        quantity_of(Interval(values.K), of.K),
    )


def _details(fitted: FittedAxis) -> AxisResult | None:
    """Return the detailed figures of an axis of a whole recording; None for a live fit, which has none."""
    found: AxisResult | None = getattr(fitted, "details", None)
    return found


def frame(rows: Sequence[Mapping[str, Any]]) -> "pd.DataFrame":
    """Return a table of `rows`, with the axis as its index."""
    return _pandas().DataFrame(rows).set_index("axis")


def table(rows: Iterable[Sequence[Any]], names: Sequence[str]) -> "pd.DataFrame":
    """Return a table of `rows` with these names of columns."""
    return _pandas().DataFrame(list(rows), columns=list(names))


def columns(found: Mapping[str, Any], time_s: Any) -> "pd.DataFrame":
    """Return a table of given columns, with the time in s as its index."""
    pandas = _pandas()
    return pandas.DataFrame(dict(found), index=pandas.Index(time_s, name="time_s"))


def parquet(path: Path, found: Mapping[str, Any]) -> None:
    """Write columns to a Parquet file; it is written completely or not at all."""
    arrow = load("pyarrow", "pyarrow", "notebook", "to_parquet() needs")
    writer = load("pyarrow.parquet", "pyarrow", "notebook", "to_parquet() needs")
    with whole_file(path) as file:
        writer.write_table(arrow.table(dict(found)), file)


def _pandas() -> Any:
    return load("pandas", "pandas", "notebook", "to_pandas() needs")
