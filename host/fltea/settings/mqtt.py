"""Settings of the output to an MQTT broker."""

from typing import Annotated, Literal, NamedTuple
from urllib.parse import SplitResult, urlsplit

from fltea.records.secret import refuse_secret
from fltea.settings.setting import Setting, Table


class BrokerAddress(NamedTuple):
    """Address of an MQTT broker."""

    host: str
    port: int
    tls: bool

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'mqtts' if self.tls else 'mqtt'}://{host}:{self.port}"


class MqttConfig(Table, frozen=True):
    """Settings for publishing to an MQTT broker, which is off unless `broker` is set."""

    broker: Annotated[
        str | None,
        Setting(
            "MQTT broker to publish to: HOST[:PORT], or mqtts://HOST[:PORT] for TLS; user and password "
            "from FLTEA_MQTT_USER and FLTEA_MQTT_PASSWORD.",
            text="HOST, HOST:PORT, mqtt://HOST:PORT or mqtts://HOST:PORT",
            flags=("--mqtt",),
            metavar="BROKER",
            example="mqtts://broker.example",
        ),
    ] = None
    prefix: Annotated[str, Setting("Beginning of all topics.", text="a topic")] = "fltea"
    discovery: Annotated[
        str | None,
        Setting(
            "Prefix under which Home Assistant looks for devices; each board then appears automatically.",
            text="a topic",
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
    sample_every: Annotated[
        int,
        Setting(
            "Publish every N-th sample (`seq` a multiple of N), as for estimates; 0: no samples.",
            unit="samples",
            least=0,
        ),
    ] = 0
    stream_qos: Annotated[
        Literal[0, 1],
        Setting("Quality of service of estimates and samples; all other messages have 1."),
    ] = 0
    tls: Annotated[bool, Setting("Use TLS, as with mqtts://.")] = False
    ca: Annotated[
        str | None,
        Setting(
            "PEM file of the authority that signed the broker's certificate.",
            text="the name of a file",
            example="ca.pem",
        ),
    ] = None
    cert: Annotated[
        str | None,
        Setting("PEM file of this client's certificate.", text="the name of a file", example="client.pem"),
    ] = None
    key: Annotated[
        str | None,
        Setting("PEM file of the certificate's key.", text="the name of a file", example="client.key"),
    ] = None
    insecure: Annotated[bool, Setting("Accept any certificate of the broker.")] = False
    password_file: Annotated[
        str | None,
        Setting("File with one line USER:PASSWORD.", text="the name of a file", example="/etc/fltea/mqtt"),
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
            raise ValueError(f"{tls_only[0]} has an effect only with TLS: write mqtts://, or tls = true")
        if self.broker is not None:
            self.address()

    def address(self) -> BrokerAddress:
        """Return the broker's host, its port, and whether TLS is used.

        Raises:
            ValueError: `broker` is no address; the error's text does not repeat it.
            UsageError: the address holds a password.
        """
        assert self.broker is not None
        refuse_secret("mqtt.broker", self.broker, "mqtt")
        try:
            url = urlsplit(self.broker if "://" in self.broker else f"mqtt://{self.broker}")
            tls = self.tls or url.scheme == "mqtts"
            host = url.hostname or ""
            host.encode("idna")
        except ValueError:  # also UnicodeError, a subclass of ValueError
            host = ""
        if not host or url.scheme not in ("mqtt", "mqtts") or url.path.strip("/") or url.query:
            raise ValueError("broker must be HOST, HOST:PORT, mqtt://HOST:PORT or mqtts://HOST:PORT")
        return BrokerAddress(host, _port_of(url, 8883 if tls else 1883), tls)


def _port_of(url: SplitResult, default: int) -> int:
    """Return the port in a broker's address, or `default` if the address has none.

    Raises:
        ValueError: the port is no port. The error's text does not repeat it.
    """
    try:
        port = default if url.port is None else url.port
    except ValueError:  # the port is no number, or is too large
        port = 0
    if not port:
        raise ValueError("broker must have a PORT from 1 to 65535, as in mqtt://HOST:1883")
    return port
