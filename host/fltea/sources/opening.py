"""Define the functions of every source's module (`SourceModule`), and what these functions get."""

import os
from collections.abc import Iterator
from typing import NamedTuple, Protocol

from fltea.diagnostics.asked import AskedSource
from fltea.diagnostics.finding import Finding
from fltea.records.errors import UsageError
from fltea.records.ports import Source
from fltea.settings.config import Config
from fltea.settings.estimator import BY_DEVICE


class Named(NamedTuple):
    """What a URL names.

    Attributes:
        scheme: scheme of the URL. For a bare path it is that of a recording, a pipe or a serial port.
        place: part of the URL after the colon. For a bare path or a URL of the library pyserial, all of it.
    """

    scheme: str
    place: str


class SourceModule(Protocol):
    """The functions of a module that a row of `SOURCES` names, for a source of one device."""

    def open_named(self, named: Named, config: Config) -> Source:
        """Return the source, not started yet.

        Raises:
            UsageError: the URL or a setting is wrong.
        """

    def only_reader_of(self, named: Named) -> str:
        """Return what one source alone can read from, such as a port or a sensor, as words for a message.

        URLs that name the same place differently give the same text. The text is empty if several sources may
        read from the place, as from a recording.

        Raises:
            UsageError: the URL is wrong.
        """

    def check_source(self, asked: AskedSource) -> Iterator[Finding]:
        """Yield what `fltea doctor` finds about the source, at least one finding.

        A row may name another module that has this function.
        """


def port_here(url: str) -> str:
    """Return the name of a serial port of this machine, which is the same for all paths of the port.

    It is empty for a port on the network, whose server may serve several programs.
    """
    if "://" not in url:
        return os.path.realpath(url)
    return url if url.startswith("hwgrep:") else ""


def need_wire(config: Config, url: str) -> None:
    """Refuse estimates by the device, for a source that gives samples only.

    Raises:
        UsageError: the configuration asks for the estimates of the device.
    """
    who = config.estimator.estimate_on
    if who in BY_DEVICE:
        raise UsageError(
            f"--estimate-on {who}: {url} gives samples only. An Arduino Due estimates by itself, so this "
            "needs its port (serial:PORT) or an .mcap recording of it; else --estimate-on host."
        )
