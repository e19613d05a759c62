"""Opens the outputs that the configuration asks for; the libraries of each are loaded only then."""

import io
import sys
from collections.abc import Collection, Sequence
from types import ModuleType

from fltea.service.hub import Hub
from fltea.service.recorder import RecorderOfHub
from fltea.settings.config import Config
from fltea.settings.extras import load
from fltea.settings.ingest import is_shared
from fltea.sinks.log import LogSink
from fltea.sinks.ndjson import NdjsonSink


def open_outputs(configs: Sequence[Config], hub: Hub, replays: Collection[str] = ()) -> None:
    """Add all outputs to the hub. replays: names of the devices that are recordings.

    Raises:
        UsageError: wrong settings, or a library that is not installed.
        FlteaError: an output that cannot be opened, such as a port that is taken.
    """
    program = configs[0]
    to_table = program.format == "table" or (program.format == "auto" and sys.stdout.isatty())
    if not to_table:
        hub.add_log(LogSink(_to_stderr, several=len(configs) > 1))
        if program.format != "none":  # before all that may report something
            stdout = io.FileIO(sys.stdout.fileno(), "wb", closefd=False)
            hub.add(NdjsonSink(stdout, samples=program.samples))
    of_record = program.record.for_devices(len(configs))
    recorder = RecorderOfHub(hub, of_record, program.dashboard.record_to, replays)
    for config in configs:
        assert config.name is not None
        if of_record.folder is not None:
            module = _module("record", "record", "mcap")
            sink = module.RecordSink(of_record, config.name, hub.report(config.name))
            recorder.adopt(config.name, hub.add(sink, config.name))
        if program.mqtt.broker is not None and not is_shared(config.source):
            module = _module("mqtt.sink", "mqtt", "paho")
            hub.add(module.MqttSink(program.mqtt, config.name, hub.report(config.name)), config.name)
    shared = [config.name or "" for config in configs if is_shared(config.source)]
    if program.mqtt.broker is not None and shared:
        module = _module("mqtt.many", "mqtt", "paho")
        apart = {config.name for config in configs if not is_shared(config.source)}
        hub.add(module.ManyMqttSink(program.mqtt, shared[0], hub.report(), apart))
    if program.metrics.address is not None:
        module = _module("metrics.sink", "metrics", "prometheus_client")
        hub.add(module.MetricsSink(program.metrics, hub.outlets, hub.report()))
    if program.dashboard.address is not None:
        module = _module("page.sink", "dashboard", "tornado")
        devices = {config.name: config.estimator.estimate_on for config in configs}
        page = module.DashboardSink(program.dashboard, devices, hub.report(), recorder)
        hub.add(page)
        _to_stderr(f"fltea: live page at {page.url}\n")
    if to_table:
        from fltea.sinks.table import TableSink

        hub.add(TableSink())


def _module(name: str, extra: str, library: str) -> ModuleType:
    return load(f"fltea.sinks.{name}", library, extra, "this output needs")


def _to_stderr(text: str) -> None:
    sys.stderr.write(text)
    sys.stderr.flush()
