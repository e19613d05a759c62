"""Run Debian's MQTT broker mosquitto with certificates, and a client that records its messages.

Each broker of a test uses a TCP port of its own.
"""

import contextlib
import json
import os
import subprocess
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from fltea.records.records import Hello, Sample
from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from tests.rig.host_support import PATIENCE_S, wait_until
from tests.rig.mqtt_support import Driven
from tests.rig.toolchain import needed
from tools.faults.server import Server, free_port

WATCHER, DAEMON, STRANGER = ("watcher", "w-secret"), ("fltea", "hunter2:with colon"), ("stranger", "s-secret")
ACL = "user watcher\ntopic read #\nuser fltea\ntopic readwrite fltea/#\n"


def openssl(*arguments: str | Path) -> None:
    subprocess.run([needed("openssl"), *arguments], check=True, capture_output=True, timeout=PATIENCE_S)


def make_authority(folder: Path) -> Path:
    """Make a certificate authority and a certificate for localhost.

    Return the path of the authority's certificate.
    """
    folder.mkdir()
    key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    ca, ca_key = folder / "ca.pem", folder / "ca.key"
    openssl("req", "-x509", *key, "-keyout", ca_key, "-out", ca, "-subj", f"/CN={folder.name}", "-days", "2")
    for name in ("server", "client"):
        request, extensions = folder / f"{name}.csr", folder / f"{name}.ext"
        openssl(
            "req", "-new", *key, "-keyout", folder / f"{name}.key", "-out", request, "-subj", f"/CN={name}"
        )
        extensions.write_text("subjectAltName=DNS:localhost\n")
        sign = ["-req", "-in", request, "-CA", ca, "-CAkey", ca_key, "-CAcreateserial", "-days", "2"]
        openssl("x509", *sign, "-extfile", extensions, "-out", folder / f"{name}.pem")
    return ca


class Mosquitto(Server):
    """A broker that can stop and come back on the same port with its retained messages.

    `authority`: folder that `make_authority` filled; if it is given, the broker uses TLS. `secure`: use a
    password file and an access list. `usual_limits`: keep mosquitto's default limits, which drop messages for
    slow subscribers.
    """

    def __init__(
        self,
        folder: Path,
        *,
        authority: Path | None = None,
        secure: bool = False,
        client_certificates: bool = False,
        usual_limits: bool = False,
    ) -> None:
        folder.mkdir()
        port = free_port()
        lines = [
            f"listener {port} 127.0.0.1",
            "persistence true",
            f"persistence_location {folder}/",
            f"allow_anonymous {'false' if secure else 'true'}",
        ]
        if not usual_limits:
            lines += ["queue_qos0_messages true", "max_queued_messages 0"]
        if os.geteuid() == 0:
            lines.append("user root")
        if authority is not None:
            lines += [f"certfile {authority}/server.pem", f"keyfile {authority}/server.key"]
            if client_certificates:
                lines += [f"cafile {authority}/ca.pem", "require_certificate true"]
        if secure:
            passwords, access = folder / "passwords", folder / "acl"
            passwords.touch(mode=0o600)
            for user, password in (WATCHER, DAEMON, STRANGER):
                command = [needed("mosquitto_passwd", "mosquitto"), "-b", passwords, user, password]
                subprocess.run(command, check=True, capture_output=True)
            access.write_text(ACL)
            access.chmod(0o600)
            lines += [f"password_file {passwords}", f"acl_file {access}"]
        settings = folder / "mosquitto.conf"
        settings.write_text("\n".join(lines) + "\n")
        super().__init__([needed("mosquitto"), "-c", settings], [port], folder / "log")


class Heard(NamedTuple):
    topic: str
    payload: bytes
    qos: int
    retained: bool


