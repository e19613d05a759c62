"""Settings of the outputs, each with the name of its table in the TOML file (host/docs/guide/outputs.md)."""

import math
from typing import NamedTuple
from urllib.parse import urlsplit

import msgspec

from fltea.settings.listen_address import is_loopback, listen_address

LARGEST_EVERY = 1_000_000
"""Nearly three hours at 100 Hz."""

RECORDED = (
    *("hello", "epoch", "gap", "sample", "estimate", "device_estimate", "fit", "device_fit", "stats"),
    "error",
)
"""Classes of the records that can ride along in a recording."""


class OutputConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What holds for every output alike.

    every: records `sample`, `estimate` and `device_estimate` go out of samples whose `seq` is a multiple of
    it; all else does whole, and so do the bytes that `--record` keeps. Estimation sees every sample.
    """

    every: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.every <= LARGEST_EVERY:
            raise ValueError(f"every must be 1 (every sample) to {LARGEST_EVERY}, got {self.every}")


class RecordConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Recording in MCAP files; off without a folder.

    folder: where the files go. rotate_mb, rotate_s: a new file begins beyond this size or age. resume_mb:
    room there has to be before a recording that a full disk stopped goes on. channels: decoded records that
    ride along with the bytes from the wire.
    """

    folder: str | None = None
    rotate_mb: float = 256.0
    rotate_s: float = 3600.0
    resume_mb: float = 16.0
    channels: tuple[str, ...] = RECORDED

    def __post_init__(self) -> None:
        if self.folder == "":
            raise ValueError("folder must be the name of a folder")
        if not (self.rotate_mb > 0 and self.rotate_s > 0):
            raise ValueError("rotate_mb and rotate_s must be positive")
        if not 0 <= self.resume_mb < math.inf:
            raise ValueError("resume_mb must be 0 MB or more")
        for channel in self.channels:
            if channel not in RECORDED:
                raise ValueError(f"channels: there is no {channel}; there are {', '.join(RECORDED)}")


class BrokerAddress(NamedTuple):
    """Where an MQTT broker listens."""

    host: str
    port: int
    tls: bool

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'mqtts' if self.tls else 'mqtt'}://{host}:{self.port}"


class MqttConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Publishing to an MQTT broker; off without one.

    broker: HOST, HOST:PORT, mqtt://HOST:PORT or mqtts://HOST:PORT. prefix: of all topics.
    estimate_every, sample_every: one in so many samples is published, by `seq`, of those that `output.every`
    leaves: the larger of the two rules; sample_every 0: none. stream_qos: of estimates and samples, 0 or 1;
    all else has 1. tls: as with mqtts://. ca, cert, key: PEM files. insecure: take whatever certificate the
    broker shows. password_file: one line USER:PASSWORD.
    """

    broker: str | None = None
    prefix: str = "fltea"
    estimate_every: int = 10
    sample_every: int = 0
    stream_qos: int = 0
    tls: bool = False
    ca: str | None = None
    cert: str | None = None
    key: str | None = None
    insecure: bool = False
    password_file: str | None = None

    def __post_init__(self) -> None:
        for level in self.prefix.split("/"):
            if not level or any(c in "+#" or ord(c) < 32 for c in level) or self.prefix.startswith("$"):
                raise ValueError("prefix must be a topic without +, #, a leading $ or empty levels")
        if self.estimate_every < 1 or self.sample_every < 0:
            raise ValueError("estimate_every must be 1 or more, sample_every 0 (none) or more")
        if self.stream_qos not in (0, 1):
            raise ValueError("stream_qos must be 0 or 1")
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
            ValueError: it is none; the text does not repeat it, since a password may be in it.
        """
        assert self.broker is not None
        if "@" in self.broker:
            raise ValueError(
                "broker must not hold a user or a password, since others can read command lines and files; "
                "they belong into the environment (FLTEA_MQTT_USER, FLTEA_MQTT_PASSWORD) or into a file "
                "(mqtt.password_file)"
            )
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


class DashboardConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The live page; off without an address. address: PORT or HOST:PORT; without a host the loopback.

    names: further names under which browsers may ask for it, such as that of a proxy in front. visitors:
    pages that may be open at a time. record: whether they may start and stop recordings; None: if none but
    this machine reaches them. record_to: the folder, unless `record.folder` names one.
    """

    address: str | int | None = None
    names: tuple[str, ...] = ()
    visitors: int = 20
    record: bool | None = None
    record_to: str = "recordings"

    def __post_init__(self) -> None:
        if self.visitors < 1:
            raise ValueError("visitors must be 1 or more")
        if not self.record_to:
            raise ValueError("record_to must be the name of a folder")
        if self.address is not None:
            self.listen()

    def listen(self) -> tuple[str, int]:
        """Host and port; raises ValueError if there can be no such address."""
        return listen_address(str(self.address))

    @property
    def may_record(self) -> bool:
        """Whether pages may start and stop recordings."""
        return is_loopback(self.listen()[0]) and not self.names if self.record is None else self.record


class MetricsConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Metrics for Prometheus; off without an address. address, names: as those of the page."""

    address: str | int | None = None
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.address is not None:
            listen_address(str(self.address))


class StateConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Snapshots of the estimators, with which a restarted daemon goes on; off without a file.

    file: where the snapshot is kept. max_age_s: an older snapshot is not used. period_s: how often one is
    written, beside the one at the end.
    """

    file: str | None = None
    max_age_s: float = 3600.0
    period_s: float = 60.0

    def __post_init__(self) -> None:
        if self.file == "":
            raise ValueError("file must be the name of a file")
        if not (self.max_age_s > 0 and self.period_s > 0):
            raise ValueError("max_age_s and period_s must be positive numbers of seconds")
