"""Variables of MATLAB, of versions 4 to 7.2; since version 7.3 such a file is one of HDF5."""

from pathlib import Path
from typing import Any

import numpy as np

from fltea.recording.readers.arrays import of_arrays
from fltea.recording.sheet import Sheet


def read(path: Path, _: str) -> Sheet:
    """Read variables and the fields of structures."""
    from scipy.io import loadmat

    found: dict[str, Any] = {}

    def take(name: str, value: Any) -> None:
        if isinstance(value, dict):
            for key, inner in value.items():
                take(f"{name}.{key}" if name else key, inner)
        elif not name.startswith("__"):
            found[name] = np.asarray(value)

    take("", loadmat(path, simplify_cells=True))
    return of_arrays(found)
