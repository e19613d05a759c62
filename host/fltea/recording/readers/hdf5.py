"""Files of HDF5: tables of pandas, and data sets with attributes as netCDF has them: units, scales, rates."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from fltea.recording.evidence import OVERRULE
from fltea.recording.readers import pandas_hdf5
from fltea.recording.readers.arrays import NoNumbers, is_of_matlab, of_arrays, rate_of
from fltea.recording.sheet import Sheet

UNITS = "units", "unit", "unit_string"
"""Attributes, in small letters."""

MISSING = "_fillvalue", "missing_value"
SCALES = "scale", "gain", "sensitivity", "offset", "multiplier", "factor", "lsb"
"""Attributes that change the numbers in a way that their names do not tell."""

MATLABS = "#refs#", "#subsystem#"


def read(path: Path, _: str) -> Sheet:
    """Read the tables of pandas, or else all data sets by their paths, block by block."""
    import h5py

    found: dict[str, Any] = {}
    tables: dict[str, Any] = {}
    units: dict[str, str] = {}
    rates: dict[str, float] = {}
    doubts: dict[str, str] = {}

    def take(path: str, item: Any) -> None:
        name = path.replace("/", ".")
        attributes = {key.lower(): value for key, value in item.attrs.items()}
        mark = "@" if isinstance(item, h5py.Dataset) else "." if name else ""
        for key, value in attributes.items():
            if (rate_hz := rate_of(key, value)) is not None:
                rates[f"{name}{mark}{key}"] = rate_hz
        if isinstance(item, h5py.Group):
            if pandas_hdf5.is_table(item):
                tables.update(
                    {f"{name}.{column}": one for column, one in pandas_hdf5.columns_of(item).items()}
                )
        elif not path.startswith(MATLABS):
            units[name] = next((_text(attributes[key]) for key in UNITS if key in attributes), "")
            found[name], doubts[name] = _read_as(item, attributes)

    file = h5py.File(path, "r")
    take("", file)
    file.visititems(take)
    return of_arrays(tables or found, units, rates, doubts)


def _read_as(data: Any, attributes: dict[str, Any]) -> tuple[Any, str]:
    """A data set as its attributes say that it is to be read, and what they leave open."""
    kind = _text(attributes.get("matlab_class", ""))
    if kind == "char":
        return "".join(map(chr, np.asarray(data[()]).reshape(-1).tolist())), ""
    if kind == "cell" or "matlab_object_decode" in attributes:
        return NoNumbers(is_of_matlab(kind), max((1, *data.shape))), ""
    if (text := data.asstr() if data.dtype.kind == "O" and data.shape == () else None) is not None:
        return str(text[()]), ""
    scale, offset = (
        _number(attributes.get(key), other) for key, other in (("scale_factor", 1), ("add_offset", 0))
    )
    changed = {key: _number(attributes[key], 1.0) for key in SCALES if key in attributes}
    open_ = [f"{key} {value:g}" for key, value in changed.items() if value != float(key != "offset")]
    doubt = (
        f"its attribute {open_[0]} is to change its numbers, and not said is how. {OVERRULE}" if open_ else ""
    )
    if math.isnan(scale * offset):
        doubt = f"its scale_factor or add_offset is not one number. {OVERRULE}"
    missing = [np.atleast_1d(attributes[key]) for key in MISSING if key in attributes]
    low, high = np.atleast_1d(attributes.get("valid_range", (math.nan, math.nan)))[:2]
    low, high = attributes.get("valid_min", low), attributes.get("valid_max", high)
    limits = _number(low, math.nan), _number(high, math.nan)
    is_plain = not missing and (scale, offset) == (1.0, 0.0) and all(map(math.isnan, limits))
    if is_plain or doubt or data.dtype.kind not in "iuf":
        return data, doubt
    return _Scaled(data, scale, offset, np.concatenate(missing) if missing else np.empty(0), limits), ""


class _Scaled:
    """A data set whose numbers stand for others, and some for none."""

    dtype = np.dtype(np.float64)

    def __init__(
        self, data: Any, scale: float, offset: float, missing: Any, limits: tuple[float, float]
    ) -> None:
        self.shape = data.shape
        self._data, self._scale, self._offset, self._missing, self._limits = (
            data,
            scale,
            offset,
            missing,
            limits,
        )

    def __getitem__(self, rows: Any) -> Any:
        packed = np.asarray(self._data[rows])
        low, high = self._limits
        none = np.isin(packed, self._missing) | (packed < low) | (packed > high)
        return np.where(none, math.nan, packed * self._scale + self._offset)


def _text(value: Any) -> str:
    value = np.asarray(value).reshape(-1)
    first = value[0] if len(value) else ""
    return first.decode(errors="replace") if isinstance(first, bytes) else str(first)


def _number(value: Any, other: float) -> float:
    """A number, `other` where there is none, NaN where it is not one."""
    try:
        return float(other if value is None else np.asarray(value, np.float64).reshape(()))
    except (TypeError, ValueError):
        return math.nan
