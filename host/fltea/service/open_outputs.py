"""Open the outputs that the configuration asks for, and load the libraries of those outputs only."""

import sys
from collections.abc import Collection, Sequence

import msgspec

from fltea.service.hub import Hub
from fltea.service.recorder import RecorderOfHub
from fltea.settings.config import Config
from fltea.settings.outputs import OUTPUTS
from fltea.settings.sources import is_shared
from fltea.sinks.log import LogSink
from fltea.sinks.opening import Opening, output_module


def open_outputs(configs: Sequence[Config], hub: Hub, replays: Collection[str] = ()) -> None:
    """Add all outputs to the hub. `replays`: names of the devices whose source is a recording.

    Raises:
        UsageError: a setting is wrong, or a library is not installed.
        FlteaError: an output cannot be opened, for example because another program uses its network port.
    """
    program = _with_format(configs[0])
    configs = [program, *configs[1:]]
    if program.format != "table":
        hub.add_log(LogSink(_to_stderr, several=len(configs) > 1))
    of_record = program.record.for_devices(len(configs))
    recorder = RecorderOfHub(hub, of_record, program.dashboard.record_to, replays)
    shared = [config.name or "" for config in configs if is_shared(config.source)]
    apart = [config.name or "" for config in configs if not is_shared(config.source)]
    opening = Opening(configs, "", apart, shared, hub.report(), hub.sink_queues, recorder, _to_stderr)
    for output in OUTPUTS:
        if not output.is_on(program):
            continue
        if output.each == "device":
            for name in apart:
                of_one = opening._replace(device=name, report=hub.report(name))
                sink_queue = hub.add(output_module(output).open_output(of_one), name)
                if output.name == "record":
                    recorder.adopt(name, sink_queue)
        elif output.each == "program" or shared:
            hub.add(output_module(output).open_output(opening))


def _with_format(program: Config) -> Config:
    """Return the settings with a format for the standard output, also if the user has set none."""
    if program.format != "auto":
        return program
    return msgspec.structs.replace(program, format="table" if sys.stdout.isatty() else "ndjson")


def _to_stderr(text: str) -> None:
    sys.stderr.write(text)
    sys.stderr.flush()
