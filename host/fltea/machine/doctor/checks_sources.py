"""Checks of a device's source, by the kind of source that its URL names."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from fltea.machine.doctor.checks_i2c import check_i2c
from fltea.machine.doctor.checks_iio import check_iio
from fltea.machine.doctor.checks_link import check_serial
from fltea.machine.doctor.checks_outputs import answers
from fltea.machine.doctor.finding import Finding, ok, problem
from fltea.machine.host_system import System
from fltea.settings.config import Config
from fltea.settings.extras import how_to_install
from fltea.settings.ingest import broker_at, nats_servers
from fltea.settings.sources import BY_SCHEME
from fltea.sources.open_source import named


class Asked(NamedTuple):
    """A source that is to be checked.

    Attributes:
        url: URL of the source.
        place: part of the URL after the scheme.
        config: configuration of the device.
        system: the machine.
        hear_s: how long to listen to a board after its HELLO [s].
    """

    url: str
    place: str
    config: Config
    system: System
    hear_s: float


def check_source(config: Config, system: System, hear_s: float) -> Iterator[Finding]:
    """Yield findings on the source at a device's URL.

    Raises:
        UsageError: the URL names no kind of source, or no address.
    """
    url = config.source
    if url is None:
        yield from check_serial(system, None, config.link.baud, hear_s)
        return
    scheme, place = named(url)
    kind = BY_SCHEME.get(scheme)
    if kind is not None and kind.extra and not system.has_module(kind.library):
        text = f"{scheme}: the package {kind.library} is not installed."
        yield problem("source", text, f"{how_to_install(kind.extra)}.")
        return
    check = CHECKS.get(kind.schemes[0] if kind is not None else "", _serial)
    yield from check(Asked(url, place, config, system, hear_s))


def _serial(asked: Asked) -> Iterator[Finding]:
    place = asked.place if asked.url.startswith("serial:") else asked.url
    yield from check_serial(asked.system, place, asked.config.link.baud, asked.hear_s)


def _i2c(asked: Asked) -> Iterator[Finding]:
    yield from check_i2c(asked.system, asked.url)


def _iio(asked: Asked) -> Iterator[Finding]:
    yield from check_iio(asked.system, asked.place)


def _text(asked: Asked) -> Iterator[Finding]:
    yield ok("source", f"{asked.url}: lines of text; 'fltea run' tells what is wrong with them")


def _synthetic(asked: Asked) -> Iterator[Finding]:
    yield ok("source", f"{asked.url}: synthetic noise, nothing to check")


def _recording(asked: Asked) -> Iterator[Finding]:
    file = Path(asked.place)
    if file.exists():
        yield ok("source", f"{file}: a recording, nothing to check")
    else:
        yield problem("source", f"{file}: there is no such recording.", "check the name.")


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
    "serial-text": _text,
    "mqtt": _mqtt,
    "nats": _nats,
    "synthetic": _synthetic,
}
"""For each kind of source, the function that checks such sources. The key is the first URL scheme of the
kind's row in `SOURCES`.
"""
