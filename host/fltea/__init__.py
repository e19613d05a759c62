"""fltea: online identification of fractional noise of MEMS gyroscopes.

From Python: `identify` the noise of an array, `open` a recording, pass samples to `Live`, or `simulate`
noise.
"""

import importlib
from typing import TYPE_CHECKING, Any

from fltea.records.version import __version__

if TYPE_CHECKING:
    from fltea.api.drawing import Drawing
    from fltea.api.identified import Identified, Report
    from fltea.api.live import Corrected, Live, LiveReport
    from fltea.api.recording import Recording, open
    from fltea.api.series import identify
    from fltea.api.simulated import Simulated, simulate
    from fltea.records.errors import FlteaError, UsageError
    from fltea.records.quantity import Quantity

__all__ = [
    "Corrected",
    "Drawing",
    "FlteaError",
    "Identified",
    "Live",
    "LiveReport",
    "Quantity",
    "Recording",
    "Report",
    "Simulated",
    "UsageError",
    "__version__",
    "identify",
    "open",
    "simulate",
]

_HOMES = {
    "Corrected": "fltea.api.live",
    "Drawing": "fltea.api.drawing",
    "FlteaError": "fltea.records.errors",
    "Identified": "fltea.api.identified",
    "Live": "fltea.api.live",
    "LiveReport": "fltea.api.live",
    "Quantity": "fltea.records.quantity",
    "Recording": "fltea.api.recording",
    "Report": "fltea.api.identified",
    "Simulated": "fltea.api.simulated",
    "UsageError": "fltea.records.errors",
    "identify": "fltea.api.series",
    "open": "fltea.api.recording",
    "simulate": "fltea.api.simulated",
}


def __getattr__(name: str) -> Any:
    """Load a name of the API when it is first used. So the daemon, which also imports fltea, starts fast."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
