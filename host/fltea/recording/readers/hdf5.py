"""Reads HDF5 files: tables of pandas, and data sets with attributes, such as those of netCDF and NWB.

netCDF and NWB are rules for the contents of HDF5 files: for climate data, and for recordings of nerve cells.
An HDF5 file may state that the data of a data set are stored in other files. Such data are not read.
"""

import math
import os.path
import posixpath
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from fltea.recording.files import Note, listed
from fltea.recording.one_sensor import MOST_SENSORS
from fltea.recording.readers import pandas_hdf5
from fltea.recording.readers.arrays import NoNumbers, axes_named, is_of_matlab, of_arrays
from fltea.recording.readers.file_facts import number_of, texts_of
from fltea.recording.reading import OVERRULE
from fltea.recording.sheet import Sheet
from fltea.records.errors import UsageError

MISSING = "_fillvalue", "missing_value"
NETCDF, NWB = ("scale_factor", "add_offset"), ("conversion", "offset")
"""Two pairs of attribute names, as in netCDF files (climate data) and in NWB files (data of nerve cells). The
first attribute of a pair holds the factor, and the second the offset, for a data set's numbers. Sources:
https://cfconventions.org (8.1 Packed Data) and https://nwb-schema.readthedocs.io (TimeSeries). The attribute
`resolution` of NWB changes no numbers.
"""

NOT_READ = "copy it into this file: h5repack or h5py write it"
"""Advice for the user if a data set is stored in another file."""

MOST_LINKS, MOST_NAMES = 16, 100
"""HDF5 follows at most MOST_LINKS links in a row. Of a path, the first MOST_NAMES names are examined."""

MATLABS = "#refs#", "#subsystem#"


def read(path: Path, _: str) -> Sheet:
    """Read the tables of pandas in the file, or else all data sets; both are read in blocks."""
    import h5py

    found: dict[str, Any] = {}
    tables: dict[str, Any] = {}
    facts: dict[str, Any] = {}
    doubts: dict[str, str] = {}

    def take(path: str, item: Any) -> None:
        name = path.replace("/", ".")
        if elsewhere := outside(item):
            found[name] = NoNumbers(elsewhere, max((1, *item.shape)))
            return
        attributes = _attributes_of(item)
        # in an NWB file (of nerve cells), this attribute states the sampling rate of a whole group
        if path.endswith("/starting_time") and "rate" in attributes:
            facts[f"{name.rpartition('.')[0]}.rate"] = attributes["rate"]
        if isinstance(item, h5py.Group):
            facts.update({f"{name}.{key}".lstrip("."): value for key, value in attributes.items()})
            if pandas_hdf5.is_table(item):
                if elsewhere := _parts_elsewhere(item):
                    raise UsageError(f"{path or 'its table'}: {elsewhere}.")
                tables.update(
                    {f"{name}.{column}": one for column, one in pandas_hdf5.columns_of(item).items()}
                )
        elif not path.startswith(MATLABS):
            for part, data in _parts_of(path, item):
                name = part.replace("/", ".")
                kept = attributes if data is item else _attributes_of(data)
                is_nwb = "neurodata_type" in item.parent.attrs
                found[name], doubts[name] = _read_as(data, kept, NWB if is_nwb else NETCDF)
                facts.update({f"{name}@{key}": value for key, value in kept.items()})

    file = _opened(path)
    links = _links_elsewhere(file)
    for name, why in links.items():
        if axes_named(name.replace("/", ".")):
            raise UsageError(f"{name} {why}.")
        found[name.replace("/", ".")] = NoNumbers(why)
    take("", file)
    file.visititems(take)
    sheet = of_arrays(tables or found, attributes=facts, doubts=doubts)
    return replace(
        sheet, notes=tuple(Note("reading", f"{path}: {name} {why}.") for name, why in links.items())
    )


def outside(item: Any) -> str:
    """Return a text that says in which other file a data set is stored.

    The caller writes the name of the data set in front of the text, so that both together are a sentence.

    Return an empty text if the data set is stored in this file.
    """
    import h5py

    if not isinstance(item, h5py.Dataset):
        return ""
    if item.is_virtual:
        names = sorted({source.file_name for source in item.virtual_sources()})
        return f"is composed of other data sets ({listed(names)}), which may be missing; {NOT_READ}"
    if item.external:
        return (
            f"is stored in other files ({listed(sorted({name for name, *_ in item.external}))}); {NOT_READ}"
        )
    return ""


def _opened(path: Path) -> Any:
    """Open a file.

    HDF5 2.0 opens a file by its real path. Decompressed content has no path, since it is in a file without a
    name. So Python opens it, and h5py reads it through Python's file object.
    """
    import h5py

    return h5py.File(path if os.path.exists(os.path.realpath(path)) else path.open("rb"), "r")


