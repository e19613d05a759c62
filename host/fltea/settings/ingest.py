"""Settings of shared sources, through which many devices send: the table `ingest` of the TOML file."""

import re
from typing import Annotated, Literal

from fltea.settings.setting import Setting, Table

SCHEMES = ("mqtt", "mqtts", "nats")
"""URL schemes of shared sources. Many devices send through one shared source."""

MOST_KEPT_MB = 100_000_000
DAY_S = 86400


def is_shared(url: str | None) -> bool:
    """Return whether the source at a URL is shared, so that many devices send through this source."""
    return url is not None and url.partition(":")[0] in SCHEMES


def is_partitioned(url: str | None) -> bool:
    """Return whether several processes can share the devices of the source at a URL among themselves."""
    return url is not None and url.startswith("nats:")


# Over 12 attributes: permitted, since each is one setting of the TOML file.
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
