"""Checks of a device's source, by the module that the row of its kind in `SOURCES` names."""

import os
import importlib
from collections.abc import Iterator
from typing import cast

from fltea.machine.doctor.checks_i2c import check_i2c
from fltea.machine.doctor.checks_iio import check_iio
from fltea.machine.doctor.checks_link import check_serial, find_usable
from fltea.machine.doctor.checks_outputs import answers, refused
from fltea.machine.doctor.finding import Finding, ok, problem
from fltea.service.ingest.inbox import Inbox
from fltea.service.ingest.receivers import receiver_of
from fltea.settings.config import Config
from fltea.settings.extras import how_to_install
from fltea.settings.ingest import broker_at, nats_servers
from fltea.settings.sources import BY_SCHEME, REPLAY, STDIN, SourceKind
from fltea.sources.open_source import check_recordable, named, open_source
from fltea.sources.text_events import TextEvents
from fltea.sources.text_lines import parse_serial
from fltea.sources.opening import Named, SourceModule


def check_source(config: Config, system: System, hear_s: float) -> Iterator[Finding]:
    """Yield findings on the source at a device's URL.

    What `fltea run` would refuse is a problem. A pipe is not opened, since its writer would notice.
    """
    scheme, place = Named(SERIAL, "") if config.source is None else named(config.source)
    kind = BY_SCHEME.get(scheme)
    if kind is None:
        kind, place = BY_SCHEME[SERIAL], config.source or ""
    if kind.extra and not system.has_module(kind.library):
        text = f"{scheme}: the package {kind.library} is not installed."
        yield problem("source", text, f"{how_to_install(kind.extra)}.")
        return
    asked = Asked(url, place, config, system, hear_s)
    name = scheme if scheme in ("i2c", "iio") else "source"
    refusal = list(refused(name, lambda: _open(asked, scheme, kind)))
    if refusal:
        yield from refusal
        return
    check = CHECKS.get(kind.schemes[0] if kind is not None else "", _serial)
    yield from check(asked)


def _open(asked: Asked, scheme: str, kind: SourceKind | None) -> None:
    """Open the source as `fltea run` does, but do not start it.

    Raises:
        FlteaError: `fltea run` would refuse the source.
    """
    config = asked.config
    if kind is not None and kind.shared:
        receiver_of(config)(Inbox(1, 1), lambda kind, message: None)
    elif scheme == STDIN and Path(asked.place).is_fifo():
        TextEvents(asked.url, config.replay.how, fatal=False)
    elif scheme != REPLAY or not Path(asked.place).exists() or is_stored(Path(asked.place)):
        source = open_source(config)
        source.close()
        check_recordable(config, source)


def is_stored(path: Path) -> bool:
    """Return whether a recording can be read more than once, as a pipe cannot."""
    return path.is_file() or path.is_dir()


def _serial(asked: Asked) -> Iterator[Finding]:
    place = asked.place if asked.url.startswith("serial:") else asked.url
    yield from check_serial(asked.system, place, asked.config.link.baud, asked.hear_s)


def _i2c(asked: Asked) -> Iterator[Finding]:
    yield from check_i2c(asked.system, asked.url)


def _iio(asked: Asked) -> Iterator[Finding]:
    yield from check_iio(asked.system, asked.place)


def _text(asked: Asked) -> Iterator[Finding]:
    path = Path(asked.place)
    if path.is_fifo() and not os.access(path, os.R_OK):
        yield problem("source", f"{asked.system.user()} may not read {path}.", f"chmod u+r {path}")
        return
    yield ok("source", f"{asked.url}: lines of text; 'fltea run' tells what is wrong with them")


def _serial_text(asked: Asked) -> Iterator[Finding]:
    port, _ = parse_serial(asked.place)
    if "://" not in port and (yield from find_usable(asked.system, port)) is None:
        return
    yield from _text(asked)


def _synthetic(asked: Asked) -> Iterator[Finding]:
    yield ok("source", f"{asked.url}: synthetic noise")


def _recording(asked: Asked) -> Iterator[Finding]:
    path = Path(asked.place)
    text = "a recording that can be read" if is_stored(path) else "a pipe, which can be read only once"
    yield ok("source", f"{path}: {text}")


def _mqtt(asked: Asked) -> Iterator[Finding]:
    broker = broker_at(asked.url, asked.config.mqtt).address()
    yield answers("source", "broker", broker.host, broker.port)


def _nats(asked: Asked) -> Iterator[Finding]:
    for server in nats_servers(asked.url):
        yield answers("source", "NATS server", server.host, server.port)


CHECKS: dict[str, Callable[[Asked], Iterator[Finding]]] = {
    "serial": _serial,
    "i2c": _i2c,
    "iio": _iio,
    "replay": _recording,
    "stdin": _text,
    "serial-text": _serial_text,
    "mqtt": _mqtt,
    "nats": _nats,
    "synthetic": _synthetic,
}
"""Function that checks a source, by the first scheme of its kind in `SOURCES`."""
