"""Define what the function `open_output` of an output's module receives about the program."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from fltea.records.ports import OutputView, Recorder, Report
from fltea.settings.config import Config


class Opening(NamedTuple):
    """What the program hands to an output that it opens.

    `configs`: settings of all devices; the first one also has the program's settings. `device`: name of the
    device whose records the output gets; "" for an output of all devices. `apart`: names of the sources that
    are a single device. `shared`: names of the sources with many devices. `report`: sends an `error` record
    to all outputs. `sink_queues`: returns all outputs, each with the name of its device, or with None if all
    devices share it. `recorder`: begins and ends recordings. `say`: writes to the terminal.
    """

    configs: Sequence[Config]
    device: str
    apart: Sequence[str]
    shared: Sequence[str]
    report: Report
    sink_queues: Callable[[], Sequence[tuple[str | None, OutputView]]]
    recorder: Recorder
    say: Callable[[str], object]

    @property
    def program(self) -> Config:
        """Settings of the whole program."""
        return self.configs[0]
