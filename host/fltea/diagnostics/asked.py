"""What `fltea doctor` asks the module of a source or of an output to check."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from fltea.settings.config import Config

if TYPE_CHECKING:
    # not imported when the program runs: the daemon, which loads this module too, would start later
    from fltea.diagnostics.host_system import System


class AskedSource(NamedTuple):
    """A source that is to be checked.

    Attributes:
        url: URL of the source; None for the Due that is plugged in.
        place: part of the URL after the scheme.
        config: configuration of the device.
        system: the machine.
        hear_s: how long to listen to a board after its HELLO [s].
    """

    url: str | None
    place: str
    config: Config
    system: "System"
    hear_s: float


class AskedOutput(NamedTuple):
    """An output that is to be checked.

    Attributes:
        configs: configurations of all devices; those of outputs are the same in each.
        system: the machine.
    """

    configs: Sequence[Config]
    system: "System"

    @property
    def program(self) -> Config:
        """Settings of the whole program."""
        return self.configs[0]
