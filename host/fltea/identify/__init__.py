"""What the noise of a whole recording is. The package can be called: `fltea.identify(y, rate_hz)`."""

import sys
from types import ModuleType
from typing import Any

import fltea


class _Callable(ModuleType):
    """The API's function and this package share a name, which any import of a module sets to the package."""

    def __call__(self, y: Any, rate_hz: float, **options: Any) -> Any:
        """Identify the noise of one axis: `fltea.api.series.identify`, which says what the options are."""
        return fltea._identify(y, rate_hz, **options)


sys.modules[__name__].__class__ = _Callable
