"""Files of HDF5: a table of pandas, or all data sets."""

from pathlib import Path
from typing import Any

from fltea.recording.readers import pandas_hdf5
from fltea.recording.readers.arrays import of_arrays
from fltea.recording.sheet import Sheet


def read(path: Path, _: str) -> Sheet:
    """Read a table of pandas, or else all data sets by their paths, block by block."""
    import h5py

    file = h5py.File(path, "r")
    found: dict[str, Any] = {}
    units: dict[str, str] = {}

    def take(name: str, item: Any) -> dict[str, Any] | None:
        if isinstance(item, h5py.Group) and pandas_hdf5.is_table(item):
            return pandas_hdf5.columns_of(item)
        if isinstance(item, h5py.Dataset):
            name = name.replace("/", ".")
            found[name] = item
            stated = item.attrs.get("units", item.attrs.get("unit", ""))
            units[name] = stated.decode(errors="replace") if isinstance(stated, bytes) else str(stated)
        return None

    table = file.visititems(take)
    return of_arrays(found if table is None else table, units)