def _links_elsewhere(file: Any) -> dict[str, str]:
    """Return the links in the file that lead to another file, directly or through other links.

    The key is the path of a link in the file. The value is a text that names the other file.
    """
    import h5py

    found: dict[str, str] = {}
    inner: dict[str, str] = {}

    def take(path: str, link: Any) -> None:
        if isinstance(link, h5py.ExternalLink):
            found[path] = f"is a link to another file ({link.filename}); {NOT_READ}"
        elif isinstance(link, h5py.SoftLink):
            inner[path] = posixpath.normpath(posixpath.join("/", posixpath.dirname(path), link.path))[1:]

    file.visititems_links(take)
    outer = dict(found)
    for path in inner:
        if (why := _why_elsewhere(path, inner, outer)) is not None:
            found[path] = why
    return found


def _why_elsewhere(path: str, inner: Mapping[str, str], outer: Mapping[str, str]) -> str | None:
    """Follow links within the file; return the text of the first link to another file, or None.

    `inner`: where each link within the file leads. `outer`: the texts of links to other files.
    """
    for _ in range(MOST_LINKS):
        names = path.split("/")
        for count in range(1, min(len(names), MOST_NAMES) + 1):
            first = "/".join(names[:count])
            if first in outer:
                return outer[first]
            if first in inner:
                path = "/".join([inner[first], *names[count:]])
                break
        else:
            return None
    return None


def _parts_elsewhere(group: Any) -> str:
    """Return a text that says which part of a pandas table is stored in another file, and in which one.

    Return an empty text if the whole table is in this file.
    """
    import h5py

    for name in group:
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            return f"its part {name} is a link; {NOT_READ}"
        if elsewhere := outside(group[name]):
            return f"its part {name} {elsewhere}"
    return ""


def _attributes_of(item: Any) -> dict[str, Any]:
    """Return the attributes of an HDF5 object, by their names in small letters.

    Attributes with more than `MOST_SENSORS` values are left out, since they do not describe columns.
    """
    sizes = {key: np.size(one) for key, one in item.attrs.items()}  # np.size is None for an empty attribute
    return {key.lower(): item.attrs[key] for key, size in sizes.items() if 0 < (size or 0) <= MOST_SENSORS}


def _parts_of(path: str, data: Any) -> Iterator[tuple[str, Any]]:
    """Yield a data set with its path.

    A MATLAB array of structures is a data set of references. In its place, the data sets to which it refers
    are yielded.
    """
    import h5py

    of_structures = "/" in path and h5py.check_ref_dtype(data.dtype) is not None
    if not of_structures or data.size > MOST_SENSORS or "MATLAB_class" in data.attrs:
        yield path, data
        return
    group, _, field = path.rpartition("/")
    for number, reference in enumerate(np.asarray(data[()]).reshape(-1), 1):
        if reference and isinstance(one := data.file[reference], h5py.Dataset) and not outside(one):
            yield f"{group}({number})/{field}", one


def _read_as(data: Any, attributes: dict[str, Any], scaled_by: tuple[str, str]) -> tuple[Any, str]:
    """Return a data set with its factor and offset applied, and a text on errors in its attributes.

    The text is empty if nothing is wrong.

    `scaled_by`: names of the attributes for factor and offset. Attributes that were applied are removed from
    `attributes`.
    """
    kind = next(iter(texts_of(attributes.get("matlab_class"))), "")
    if kind == "char":
        return "".join(map(chr, np.asarray(data[()]).reshape(-1).tolist())), ""
    if kind == "cell" or "matlab_object_decode" in attributes:
        return NoNumbers(is_of_matlab(kind), max((1, *data.shape))), ""
    if (text := data.asstr() if data.dtype.kind == "O" and data.shape == () else None) is not None:
        return str(text[()]), ""
    if scaled_by == NWB:
        attributes.pop("resolution", None)
    scale, offset = (
        number_of(attributes.pop(key, None), other) for key, other in zip(scaled_by, (1, 0), strict=True)
    )
    if math.isnan(scale * offset):
        return data, f"its {' or '.join(scaled_by)} is not one number. {OVERRULE}"
    missing = [np.atleast_1d(attributes[key]) for key in MISSING if key in attributes]
    low, high = np.atleast_1d(attributes.get("valid_range", (math.nan, math.nan)))[:2]
    low, high = attributes.get("valid_min", low), attributes.get("valid_max", high)
    limits = number_of(low), number_of(high)
    is_plain = not missing and (scale, offset) == (1.0, 0.0) and all(map(math.isnan, limits))
    if is_plain or data.dtype.kind not in "iuf":
        return data, ""
    return _Scaled(data, scale, offset, np.concatenate(missing) if missing else np.empty(0), limits), ""


class _Scaled:
    """A data set with factor and offset applied, and NaN for missing values."""

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
