"""Checks of a device's source, by the module that the row of its kind in `SOURCES` names."""

import importlib
from collections.abc import Iterator
from typing import cast

from fltea.diagnostics.asked import AskedSource
from fltea.diagnostics.finding import Finding, problem
from fltea.diagnostics.host_system import System
from fltea.settings.config import Config
from fltea.settings.extras import how_to_install
from fltea.settings.sources import BY_SCHEME, SERIAL
from fltea.sources.open_source import named
from fltea.sources.opening import Named, SourceModule


def check_source(config: Config, system: System, hear_s: float) -> Iterator[Finding]:
    """Yield findings on the source at a device's URL.

    Raises:
        UsageError: the URL names no kind of source, or no address.
    """
    scheme, place = Named(SERIAL, "") if config.source is None else named(config.source)
    kind = BY_SCHEME.get(scheme)
    if kind is None:
        kind, place = BY_SCHEME[SERIAL], config.source or ""
    if kind.extra and not system.has_module(kind.library):
        text = f"{scheme}: the package {kind.library} is not installed."
        yield problem("source", text, f"{how_to_install(kind.extra)}.")
        return
    module = cast(SourceModule, importlib.import_module(kind.check or kind.module))
    yield from module.check_source(AskedSource(config.source, place, config, system, hear_s))
