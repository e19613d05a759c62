"""Checks of the outputs, each by its own module, and of the file of snapshots."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from fltea.diagnostics.asked import AskedOutput
from fltea.diagnostics.finding import Finding, problem, refused
from fltea.diagnostics.folders import check_writable
from fltea.diagnostics.host_system import System
from fltea.service.state import check_file
from fltea.settings.config import Config
from fltea.settings.outputs import OUTPUTS
from fltea.sinks.opening import output_module


def check_outputs(configs: Sequence[Config], system: System) -> Iterator[Finding]:
    """Yield findings on every output that is switched on, and on the file that keeps a fit for the next run.

    An output whose library is not installed is left out here: `check_packages` reports it.
    """
    config = configs[0]  # the configuration of outputs is the same for all devices
    checked: set[str] = set()
    for output in OUTPUTS:
        # MQTT is in OUTPUTS twice, for single devices and for sources of many devices, but has one check
        if not output.is_on(config) or output.name in checked:
            continue
        checked.add(output.name)
        if not output.library or system.has_module(output.library):
            yield from output_module(output).check_output(AskedOutput(configs, system))
    if config.state.file is not None:
        yield from _snapshot(Path(config.state.file))


def _snapshot(file: Path) -> Iterator[Finding]:
    folder = file.parent
    if file.is_dir() and not file.is_symlink():
        yield problem("state", f"{file} is a folder.", "give the name of a file.")
    elif not folder.exists():
        yield problem("state", f"there is no folder {folder}.", f"mkdir -p {folder}")
    elif found := list(check_writable("state", folder)):
        yield from found
    else:
        yield from refused("state", lambda: check_file(file))
