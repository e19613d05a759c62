"""The settings of the outputs, named as in the TOML file, and the table of all outputs.

A new output needs a table of settings, a field of `Outputs` and a row of `OUTPUTS` in this module;
host/CHANGING.md lists what else. If something is missing, `tests/service/test_output_table.py` names it.
"""

import ipaddress
from operator import attrgetter
from typing import Annotated, Literal, NamedTuple, get_args

import msgspec

from fltea.settings.mqtt import MqttConfig
from fltea.settings.setting import Setting, Table

Recorded = Literal[
    "hello",
    "epoch",
    "gap",
    "step",
    "motion",
    "sample",
    "corrected",
    "estimate",
    "device_estimate",
    "fit",
    "device_fit",
    "stats",
    "error",
]
"""Names of the kinds of records that a recording can hold. It always holds the device's bytes as well."""

RECORDED: tuple[Recorded, ...] = get_args(Recorded)

EACH_SAMPLE: tuple[Recorded, ...] = ("sample", "corrected", "estimate", "device_estimate")
FEW_DEVICES = 32
"""By default, recordings hold the kinds of records in `EACH_SAMPLE` only with at most this number of devices.

These kinds have one record for each sample, which with many devices would fill most of a file. A replay makes
these records again from the recorded bytes.
"""

LOOPBACK = "127.0.0.1"


def listen_address(text: str) -> tuple[str, int]:
    """Return the host and the port in an address.

    If the address names no host, the host is the loopback, to which no other machine can connect.

    Raises:
        ValueError: `text` is no address.
    """
    host, colon, port = text.strip().rpartition(":")
    if host.startswith("[") and host.endswith("]"):
        host = host[1:-1]
    elif ":" in host:
        raise ValueError("address: put an IPv6 host into brackets: [::1]:9100")
    if (colon and not host) or not (port.isascii() and port.isdigit()) or int(port) > 65535:
        raise ValueError("address must be PORT or HOST:PORT, for instance 9100 or 0.0.0.0:9100")
    return host or LOOPBACK, int(port)


def is_loopback(host: str) -> bool:
    """Return whether only this machine can connect to a server that listens at `host`."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


class OutputConfig(Table, frozen=True):
    """Settings that apply to all outputs."""

    every: Annotated[
        int,
        Setting(
            "Write samples and estimates of every N-th sample only (`seq` a multiple of N), to all "
            "outputs. All samples are estimated and recorded.",
            unit="samples",
            least=1,
            most=1_000_000,
            flags=("--every",),
            metavar="N",
        ),
    ] = 1
    corrected: Annotated[
        bool,
        Setting(
            "Also write the records `corrected`: rates less their biases, with σ.",
            flags=("--corrected",),
        ),
    ] = False


class RecordConfig(Table, frozen=True):
    """Settings for recording in MCAP files, which is off without a folder."""

    folder: Annotated[
        str | None,
        Setting(
            "Record all bytes and records as MCAP files in this folder.",
            text="the name of a folder",
            flags=("--record",),
            metavar="DIR",
            example="recordings",
        ),
    ] = None
    rotate_mb: Annotated[
        float,
        Setting(
            "Start a new file when a file has reached this size.",
            unit="MB",
            above=0,
            flags=("--rotate-mb",),
            metavar="MB",
        ),
    ] = 256.0
    rotate_s: Annotated[
        float,
        Setting(
            "Start a new file when a file has reached this age.",
            unit="s",
            above=0,
            flags=("--rotate-s",),
            metavar="SECONDS",
        ),
    ] = 3600.0
    resume_mb: Annotated[
        float,
        Setting(
            "If a full disk has stopped a recording, it continues as soon as there is this much free space.",
            unit="MB",
            least=0,
        ),
    ] = 16.0
    channels: Annotated[
        tuple[Recorded, ...] | None,
        Setting(
            "Kinds of decoded records that are written in addition to the bytes. Unset: all kinds; with "
            f"more than {FEW_DEVICES} devices none that come with each sample, since a replay makes them "
            "again from the bytes.",
            example=["epoch", "stats", "error"],
        ),
    ] = None

    def for_devices(self, count: int) -> "RecordConfig":
        """Return these settings. If `channels` is unset, it is set to the default for `count` devices."""
        usual = RECORDED if count <= FEW_DEVICES else tuple(x for x in RECORDED if x not in EACH_SAMPLE)
        return msgspec.structs.replace(self, channels=usual if self.channels is None else self.channels)


def _address(what: str, flag: str, port: int) -> Setting:
    return Setting(
        f"{what}, PORT or HOST:PORT; without a host for this machine only.",
        text="PORT or HOST:PORT",
        least=0,
        most=65535,
        flags=(flag,),
        metavar="[HOST:]PORT",
        example=port,
    )


class Listening(Table, frozen=True):
    """Base of the settings of a server that listens at an address. Without an address there is no server."""

    address: str | int | None = None
    names: Annotated[
        tuple[str, ...],
        Setting(
            "Further host names that browsers may use, such as a proxy's.",
            example=("pi.example",),
        ),
    ] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.address is not None:
            self.listen()

    def listen(self) -> tuple[str, int]:
        """Return host and port; raise ValueError if `address` is no address."""
        return listen_address(str(self.address))


class DashboardConfig(Listening, frozen=True):
    """Settings of the live page, which is off without an address."""

    address: Annotated[str | int | None, _address("Address of the live page", "--dashboard", 5006)] = None
    password_file: Annotated[
        str | None,
        Setting(
            "File with one line USER:PASSWORD that the page asks for; not readable by others.",
            text="the name of a file",
            example="/etc/fltea/page",
        ),
    ] = None
    visitors: Annotated[int, Setting("Pages that may be open at the same time.", unit="pages", least=1)] = 20
    record: Annotated[
        bool | None,
        Setting(
            "Let pages start and stop recordings. Unset: only if no other machine can reach the pages.",
            example=False,
        ),
    ] = None
    record_to: Annotated[
        str,
        Setting(
            "Folder of recordings that pages start, unless `record.folder` names one.",
            text="the name of a folder",
        ),
    ] = "recordings"

    @property
    def may_record(self) -> bool:
        """Whether users may start and stop recordings on the live page."""
        return is_loopback(self.listen()[0]) and not self.names if self.record is None else self.record


class MetricsConfig(Listening, frozen=True):
    """Settings of the metrics for Prometheus, which are off without an address."""

    address: Annotated[str | int | None, _address("Address of metrics for Prometheus", "--metrics", 9100)] = (
        None
    )


class StateConfig(Table, frozen=True):
    """Settings of the estimators' snapshots, from which a restarted daemon continues; off without a file."""

    file: Annotated[
        str | None,
        Setting(
            "File in which the state of the estimators is kept over a restart.",
            text="the name of a file",
            flags=("--state",),
            metavar="FILE",
            example="fltea.state",
        ),
    ] = None
    max_age_s: Annotated[
        float, Setting("A snapshot that is older than this is not used.", unit="s", above=0, most=1e9)
    ] = 3600.0
    period_s: Annotated[
        float,
        Setting("Time between two snapshots. A last snapshot is written at the end.", unit="s", above=0),
    ] = 60.0


