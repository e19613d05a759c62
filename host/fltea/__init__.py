"""fltea: online identification of fractional noise of MEMS gyroscopes.

From Python: `identify` an array, `open` a recording, feed `Live`, `simulate` a noise.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fltea.api.identified import Identified, Report
    from fltea.api.live import Live, LiveReport
    from fltea.api.recording import Recording, open
    from fltea.api.series import identify
    from fltea.api.simulated import Simulated, simulate
    from fltea.records.errors import FlteaError, UsageError

__version__ = "0.1.0"

__all__ = [
    "FlteaError",
    "Identified",
    "Live",
    "LiveReport",
    "Recording",
    "Report",
    "Simulated",
    "UsageError",
    "identify",
    "open",
    "simulate",
]

_HOMES = {
    "FlteaError": "fltea.records.errors",
    "Identified": "fltea.api.identified",
    "Live": "fltea.api.live",
    "LiveReport": "fltea.api.live",
    "Recording": "fltea.api.recording",
    "Report": "fltea.api.identified",
    "Simulated": "fltea.api.simulated",
    "UsageError": "fltea.records.errors",
    "open": "fltea.api.recording",
    "simulate": "fltea.api.simulated",
}


def __getattr__(name: str) -> Any:
    """Load a name of the API when it is first asked for: the daemon, which imports fltea too, stays light."""
    if name == "identify":  # the package of that name, which can be called
        return importlib.import_module("fltea.identify")
    if name == "_identify":  # what it calls
        return importlib.import_module("fltea.api.series").identify
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
