"""Reads archives of arrays (.npz) that were written by programs other than fltea."""

from pathlib import Path

import numpy as np

from fltea.recording.readers.arrays import of_arrays
from fltea.recording.sheet import Sheet


def read(path: Path, _: str) -> Sheet:
    """Read all arrays in the archive."""
    with np.load(path, allow_pickle=False) as archive:
        return of_arrays({name: archive[name] for name in archive.files})
