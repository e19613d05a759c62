"""MQTT against the real mosquitto: who is let in, and who is told why not."""

from pathlib import Path

import pytest
from fltea.records.records import Gap
from fltea.settings.outputs import MqttConfig
from fltea.sinks.mqtt.sink import MqttSink
from mosquitto_support import DAEMON, HELLO, STRANGER, Stage, last_status, make_authority
from support import wait_until

pytestmark = [  # the library leaves the socket of a handshake that failed to the garbage collector
    pytest.mark.filterwarnings("ignore:.*unclosed <ssl.SSLSocket:ResourceWarning"),
    pytest.mark.filterwarnings("ignore:.*<ssl.SSLSocket:pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture(scope="module")
def authorities(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("authorities")
    make_authority(folder / "ours")
    make_authority(folder / "others")
    return folder


def log_in(monkeypatch: pytest.MonkeyPatch, login: tuple[str, str]) -> None:
    monkeypatch.setenv("FLTEA_MQTT_USER", login[0])
    monkeypatch.setenv("FLTEA_MQTT_PASSWORD", login[1])


def test_wrong_password_is_told_and_never_shown(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    broker = stage.broker(secure=True)
    log_in(monkeypatch, (DAEMON[0], "a wrong one"))
    driven = stage.drive(broker.port)
    driven.write(HELLO)
    text = driven.until_told("broker_refused")
    assert "FLTEA_MQTT_PASSWORD" in text
    assert "a wrong one" not in text
    assert driven.kinds() == ["broker_refused"]


def test_broker_that_wants_a_password_says_so(stage: Stage) -> None:
    driven = stage.drive(stage.broker(secure=True).port)
    driven.write(HELLO)
    assert "wants a user and a password" in driven.until_told("broker_refused")


def test_topic_that_the_access_list_forbids_is_told_once(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    broker = stage.broker(secure=True)
    log_in(monkeypatch, STRANGER)
    driven = stage.drive(broker.port)
    driven.write(HELLO, Gap(0, 1, 1, 0, device="due"), Gap(1, 1, 1, 0, device="due"))
    text = driven.until_told("broker_refused")
    assert "access list" in text
    assert "fltea/a0/#" in text
    driven.until(lambda: driven.sink.lost == 2, "the end of both")  # mosquitto 2.0.11 hangs up after each
    assert driven.kinds().count("broker_refused") == 1


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1"])
def test_certificate_of_another_authority_or_name_is_refused(
    stage: Stage, authorities: Path, host: str
) -> None:
    broker = stage.broker(authority=authorities / "ours")
    ca = authorities / ("others" if host == "localhost" else "ours") / "ca.pem"
    told: list[tuple[str, str]] = []
    settings = MqttConfig(broker=f"mqtts://{host}:{broker.port}", ca=str(ca))
    sink = MqttSink(settings, "due", lambda kind, text: told.append((kind, text)))
    sink.write(HELLO)

    def is_told() -> bool:
        sink.flush()
        return bool(told)

    wait_until(is_told, "the refusal")
    sink.close()
    assert [kind for kind, _ in told] == ["broker_certificate"]
    assert ("mismatch" in told[0][1]) == (host == "127.0.0.1")
    assert "mqtt.ca" in told[0][1]


def test_insecure_takes_any_certificate(stage: Stage, authorities: Path) -> None:
    broker = stage.broker(authority=authorities / "ours")
    driven = stage.drive(broker.port, ca=str(authorities / "others/ca.pem"), insecure=True)
    driven.write(HELLO)
    watcher = stage.watcher(broker.port, authorities / "ours/ca.pem")
    driven.until(lambda: last_status(watcher) == "stalled", "the status")
    assert driven.told == []


def test_broker_that_wants_a_certificate_gets_one_or_is_named(stage: Stage, authorities: Path) -> None:
    ours = authorities / "ours"
    broker = stage.broker(authority=ours, client_certificates=True)
    without = stage.drive(broker.port, ca=str(ours / "ca.pem"))
    without.write(HELLO)
    without.until(lambda: bool(without.told), "the refusal")
    assert "mqtt.cert" in without.told[0][1]
    files = {"ca": ours / "ca.pem", "cert": ours / "client.pem", "key": ours / "client.key"}
    with_one = stage.drive(broker.port, **{name: str(file) for name, file in files.items()})
    with_one.write(HELLO)
    with_one.until(lambda: with_one.sink._link.up, "the broker")
    assert with_one.told == []


def test_plain_words_to_a_port_that_speaks_tls_and_the_reverse(stage: Stage, authorities: Path) -> None:
    broker = stage.broker(authority=authorities / "ours")
    plain = stage.drive(broker.port)
    plain.write(HELLO)
    assert "mqtts://" in plain.until_told("broker_lost")
    wrapped = stage.drive(stage.broker().port, ca=str(authorities / "ours/ca.pem"))
    wrapped.write(HELLO)
    wrapped.until(lambda: bool(wrapped.told), "the failure")
    assert "TLS" in wrapped.told[0][1]