class Watcher:
    """A client that records all messages on topics below `fltea/`.

    The client's session survives restarts of the broker.
    """

    def __init__(self, port: int, ca: Path | None = None, login: tuple[str, str] | None = None) -> None:
        self.heard: list[Heard] = []
        self._subscribed = threading.Event()
        self._client = client = Client(
            CallbackAPIVersion.VERSION2, f"watcher-{os.urandom(4).hex()}", protocol=MQTTProtocolVersion.MQTTv5
        )
        client.on_connect = self._on_connect
        client.on_message = self._on_message
        client.on_subscribe = lambda *_: self._subscribed.set()
        client.reconnect_delay_set(0.1, 0.1)
        if login is not None:
            client.username_pw_set(*login)
        if ca is not None:
            client.tls_set(str(ca))
        session = Properties(PacketTypes.CONNECT)
        session.SessionExpiryInterval = 600
        client.connect_async("localhost", port, clean_start=False, properties=session)
        client.loop_start()
        assert self._subscribed.wait(PATIENCE_S)

    def _on_connect(self, client: Client, userdata: Any, flags: Any, reason: Any, properties: Any) -> None:
        if not flags.session_present:
            client.subscribe("fltea/#", qos=1)

    def _on_message(self, client: Client, userdata: Any, message: MQTTMessage) -> None:
        self.heard.append(Heard(message.topic, bytes(message.payload), message.qos, message.retain))

    def on(self, topic: str) -> list[Heard]:
        return [one for one in list(self.heard) if one.topic == topic]

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()


HELLO = Hello(source="test:", host_ns=0, rate_hz=100.0, sampling_mode="timer", device_id="a0", device="due")


def sample(seq: int) -> Sample:
    return Sample(seq, 1, seq * 10_000, seq, (0.5, -0.25, 0.0), device="due")


def last_status(watcher: Watcher, topic: str = "fltea/a0/status") -> Any:
    heard = watcher.on(topic)
    return json.loads(heard[-1].payload)["status"] if heard else None


class Connected(Driven):
    """An MQTT sink that publishes to a real broker."""

    def __init__(self, port: int, **settings: Any) -> None:
        tls = "mqtts" if settings.get("ca") else "mqtt"
        super().__init__(f"{tls}://localhost:{port}", sample_every=1, **settings)

    def until(self, condition: Callable[[], bool], what: str) -> None:
        def met() -> bool:
            self.sink.flush()
            return condition()

        wait_until(met, what)

    def kinds(self) -> list[str]:
        return [kind for kind, _ in self.told]

    def until_told(self, kind: str) -> str:
        self.until(lambda: kind in self.kinds(), kind)
        return dict(self.told)[kind]


class Stage(contextlib.ExitStack):
    """Starts brokers, watchers and sinks, and stops them all after the test."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._folder = folder
        self._brokers = 0

    def broker(self, **settings: Any) -> Mosquitto:
        self._brokers += 1
        one = Mosquitto(self._folder / f"broker{self._brokers}", **settings)
        self.callback(one.kill)
        return one

    def client(self, port: int, name: str = "", **settings: Any) -> Client:
        """Return a connected client.

        `settings`: `version`, `login` and `ca` configure the connection. Each other setting is a function
        that handles an event.
        """
        version = settings.pop("version", MQTTProtocolVersion.MQTTv5)
        client = Client(CallbackAPIVersion.VERSION2, name, protocol=version)
        if (login := settings.pop("login", None)) is not None:
            client.username_pw_set(*login)
        if (ca := settings.pop("ca", None)) is not None:
            client.tls_set(str(ca))
        for event, action in settings.items():
            setattr(client, event, action)
        client.reconnect_delay_set(1, 1)
        client.connect("localhost", port)
        client.loop_start()
        self.callback(client.loop_stop)
        self.callback(client.disconnect)
        return client

    def watcher(self, *arguments: Any) -> Watcher:
        one = Watcher(*arguments)
        self.callback(one.close)
        return one

    def drive(self, port: int, **settings: Any) -> Connected:
        one = Connected(port, **settings)
        self.callback(one.sink.close)
        return one