class Outputs(Table, frozen=True, kw_only=True):
    """The tables of settings of all outputs.

    The fields are keyword-only, so that in `Config`, which inherits them, the fields of `Config` come first.
    """

    output: OutputConfig = OutputConfig()
    record: RecordConfig = RecordConfig()
    mqtt: MqttConfig = MqttConfig()
    dashboard: DashboardConfig = DashboardConfig()
    metrics: MetricsConfig = MetricsConfig()
    state: StateConfig = StateConfig()


class Output(NamedTuple):
    """One output, a row of `OUTPUTS`.

    `name`: key of the output's counts in `stats.outputs`. `on`: path of the setting that switches the output
    on. `when`: values that switch it on; if empty, every value does. `module`: name of the module in
    `fltea.sinks` that opens the output, and checks it for `fltea doctor` (`OutputModule` in
    `sinks/opening.py`). `each`: whether the output is opened once for the program, once for each device, or
    once for all shared sources (sources of many devices). `section`: the output's heading in the guide to
    outputs. `what`: what the output writes, for the guide's table. `extra`: extra of the package that
    installs `library`. `library`: module that the output needs. `of_many`: whether it works with shared
    sources.
    """

    name: str
    on: str
    module: str
    each: Literal["program", "device", "shared source"]
    section: str
    what: str
    extra: str = ""
    library: str = ""
    when: tuple[str, ...] = ()
    of_many: bool = True

    def is_on(self, config: Outputs) -> bool:
        """Return whether the configuration asks for this output."""
        value = attrgetter(self.on)(config)
        return value in self.when if self.when else value is not None


_LINES = "Lines as a table", "records as lines of JSON"
_TABLE = "Lines as a table", "a live table on a terminal"
_RECORD = "Recordings in MCAP", "all bytes and records in files"
_MQTT = "MQTT", "records to a broker"

OUTPUTS = (
    Output("stdout", "format", "ndjson", "program", *_LINES, when=("ndjson",)),
    Output("record", "record.folder", "record", "device", *_RECORD, "record", "mcap", of_many=False),
    Output("mqtt", "mqtt.broker", "mqtt.sink", "device", *_MQTT, "mqtt", "paho"),
    Output("mqtt", "mqtt.broker", "mqtt.many", "shared source", *_MQTT, "mqtt", "paho"),
    Output(
        *("metrics", "metrics.address", "metrics.sink", "program"),
        *("Metrics", "the newest figures for Prometheus"),
        *("metrics", "prometheus_client"),
    ),
    Output(
        *("dashboard", "dashboard.address", "page.sink", "program"),
        *("Live page", "verdicts and drawings in a browser"),
        *("dashboard", "tornado"),
        of_many=False,
    ),
    Output("stdout", "format", "table", "program", *_TABLE, when=("table",)),
)
"""All outputs in the order in which they are opened. Standard output as NDJSON is first, so that it receives
the errors that other outputs report. The table in the terminal is last, since it draws over the whole
terminal. The log on stderr is not in the list, since the record `stats` has no counts of it.
"""
