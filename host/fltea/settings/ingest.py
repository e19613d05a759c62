"""Settings of sources that many devices share, the table `ingest` of the TOML file."""

import re

import msgspec

SCHEMES = ("mqtt", "mqtts", "nats")
"""Beginnings of the URLs of sources behind which many devices stand."""

MOST_DEVICES = 100_000
MOST_KEPT_MB = 100_000_000


def is_shared(url: str | None) -> bool:
    """Whether many devices stand behind this source."""
    return url is not None and url.partition(":")[0] in SCHEMES


def is_partitioned(url: str | None) -> bool:
    """Whether several processes share the devices behind this source."""
    return url is not None and url.startswith("nats:")


class IngestConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Devices that publish their frames to a broker.

    devices: at most so many at a time. forget_s: a device that has been silent for so long is given up, and
    makes room for another. queue_mb: what may wait to be read, of all devices together.

    Of NATS: stream, bucket: names of the JetStream stream and of the key-value bucket, which are made where
    they are missing. partitions: as many as the server's subject mapping has. snapshot_s: from one snapshot
    of a device to the next. keep_s: how long a stream that is made here keeps frames. keep_mb, snapshots_mb:
    most that frames and snapshots may have on the server, whose max_file_store has to be larger. replicas: of
    all, when they are made. change_limits: stream and buckets that exist get these limits; else what differs
    is told. ca: PEM file of the authority that signed the server's certificate; with it TLS is spoken.
    """

    devices: int = 2000
    forget_s: float = 600.0
    queue_mb: float = 64.0
    stream: str = "FLTEA_FRAMES"
    bucket: str = "fltea_lanes"
    partitions: int = 16
    snapshot_s: float = 60.0
    keep_s: float = 3600.0
    keep_mb: float = 4000.0
    snapshots_mb: float = 1000.0
    replicas: int = 1
    change_limits: bool = False
    ca: str | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.devices <= MOST_DEVICES:
            raise ValueError(f"devices must be 1 to {MOST_DEVICES}, got {self.devices}")
        if not 10 <= self.forget_s <= 7 * 86400:
            raise ValueError("forget_s must be 10 seconds to a week")
        if not 1 <= self.partitions <= 1024:
            raise ValueError(f"partitions must be 1 to 1024, got {self.partitions}")
        if self.replicas not in (1, 3, 5):
            raise ValueError(f"replicas must be 1, 3 or 5, got {self.replicas}")
        if not 1 <= self.snapshot_s < self.keep_s <= 365 * 86400:
            raise ValueError("snapshot_s must be 1 s or more, and keep_s, at most a year, must be longer")
        for key in ("keep_mb", "snapshots_mb"):
            if not 1 <= getattr(self, key) <= MOST_KEPT_MB:
                raise ValueError(f"{key} must be 1 to {MOST_KEPT_MB} MB")
        for key in ("stream", "bucket"):
            if not re.fullmatch(r"[A-Za-z0-9_-]{1,64}", getattr(self, key)):
                raise ValueError(f"{key} must be a name of letters, digits, _ and -")
        if not 1 <= self.queue_mb <= 4096:
            raise ValueError("queue_mb must be 1 to 4096 MB")
