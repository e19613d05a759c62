"""Compile the libraries that tests need. Each is compiled only once, even if several processes run tests."""

import ctypes
import fcntl
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

NATIVE = Path(__file__).resolve().parents[1] / "native"
BUILD = NATIVE.parents[1] / "build"
DOUBLES, COUNTS, BYTES = (
    np.ctypeslib.ndpointer(kind, flags="C") for kind in (np.float64, np.int16, np.uint8)
)
"""Argument types that many functions of the probes (libraries in tests/native) have."""


def make(folder: Path, build: Path, *goals: str | Path) -> None:
    """Run `make BUILD=build goals` in a folder.

    If another process is building, this function waits for the end; `make` then finds nothing left to do.
    """
    build.mkdir(parents=True, exist_ok=True)
    with (build / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        command = ["make", f"-j{os.cpu_count()}", "-C", folder, f"BUILD={build}", *goals]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def probe(name: str, *functions: tuple[Any, ...]) -> ctypes.CDLL:
    """Load the library of a probe in tests/native; build the library first if it is out of date.

    `functions`: for each function its name, its result type and its argument types.
    """
    file = BUILD / "tests-native" / f"{name}.so"
    make(NATIVE, file.parent, file)
    library = ctypes.CDLL(str(file))
    for function, result, *arguments in functions:
        found = getattr(library, function)
        found.restype, found.argtypes = result, arguments
    return library
