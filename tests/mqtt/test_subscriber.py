"""Tests of the receiving side of the MQTT client, with a simulated broker."""

import socket
import threading
from collections.abc import Iterator, Sequence

import pytest
from fltea.mqtt.connection import Receiver, Subscription
from fltea.mqtt.subscriber import Subscriber
from fltea.settings.mqtt import MqttConfig

from tests.rig.host_support import PATIENCE_S, wait_until

CONNACK = b"\x20\x03\x00\x00\x00"
CONNECT, SUBSCRIBE = 0x10, 0x82
GRANTED, NOT_AUTHORIZED = 1, 0x87


class FakeBroker:
    """A broker that accepts each connection, and answers each subscription with the same reason codes.

    `sends`: packets that the broker sends after each answer to a subscription.
    """

    def __init__(self, reasons: Sequence[int], sends: bytes = b"") -> None:
        self._reasons, self._sends = bytes(reasons), sends
        self.connections = 0
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = self._server.getsockname()[1]
        self._threads = [threading.Thread(target=self._accept, daemon=True)]
        self._threads[0].start()

    def _accept(self) -> None:
        while True:
            try:
                peer, _ = self._server.accept()
            except OSError:
                return
            self.connections += 1
            self._threads.append(threading.Thread(target=self._serve, args=(peer,), daemon=True))
            self._threads[-1].start()

    def _serve(self, peer: socket.socket) -> None:
        with peer, peer.makefile("rb") as packets:
            while kind := packets.read(1):
                # packets in these tests are so short that the length in their header takes one byte
                body = packets.read(packets.read(1)[0])
                if kind[0] == CONNECT:
                    peer.sendall(CONNACK)
                elif kind[0] == SUBSCRIBE:
                    answer = body[:2] + b"\x00" + self._reasons
                    peer.sendall(bytes([0x90, len(answer)]) + answer + self._sends)

    def close(self) -> None:
        self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()
        for thread in self._threads:
            thread.join(PATIENCE_S)


class Scene:
    """A subscriber of two topics, with everything that it has reported and received."""

    def __init__(self, broker: FakeBroker) -> None:
        self.broker = broker
        self.told: list[tuple[str, str]] = []
        self.received: list[tuple[str, bytes, bool]] = []
        self.returns = 0
        receiver = Receiver(
            [Subscription("a/+/x"), Subscription("a/+/y", retained=False)],
            lambda *message: self.received.append(message),
        )
        self.subscriber = Subscriber(
            MqttConfig(broker=f"mqtt://127.0.0.1:{broker.port}"),
            "test",
            receiver,
            lambda kind, text: self.told.append((kind, text)),
            self._on_back,
            longest_wait_s=0.1,
        )
        self.subscriber.start()

    def _on_back(self) -> None:
        self.returns += 1

    def close(self) -> None:
        self.subscriber.close()
        self.broker.close()


@pytest.fixture
def scenes(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Scene]]:
    for name in ("FLTEA_MQTT_USER", "FLTEA_MQTT_PASSWORD"):
        monkeypatch.delenv(name, raising=False)
    made: list[Scene] = []
    yield made
    for scene in made:
        scene.close()


def test_a_broker_that_refuses_all_topics_is_reported_once_and_tried_again(scenes: list[Scene]) -> None:
    scenes.append(scene := Scene(FakeBroker([NOT_AUTHORIZED, NOT_AUTHORIZED])))
    wait_until(lambda: scene.broker.connections >= 3, "further attempts")
    ((kind, text),) = scene.told
    assert kind == "broker_refused"
    assert "a/+/x (Not authorized), a/+/y (Not authorized)" in text
    assert not scene.subscriber.is_up.is_set()
    assert (scene.subscriber.connections, scene.returns) == (0, 0)


def test_a_broker_that_refuses_one_topic_is_reported_and_the_other_is_received(scenes: list[Scene]) -> None:
    message = b"\x30\x08\x00\x05a/1/y\x00"
    scenes.append(scene := Scene(FakeBroker([NOT_AUTHORIZED, GRANTED], message)))
    wait_until(lambda: bool(scene.received and scene.told), "the message and the report")
    ((kind, text),) = scene.told
    assert kind == "broker_refused"
    assert "a/+/x (Not authorized)" in text
    assert "a/+/y" not in text
    assert scene.received == [("a/1/y", b"", False)]
    assert scene.subscriber.is_up.is_set()


def test_a_topic_that_is_not_utf8_is_received_as_none_and_the_connection_stays(scenes: list[Scene]) -> None:
    odd, plain = b"\x30\x08\x00\x05a/\xff/x\x00", b"\x31\x09\x00\x05a/1/x\x007"
    scenes.append(scene := Scene(FakeBroker([GRANTED, GRANTED], odd + plain)))
    wait_until(lambda: len(scene.received) == 2 and scene.subscriber.is_up.is_set(), "both messages")
    assert scene.received == [("", b"", False), ("a/1/x", b"7", True)]
    assert (scene.subscriber.connections, scene.subscriber.outages, scene.told) == (1, 0, [])
