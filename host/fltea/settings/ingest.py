"""Settings of shared sources, through which many devices send: the table `ingest` of the TOML file."""

import re
from typing import Annotated, Literal, NamedTuple
from urllib.parse import urlsplit

import msgspec

from fltea.records.errors import UsageError
from fltea.settings.mqtt import MqttConfig
from fltea.settings.setting import Setting, Table

MOST_KEPT_MB = 100_000_000
DAY_S = 86400
NATS_PORT = 4222
"""Port of a NATS server whose address names none."""


def is_partitioned(url: str | None) -> bool:
    """Return whether several processes can share the devices of the source at a URL among themselves."""
    return url is not None and url.startswith("nats:")


# Why more than 12 attributes: each is one setting of the TOML file.
class IngestConfig(Table, frozen=True):
    """Settings for devices that publish their frames to a broker.

    The settings from `stream` on are for NATS only.
    """

    devices: Annotated[
        int, Setting("Largest number of devices at the same time.", unit="devices", least=1, most=100_000)
    ] = 2000
    forget_s: Annotated[
        float,
        Setting(
            "If a device is silent for this time, it makes room for another device.",
            unit="s",
            least=10,
            most=7 * DAY_S,
        ),
    ] = 600.0
    queue_mb: Annotated[
        float,
        Setting(
            "Memory for waiting messages of all devices together.",
            unit="MB",
            least=1,
            most=4096,
        ),
    ] = 64.0
    stream: Annotated[str, Setting("Name of the JetStream stream. If it is missing, it is created.")] = (
        "FLTEA_FRAMES"
    )
    bucket: Annotated[str, Setting("Name of the key-value bucket. If it is missing, it is created.")] = (
        "fltea_lanes"
    )
    partitions: Annotated[
        int,
        Setting(
            "Number of partitions in the server's subject mapping.", unit="partitions", least=1, most=1024
        ),
    ] = 16
    snapshot_s: Annotated[
        float,
        Setting(
            "Time between snapshots of a device; shorter than `keep_s`.",
            unit="s",
            least=1,
            most=365 * DAY_S,
        ),
    ] = 60.0
    keep_s: Annotated[
        float,
        Setting("How long the stream keeps frames.", unit="s", least=1, most=365 * DAY_S),
    ] = 3600.0
    keep_mb: Annotated[
        float,
        Setting(
            "Room for frames on the server, whose max_file_store has to be larger.",
            unit="MB",
            least=1,
            most=MOST_KEPT_MB,
        ),
    ] = 4000.0
    snapshots_mb: Annotated[
        float,
        Setting("Room for snapshots on the server.", unit="MB", least=1, most=MOST_KEPT_MB),
    ] = 1000.0
    replicas: Annotated[
        Literal[1, 3, 5],
        Setting("Number of replicas of the stream and of the buckets; 3 replicas need three nodes."),
    ] = 1
    change_limits: Annotated[
        bool,
        Setting(
            "If an existing stream or bucket has other limits, change them to these. Otherwise the "
            "differences are only reported."
        ),
    ] = False
    ca: Annotated[
        str | None,
        Setting(
            "PEM file of the authority that signed the server's certificate; switches TLS on.",
            text="the name of a file",
            example="ca.pem",
        ),
    ] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.snapshot_s < self.keep_s:
            raise ValueError(
                f"keep_s must be longer than snapshot_s, {self.snapshot_s:g} s, got {self.keep_s:g}"
            )
        for key in ("stream", "bucket"):
            if not re.fullmatch(r"[A-Za-z0-9_-]{1,64}", getattr(self, key)):
                raise ValueError(f"{key} must be a name of letters, digits, _ and -")


class Server(NamedTuple):
    """Address of a NATS server."""

    host: str
    port: int


def nats_servers(source: str) -> list[Server]:
    """Return the addresses in the URL of a source of NATS: nats://HOST[:PORT], several separated by commas.

    HOST may be an IPv6 address in brackets.

    Raises:
        UsageError: the URL is not such an address. The text leaves the URL out, which may contain a password.
    """
    found = [_server(url) for url in source.split(",")]
    servers = [server for server in found if server is not None]
    if len(servers) < len(found):
        raise UsageError(
            "--source nats: give nats://HOST[:PORT], PORT 1 to 65535, or several of these, separated by "
            "commas. User and password come from FLTEA_NATS_USER and FLTEA_NATS_PASSWORD."
        )
    return servers


def _server(url: str) -> Server | None:
    if not re.fullmatch(r"nats://[^@/?#,\s]+", url):
        return None
    try:
        parts = urlsplit(url)
        port = NATS_PORT if parts.port is None else parts.port
    # ValueError is raised if the port is no number or too large, or a bracket is not closed
    except ValueError:
        return None
    if not parts.hostname or parts.netloc.endswith(":") or port == 0:
        return None
    return Server(parts.hostname, port)


def broker_at(source: str, settings: MqttConfig) -> MqttConfig:
    """Return the settings of MQTT with the broker that the URL of a source names.

    Raises:
        UsageError: the URL is not the address of a broker. The text leaves the URL out, which may contain a
            password.
    """
    if "://" not in source:
        raise UsageError(
            "--source mqtt: give the broker's address: mqtt://HOST[:PORT] or mqtts://HOST[:PORT]."
        )
    try:
        return msgspec.structs.replace(settings, broker=source)
    except ValueError as error:
        raise UsageError(f"--source: {str(error).replace('broker', 'an mqtt source', 1)}.") from error
