"""Define what the program hands to the function `open_output`, which every output's module has."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from fltea.records.ports import OutputView, Recorder, Report
from fltea.settings.config import Config


class Opening(NamedTuple):
    """What `open_output` receives about the program.

    `configs`: the settings of each device; those of the first device also contain the program's settings.
    `device`: name of the device whose records the output gets; "" for an output of all devices. `apart`:
    names of the sources that have a single device each. `shared`: names of the sources that have many devices
    each. `report`: sends an `error` record to all outputs. `sink_queues`: returns all outputs, each with the
    name of its device, or with None if all devices share it. `recorder`: begins and ends recordings. `say`:
    writes to the terminal.
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
