"""Define the functions of every output's module (`OutputModule`), and what the program hands to them."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, Protocol, cast

from fltea.diagnostics.asked import AskedOutput
from fltea.diagnostics.finding import Finding
from fltea.records.ports import OutputView, Recorder, Report, Sink
from fltea.settings.config import Config
from fltea.settings.extras import load
from fltea.settings.outputs import Output


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


class OutputModule(Protocol):
    """The functions of a module that a row of `OUTPUTS` names."""

    def open_output(self, opening: Opening) -> Sink:
        """Open the output.

        Raises:
            UsageError: a setting is wrong.
            FlteaError: the output cannot be opened.
        """

    def check_output(self, asked: AskedOutput) -> Iterator[Finding]:
        """Yield what `fltea doctor` finds about the output before it is opened; it may be nothing."""


def output_module(output: Output) -> OutputModule:
    """Load the module of an output.

    Raises:
        UsageError: the library that the output needs is not installed.
    """
    module = load(f"fltea.sinks.{output.module}", output.library, output.extra, "this output needs")
    return cast(OutputModule, module)
