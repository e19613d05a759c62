"""Settings of sources that many devices share, the table `ingest` of the TOML file."""

import msgspec

SCHEMES = ("mqtt", "mqtts")
"""Beginnings of the URLs of sources behind which many devices stand."""

MOST_DEVICES = 100_000


def is_shared(url: str | None) -> bool:
    """Whether many devices stand behind this source."""
    return url is not None and url.partition(":")[0] in SCHEMES


class IngestConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Devices that publish their frames to a broker.

    devices: at most so many at a time. forget_s: a device that has been silent for so long is given up, and
    makes room for another. queue_mb: what may wait to be read, of all devices together.
    """

    devices: int = 2000
    forget_s: float = 600.0
    queue_mb: float = 64.0

    def __post_init__(self) -> None:
        if not 1 <= self.devices <= MOST_DEVICES:
            raise ValueError(f"devices must be 1 to {MOST_DEVICES}, got {self.devices}")
        if not 10 <= self.forget_s <= 7 * 86400:
            raise ValueError("forget_s must be 10 seconds to a week")
        if not 1 <= self.queue_mb <= 4096:
            raise ValueError("queue_mb must be 1 to 4096 MB")
