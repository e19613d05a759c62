"""Reads MATLAB files of versions 4 to 7.2; later versions are HDF5 files."""

from pathlib import Path
from typing import Any

import numpy as np

from fltea.recording.readers.arrays import NoNumbers, is_of_matlab, of_arrays
from fltea.recording.sheet import Sheet


def read(path: Path, _: str) -> Sheet:
    """Read all variables and the fields of structures."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatlabOpaque

    found: dict[str, Any] = {}

    def take(name: str, value: Any) -> None:
        if name.startswith("__"):  # scipy adds these items, which describe the file
            return
        if isinstance(value, dict):
            for key, inner in value.items():
                take(f"{name}.{key}" if name else key, inner)
        elif isinstance(value, MatlabOpaque):
            kind = value["s2"].reshape(-1)[0] if "s2" in (value.dtype.names or ()) else b"class"
            found[name] = NoNumbers(is_of_matlab(kind.decode() if isinstance(kind, bytes) else str(kind)))
        elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype.kind == "O"):
            parts = list(np.asarray(value, object).reshape(-1)) if not isinstance(value, list) else value
            if parts and all(isinstance(part, dict) for part in parts):
                for number, part in enumerate(parts, 1):
                    take(f"{name}({number})", part)
            elif parts and all(isinstance(part, str) for part in parts):
                found[name] = np.array(parts)
            else:
                found[name] = NoNumbers(is_of_matlab("cell"), len(parts))
        else:
            found[name] = value if isinstance(value, str) else np.asarray(value)

    take("", loadmat(path, simplify_cells=True))
    return of_arrays(found)
