"""Define the functions of every source's module (`SourceModule`), and what these functions get."""

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

    def check_source(self, asked: AskedSource) -> Iterator[Finding]:
        """Yield what `fltea doctor` finds about the source, at least one finding.

        A row may name another module that has this function.
        """


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
