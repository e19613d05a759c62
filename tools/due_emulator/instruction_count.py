"""How many instructions ran, and the end of a run of them: C++ functions that Unicorn calls all the time."""

import ctypes
import hashlib
import mmap
import os
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import unicorn
from fltea.records.errors import UsageError
from unicorn.unicorn_py3.unicorn import uclib

from tools.due_emulator.memory_map import FLASH_BASE, FLASH_BYTES

SOURCE = Path(__file__).with_suffix(".cpp")
FOLDER = Path(__file__).parents[2] / "build" / "due_emulator"
COMMAND = ("c++", "-std=c++11", "-O2", "-fPIC", "-shared", "-Wall", "-Wextra", "-Wconversion", "-Werror")
NOWHERE = 1
"""No instruction is at an odd address."""


class InstructionCount(ctypes.Structure):
    """Counts the instructions of a slice of execution, and ends it once there were `limit` of them.

    done: instructions that began in this slice. limit: may be changed while the slice runs; unless it is
    above `done`, the slice ends before the next instruction. address: of the instruction that began last.
    """

    _fields_ = (
        ("done", ctypes.c_uint64),
        ("limit", ctypes.c_uint64),
        ("address", ctypes.c_uint64),
        ("_next", ctypes.c_uint64),
        ("_block_end", ctypes.c_uint64),
        ("_flash", ctypes.c_void_p),
        ("_flash_base", ctypes.c_uint64),
        ("_flash_bytes", ctypes.c_uint64),
        ("_read", ctypes.c_void_p),
        ("_stop", ctypes.c_void_p),
    )

    def __init__(self, flash: mmap.mmap) -> None:
        super().__init__()
        self._flash = ctypes.addressof(ctypes.c_char.from_buffer(flash))
        self._flash_base, self._flash_bytes = FLASH_BASE, FLASH_BYTES
        self._read, self._stop = _address_of(uclib.uc_mem_read), _address_of(uclib.uc_emu_stop)

    def attach(self, uc: unicorn.Uc) -> None:
        """Count what this processor does; the count has to live as long as it."""
        functions = _library()
        for kind, function in (
            (unicorn.UC_HOOK_BLOCK, functions.enter_block),
            (unicorn.UC_HOOK_CODE, functions.before_instruction),
        ):
            # Unicorn's own hook_add takes functions of Python only.
            handle, everywhere = ctypes.c_size_t(), (ctypes.c_uint64(1), ctypes.c_uint64(0))
            error = uclib.uc_hook_add(
                uc._uch, ctypes.byref(handle), kind, _address_of(function), ctypes.byref(self), *everywhere
            )
            if error != unicorn.UC_ERR_OK:
                raise unicorn.UcError(error)

    def begin(self, limit: int) -> None:
        """Start a slice."""
        self.done, self.limit, self.address = 0, limit, NOWHERE
        self._next = self._block_end = 0


@cache
def _library() -> ctypes.CDLL:
    """Load the functions, compiled once for each version of their source.

    Raises:
        UsageError: they cannot be compiled.
    """
    version = hashlib.sha256(SOURCE.read_bytes() + " ".join(COMMAND).encode()).hexdigest()[:16]
    library = FOLDER / f"{SOURCE.stem}-{version}.so"
    if not library.exists():
        _compile(library)
    return ctypes.CDLL(str(library))


def _compile(library: Path) -> None:
    library.parent.mkdir(parents=True, exist_ok=True)
    # Another process may do the same at this moment: the file appears as a whole.
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        fresh = Path(folder) / library.name
        try:
            subprocess.run([*COMMAND, "-o", fresh, SOURCE], capture_output=True, text=True, check=True)
        except FileNotFoundError as error:
            raise UsageError(f"no C++ compiler '{COMMAND[0]}'; install one (Debian: g++).") from error
        except subprocess.CalledProcessError as error:
            raise UsageError(f"{SOURCE.name} cannot be compiled: {error.stderr}") from error
        os.replace(fresh, library)


def _address_of(function: ctypes._CFuncPtr) -> ctypes.c_void_p:
    return ctypes.cast(function, ctypes.c_void_p)
