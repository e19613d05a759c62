"""Open tables of other programs in this process.

The program itself opens them in a separate process (the reader process), whose start takes long.
"""

import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
from fltea.recording.files import Stored
from fltea.recording.formats import FORMATS, loaded
from fltea.recording.kind import open_one_file
from fltea.recording.opening import open_recording
from fltea.recording.reader_process import open_text
from fltea.recording.sheet import Sheet, open_sheet, with_sample
from fltea.records.errors import UsageError
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import DEFAULT_LIMITS

N = 300
TIMES_S = np.arange(N) / 100
GYRO = np.random.default_rng(1).normal(size=(N, 3))
OTHER = np.random.default_rng(2).normal(size=(2 * N, 3))
_NUMBERS = itertools.count()


def open_here(kind: str, path: Path, **how: Any) -> Stored:
    """Open a file as the reader process would, but in this process.

    `how`: fields of `How`.
    """
    try:
        sheet = loaded(FORMATS[kind].reader)(path, how.get("topic") or "")
    except UsageError as error:
        raise UsageError(str(error) if str(error).startswith(f"{path}: ") else f"{path}: {error}") from error
    return open_sheet(path, with_sample(sheet), How(**how), DEFAULT_LIMITS)


def stored_here(path: Path, how: How = AS_IT_SAYS) -> Stored:
    """Open any file as the program does, but without the reader process. Messages of errors may lack the
    file's name.
    """
    opened = open_one_file(path)
    if opened.file is not None:
        opened.file.close()
    form = FORMATS[opened.kind]
    if not form.reader:
        found = open_recording(path, how)
        assert isinstance(found, Stored)
        return found
    table = loaded(form.reader)(path, how.topic or "")
    if isinstance(table, Sheet):
        return open_sheet(path, with_sample(table), how, DEFAULT_LIMITS)
    return open_text(path, table, table.pieces, how, DEFAULT_LIMITS)


def hdf5(folder: Path, arrays: dict[str, Any], **how: Any) -> Stored:
    """Write arrays to an HDF5 file, and open the file.

    `arrays`: values by their path in the file. `path@name` stands for the attribute `name` of the data set or
    group `path`.
    """
    # each file gets a new name, since h5py keeps the earlier file open
    path = folder / f"{next(_NUMBERS)}.h5"
    with h5py.File(path, "w", track_order=True) as file:
        for name, value in arrays.items():
            owner, mark, attribute = name.partition("@")
            if mark:
                at = file[owner or "/"] if not owner or owner in file else file.require_group(owner)
                at.attrs[attribute] = value
            else:
                file[name] = value
    return open_here("hdf5", path, **how)


def with_attributes(folder: Path, values: Any, attributes: dict[str, Any], **how: Any) -> Stored:
    """Write gyroscope samples at 100 Hz to a data set with these attributes, and open the file."""
    # each file gets a new name, since h5py keeps the earlier file open
    path = folder / f"{next(_NUMBERS)}.h5"
    with h5py.File(path, "w") as file:
        file["gyro"] = values
        file["t"] = TIMES_S
        file["gyro"].attrs.update(attributes)
    return open_here("hdf5", path, **how)


def matlab(folder: Path, variables: dict[str, Any], **how: Any) -> Stored:
    scipy.io.savemat(folder / "rest.mat", variables)
    return open_here("mat", folder / "rest.mat", **how)


def npz(folder: Path, arrays: dict[str, Any], **how: Any) -> Stored:
    np.savez(folder / "rest.npz", **arrays)
    return open_here("arrays", folder / "rest.npz", **how)


def document(folder: Path, content: Any, **how: Any) -> Stored:
    (folder / "rest.json").write_text(json.dumps(content))
    return open_here("json", folder / "rest.json", **how)


def refusal(read: Callable[..., Any], *arguments: Any, **how: Any) -> str:
    with pytest.raises(UsageError) as caught:
        read(*arguments, **how)
    return str(caught.value)
