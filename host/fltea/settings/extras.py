"""Load optional libraries (extras of the package) when they are needed."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

from fltea.records.errors import UsageError

_ROOT = Path(__file__).resolve().parents[3]
"""Folder of the repository, if the program runs from a clone."""


def how_to_install(*extras: str) -> str:
    """Return the command that installs extras of the package.

    The command works only in a clone, since fltea is on no package index.
    """
    wanted = f"'.[{','.join(extras)}]'"
    if (_ROOT / "pyproject.toml").is_file():
        return f"cd {_ROOT} && {sys.executable} -m pip install -e {wanted}"
    return f"{sys.executable} -m pip install {wanted}, in a clone of fltea"


def load(module: str, library: str, extra: str, who_needs: str, otherwise: str = "") -> ModuleType:
    """Import `module` and return it. It is a module of fltea that needs `library`, or the library itself.

    `extra`: name of the extra that installs the library.
    `who_needs`: first words of the error message, such as "MCAP files need".
    `otherwise`: end of the error message, which says what to do without the library.

    Raises:
        UsageError: the library is not installed; the text says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != library:
            raise
        raise UsageError(
            f"{who_needs} the package {library}, which is not installed: {how_to_install(extra)}{otherwise}."
        ) from error


def need_matplotlib(who_needs: str, otherwise: str = "") -> None:
    """Check that matplotlib is installed; call this before long computations.

    The arguments are those of `load`.
    """
    load("matplotlib", "matplotlib", "plot", who_needs, otherwise)
