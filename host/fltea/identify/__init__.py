"""What the noise of a whole recording is. The package can be called: `fltea.identify(y, rate_hz)`."""

import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fltea.api.identified import Identified


class _Callable(ModuleType):
    """The API's function and this package share a name, which any import of a module sets to the package."""

    def __call__(self, y: Any, rate_hz: float, **options: Any) -> "Identified":
        """Identify the noise of one axis: `fltea.api.series.identify`, which says what the options are."""
        from fltea.api.series import identify

        return identify(y, rate_hz, **options)


sys.modules[__name__].__class__ = _Callable
