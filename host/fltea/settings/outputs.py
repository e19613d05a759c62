"""Settings of the outputs, each with the name of its table in the TOML file (host/docs/guide/outputs.md)."""

import ipaddress
from typing import Annotated, Literal, NamedTuple, get_args
from urllib.parse import urlsplit

import msgspec

from fltea.records.secret import refuse_secret
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
"""Classes of the records that can ride along in a recording."""

RECORDED: tuple[Recorded, ...] = get_args(Recorded)

EACH_SAMPLE: tuple[Recorded, ...] = ("sample", "corrected", "estimate", "device_estimate")
FEW_DEVICES = 32
"""More are recorded without what comes with each sample: most of a file, and its bytes give it again."""

LOOPBACK = "127.0.0.1"


def listen_address(text: str) -> tuple[str, int]:
    """Host and port; without a host the loopback, so that nobody else on the network can connect.

    Raises:
        ValueError: no such address can be.
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
    """Whether only this machine reaches what listens there."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


class OutputConfig(Table, frozen=True):
    """What holds for every output alike."""

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
    """Recording in MCAP files; off without a folder."""

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
            "Start a new file beyond this size.", unit="MB", above=0, flags=("--rotate-mb",), metavar="MB"
        ),
    ] = 256.0
    rotate_s: Annotated[
        float,
        Setting(
            "Start a new file beyond this age.", unit="s", above=0, flags=("--rotate-s",), metavar="SECONDS"
        ),
    ] = 3600.0
    resume_mb: Annotated[
        float,
        Setting(
            "Room needed before a recording that a full disk stopped goes on.",
            unit="MB",
            least=0,
        ),
    ] = 16.0
    channels: Annotated[
        tuple[Recorded, ...] | None,
        Setting(
            f"Decoded records that are written with the bytes. Unset: all; of more than {FEW_DEVICES} "
            "devices none that come with each sample, since a replay makes them again from the bytes.",
            example=["epoch", "stats", "error"],
        ),
    ] = None

    def for_devices(self, count: int) -> "RecordConfig":
        """Return these settings with the channels that so many devices have."""
        usual = RECORDED if count <= FEW_DEVICES else tuple(x for x in RECORDED if x not in EACH_SAMPLE)
        return msgspec.structs.replace(self, channels=usual if self.channels is None else self.channels)


class BrokerAddress(NamedTuple):
    """Where an MQTT broker listens."""

    host: str
    port: int
    tls: bool

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'mqtts' if self.tls else 'mqtt'}://{host}:{self.port}"


