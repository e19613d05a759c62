"""Modules whose library is an extra of the package, loaded when they are asked for."""

import importlib
from types import ModuleType

from fltea.records.errors import UsageError


def load(module: str, library: str, extra: str, who_needs: str) -> ModuleType:
    """Import one of our modules. who_needs: the beginning of the error, such as "MCAP files need".

    Raises:
        UsageError: the library is not installed; names the extra.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != library:
            raise
        raise UsageError(
            f"{who_needs} the package {library}, which is not installed: pip install 'fltea[{extra}]'."
        ) from error
