"""What an output may know of the program while it is opened, by the `open_output` of its module."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from fltea.records.ports import OutputView, Recorder, Report
from fltea.settings.config import Config


class Opening(NamedTuple):
    """The program that opens an output.

    configs: of all devices; the first also says what holds for the program. device: the name of the one that
    the output is for, "" if it is for all. apart: names of sources that stand for one device; shared: of
    those that stand for many. report: tells a trouble to all outputs. outlets: all outputs, each with the
    device that it belongs to, or None. recorder: begins and ends recordings. say: writes to the terminal.
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
        """What holds for the whole program."""
        return self.configs[0]