class MqttConfig(Table, frozen=True):
    """Publishing to an MQTT broker; off without one."""

    broker: Annotated[
        str | None,
        Setting(
            "MQTT broker to publish to: HOST[:PORT], or mqtts://HOST[:PORT] for TLS; user and password "
            "from FLTEA_MQTT_USER and FLTEA_MQTT_PASSWORD.",
            flags=("--mqtt",),
            metavar="BROKER",
            example="mqtts://broker.example",
        ),
    ] = None
    prefix: Annotated[str, Setting("Beginning of all topics.")] = "fltea"
    discovery: Annotated[
        str | None,
        Setting(
            "Prefix under which Home Assistant looks for devices; each board then appears there by itself.",
            example="homeassistant",
        ),
    ] = None
    estimate_every: Annotated[
        int,
        Setting(
            "Publish the estimate of every N-th sample (`seq` a multiple of N). The larger of this and "
            "`output.every` counts.",
            unit="samples",
            least=1,
        ),
    ] = 10
    sample_every: Annotated[int, Setting("The same for samples; 0: none.", unit="samples", least=0)] = 0
    stream_qos: Annotated[
        Literal[0, 1],
        Setting("Quality of service of estimates and samples; everything else has 1."),
    ] = 0
    tls: Annotated[bool, Setting("Use TLS, as with mqtts://.")] = False
    ca: Annotated[
        str | None,
        Setting("PEM file of the authority that signed the broker's certificate.", example="ca.pem"),
    ] = None
    cert: Annotated[str | None, Setting("PEM file of this client's certificate.", example="client.pem")] = (
        None
    )
    key: Annotated[str | None, Setting("PEM file of the certificate's key.", example="client.key")] = None
    insecure: Annotated[bool, Setting("Accept any certificate of the broker.")] = False
    password_file: Annotated[
        str | None, Setting("File with one line USER:PASSWORD.", example="/etc/fltea/mqtt")
    ] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, topic in (("prefix", self.prefix), ("discovery", self.discovery)):
            for level in () if topic is None else topic.split("/"):
                if not level or any(c in "+#" or ord(c) < 32 for c in level) or level.startswith("$"):
                    raise ValueError(f"{name} must be a topic without +, #, a leading $ or empty levels")
        if self.key is not None and self.cert is None:
            raise ValueError("key belongs to a certificate: give cert too")
        tls_only = [name for name in ("ca", "cert", "insecure") if getattr(self, name)]
        if self.broker is not None and tls_only and not self.address().tls:
            raise ValueError(f"{tls_only[0]} has no use without TLS: write mqtts://, or tls = true")
        if self.broker is not None:
            self.address()

    def address(self) -> BrokerAddress:
        """Take the broker's address apart.

        Raises:
            ValueError: it is none; the text does not repeat it.
            UsageError: there is a password in it.
        """
        assert self.broker is not None
        refuse_secret("mqtt.broker", self.broker, "mqtt")
        try:
            url = urlsplit(self.broker if "://" in self.broker else f"mqtt://{self.broker}")
            tls = self.tls or url.scheme == "mqtts"
            port = url.port if url.port is not None else 8883 if tls else 1883
            host = url.hostname or ""
            host.encode("idna")
        except ValueError:  # UnicodeError is one
            host, port = "", 0
        if not host or not port or url.scheme not in ("mqtt", "mqtts") or url.path.strip("/") or url.query:
            raise ValueError("broker must be HOST, HOST:PORT, mqtt://HOST:PORT or mqtts://HOST:PORT")
        return BrokerAddress(host, port, tls)


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
    """What listens at an address; off without one."""

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
        """Host and port; raises ValueError if there can be no such address."""
        return listen_address(str(self.address))


class DashboardConfig(Listening, frozen=True):
    """The live page; off without an address."""

    address: Annotated[str | int | None, _address("Address of the live page", "--dashboard", 5006)] = None
    password_file: Annotated[
        str | None,
        Setting(
            "File with one line USER:PASSWORD that the page asks for; not readable by others.",
            example="/etc/fltea/page",
        ),
    ] = None
    visitors: Annotated[int, Setting("Pages that may be open at the same time.", unit="pages", least=1)] = 20
    record: Annotated[
        bool | None,
        Setting(
            "Let pages start and stop recordings. Unset: if only this machine reaches them.",
            example=False,
        ),
    ] = None
    record_to: Annotated[
        str,
        Setting(
            "Folder of such recordings, unless `record.folder` names one.",
            text="the name of a folder",
        ),
    ] = "recordings"

    @property
    def may_record(self) -> bool:
        """Whether pages may start and stop recordings."""
        return is_loopback(self.listen()[0]) and not self.names if self.record is None else self.record


class MetricsConfig(Listening, frozen=True):
    """Metrics for Prometheus; off without an address."""

    address: Annotated[str | int | None, _address("Address of metrics for Prometheus", "--metrics", 9100)] = (
        None
    )


class StateConfig(Table, frozen=True):
    """Snapshots of the estimators, with which a restarted daemon goes on; off without a file."""

    file: Annotated[
        str | None,
        Setting(
            "File that keeps the estimators over a restart.",
            text="the name of a file",
            flags=("--state",),
            metavar="FILE",
            example="fltea.state",
        ),
    ] = None
    max_age_s: Annotated[float, Setting("An older snapshot is not used.", unit="s", above=0, most=1e9)] = (
        3600.0
    )
    period_s: Annotated[
        float,
        Setting("Time between snapshots; another is written at the end.", unit="s", above=0),
    ] = 60.0
