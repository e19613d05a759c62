"""What tests need compiled is compiled once, though several processes run tests."""

import ctypes
import fcntl
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import Any


def make(folder: Path, build: Path, *goals: str) -> subprocess.CompletedProcess[str]:
    """Run `make BUILD=build goals` in a folder; who comes while another one does waits, and finds it made."""
    build.mkdir(parents=True, exist_ok=True)
    with (build / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        command = ["make", "-C", str(folder), f"BUILD={build}", *goals]
        return subprocess.run(command, capture_output=True, text=True, check=False)


def shared_library(folder: Path, build: Path, name: str, functions: Iterable[tuple[Any, ...]]) -> ctypes.CDLL:
    """Build a library, if out of date, and load it. functions: name, type of the result, of the arguments."""
    done = make(folder, build, f"{build}/{name}.so")
    if done.returncode != 0:
        raise RuntimeError(done.stdout + done.stderr)
    library = ctypes.CDLL(f"{build}/{name}.so")
    for name, result, *arguments in functions:
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library
