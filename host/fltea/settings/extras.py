"""Libraries that are extras of the package, loaded when they are asked for."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

from fltea.records.errors import UsageError

_ROOT = Path(__file__).resolve().parents[3]
"""The clone, if the program runs from one."""


def how_to_install(*extras: str) -> str:
    """The command that installs extras. fltea is on no package index, so it is one for a clone."""
    wanted = f"'.[{','.join(extras)}]'"
    if (_ROOT / "pyproject.toml").is_file():
        return f"cd {_ROOT} && {sys.executable} -m pip install -e {wanted}"
    return f"{sys.executable} -m pip install {wanted}, in a clone of fltea"


def load(module: str, library: str, extra: str, who_needs: str, otherwise: str = "") -> ModuleType:
    """Import one of our modules, or the library itself.

    who_needs: the beginning of the error, such as "MCAP files need". otherwise: its end: what to do without.

    Raises:
        UsageError: the library is not installed; says what installs it.
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
    """Find out before anything is computed whether figures can be drawn; arguments as of `load`."""
    load("matplotlib", "matplotlib", "plot", who_needs, otherwise)
