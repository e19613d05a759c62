"""Checks of a device's source, by the module that the row of its kind in `SOURCES` names."""

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import cast

from fltea.diagnostics.asked import AskedSource
from fltea.diagnostics.finding import Finding, problem, refused
from fltea.diagnostics.host_system import System
from fltea.service.ingest.inbox import Inbox
from fltea.service.ingest.receivers import receiver_of
from fltea.settings.config import Config
from fltea.settings.extras import how_to_install
from fltea.settings.sources import BY_SCHEME, REPLAY, SERIAL, STDIN
from fltea.sources.open_source import check_recordable, named, open_source
from fltea.sources.opening import Named, SourceModule
from fltea.sources.replay import is_stored
from fltea.sources.text_events import TextEvents


def check_source(config: Config, system: System, hear_s: float) -> Iterator[Finding]:
    """Yield findings on the source at a device's URL.

    What `fltea run` would refuse is a problem. A pipe is not opened, since its writer would notice.
    """
    found = Named(SERIAL, "") if config.source is None else named(config.source)
    kind = BY_SCHEME.get(found.scheme)
    if kind is not None and kind.extra and not system.has_module(kind.library):
        text = f"{found.scheme}: the package {kind.library} is not installed."
        yield problem("source", text, f"{how_to_install(kind.extra)}.")
        return
    if config.source is not None:
        name = found.scheme if found.scheme in ("i2c", "iio") else "source"
        refusal = list(refused(name, lambda: _open(found, config)))
        if refusal:
            yield from refusal
            return
    assert kind is not None  # `_open` refuses a URL of an unknown kind
    module = cast(SourceModule, importlib.import_module(kind.check or kind.module))
    yield from module.check_source(AskedSource(config.source, found.place, config, system, hear_s))


def _open(found: Named, config: Config) -> None:
    """Open the source as `fltea run` does, but do not start it.

    Raises:
        FlteaError: `fltea run` would refuse the source.
    """
    kind, path = BY_SCHEME.get(found.scheme), Path(found.place)
    if kind is not None and kind.shared:
        receiver_of(config)(Inbox(1, 1), lambda kind, message: None)
    elif found.scheme == STDIN and path.is_fifo():
        TextEvents(config.source or "", config.replay.how, fatal=False)
    elif found.scheme != REPLAY or not path.exists() or is_stored(path):
        source = open_source(config)
        source.close()
        check_recordable(config, source)
