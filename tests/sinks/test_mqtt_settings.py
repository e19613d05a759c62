"""Tests of the settings for MQTT, passwords included. Every mistake is named, and no error message repeats a
password.
"""

import ssl
from pathlib import Path

import pytest
from fltea.mqtt.broker import Broker
from fltea.records.errors import UsageError
from fltea.settings.config import load_config
from fltea.settings.ingest import broker_at
from fltea.settings.mqtt import MqttConfig
from fltea.sinks.mqtt.sink import MqttSink
from hypothesis import given
from hypothesis import strategies as st


@pytest.fixture(autouse=True)
def no_login(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("FLTEA_MQTT_USER", "FLTEA_MQTT_PASSWORD"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.parametrize(
    ("broker", "tls", "expected"),
    [
        ("pi", False, "mqtt://pi:1883"),
        ("pi:1884", False, "mqtt://pi:1884"),
        ("mqtt://pi", False, "mqtt://pi:1883"),
        ("mqtts://pi", False, "mqtts://pi:8883"),
        ("pi", True, "mqtts://pi:8883"),
        ("mqtts://pi:1883/", False, "mqtts://pi:1883"),
        ("192.168.1.4", False, "mqtt://192.168.1.4:1883"),
        ("MQTTS://pi", False, "mqtts://pi:8883"),
        ("[::1]:1884", False, "mqtt://[::1]:1884"),
    ],
)
def test_address(broker: str, tls: bool, expected: str) -> None:
    assert str(MqttConfig(broker=broker, tls=tls).address()) == expected


@pytest.mark.parametrize(
    "broker",
    ["", ":1883", "http://pi", "pi/topic", "pi?x=1", "[::1", "a..b"],
)
def test_no_address(broker: str) -> None:
    with pytest.raises(UsageError, match=r"mqtt\.broker must be HOST, HOST:PORT"):
        load_config(None, {"mqtt.broker": broker})


@pytest.mark.parametrize("broker", ["pi:x", "pi:0", "pi:70000", "mqtt://pi:x"])
def test_no_port(broker: str) -> None:
    with pytest.raises(UsageError, match=r"mqtt\.broker must have a PORT from 1 to 65535"):
        load_config(None, {"mqtt.broker": broker})
    with pytest.raises(UsageError, match="--source: an mqtt source must have a PORT"):
        broker_at("mqtt://" + broker.removeprefix("mqtt://"), MqttConfig())


WORD = st.text(st.characters(codec="ascii", categories=("L", "N", "P")), min_size=8)


@given(
    WORD, st.sampled_from(["{0}@pi", "u:{0}@pi:1883", "mqtt://u:{0}@pi", "mqtts://:{0}@pi", "mqtt://pi@{0}"])
)
def test_password_in_the_address_is_refused_and_not_repeated(password: str, form: str) -> None:
    said = []
    for secret_word in (password, "correct horse"):
        with pytest.raises(UsageError, match="FLTEA_MQTT_PASSWORD") as refused:
            load_config(None, {"mqtt.broker": form.format(secret_word)})
        said.append(str(refused.value))
    # the messages for two passwords are compared, since a single password may equal a word of the message
    assert said[0] == said[1]


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"prefix": "a/+"}, "prefix must be a topic"),
        ({"prefix": ""}, "prefix must be a topic"),
        ({"prefix": "/a"}, "prefix must be a topic"),
        ({"prefix": "$SYS"}, "prefix must be a topic"),
        ({"ca": "ca.pem"}, "ca has an effect only with TLS"),
        ({"insecure": True}, "insecure has an effect only with TLS"),
        ({"tls": True, "key": "k.pem"}, "give cert too"),
        ({"password": "x"}, "mqtt.password: there is no such setting"),
    ],
)
def test_wrong_settings_are_named(settings: dict[str, object], words: str) -> None:
    overrides = {f"mqtt.{name}": value for name, value in {"broker": "pi", **settings}.items()}
    with pytest.raises(UsageError, match=words):
        load_config(None, overrides)


# --- user and password ---


def secret(folder: Path, text: str, mode: int = 0o600) -> str:
    file = folder / "secret"
    file.write_bytes(text.encode(errors="surrogateescape"))
    file.chmod(mode)
    return str(file)


def test_login_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    assert (Broker(MqttConfig(broker="pi")).user, Broker(MqttConfig(broker="pi")).password) == (None, None)
    monkeypatch.setenv("FLTEA_MQTT_USER", "me")
    monkeypatch.setenv("FLTEA_MQTT_PASSWORD", "hunter2")
    broker = Broker(MqttConfig(broker="pi"))
    assert (broker.user, broker.password) == ("me", "hunter2")
    assert "hunter2" not in repr(broker) + str(MqttConfig(broker="pi"))


def test_login_from_a_file_goes_before_the_environment(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("FLTEA_MQTT_USER", "other")
    for mark in ("", "\ufeff"):  # some Windows editors begin a file with this byte order mark
        file = secret(tmp_path, f"{mark}me:hunter2:with:colons\n", 0o640)
        broker = Broker(MqttConfig(broker="pi", password_file=file))
        assert (broker.user, broker.password) == ("me", "hunter2:with:colons")


@pytest.mark.parametrize(
    ("text", "mode", "words"),
    [
        *(
            (text, 0o600, "one line, USER:PASSWORD")
            for text in ("", "hunter2\n", "me:\n", ":hunter2\n", "a:b\nc\n")
        ),
        ("me:hunter2", 0o604, "chmod o= "),
        ("\udcff", 0o600, "not UTF-8"),
        (None, 0o600, "No such file"),
    ],
)
def test_file_without_a_login_is_refused_and_not_repeated(
    tmp_path: Path, text: str | None, mode: int, words: str
) -> None:
    file = str(tmp_path / "none") if text is None else secret(tmp_path, text, mode)
    with pytest.raises(UsageError, match=words) as refused:
        Broker(MqttConfig(broker="pi", password_file=file))
    assert "hunter2" not in str(refused.value)


def test_password_without_a_user(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FLTEA_MQTT_PASSWORD", "hunter2")
    with pytest.raises(UsageError, match="FLTEA_MQTT_USER is not") as refused:
        Broker(MqttConfig(broker="pi"))
    assert "hunter2" not in str(refused.value)


@pytest.mark.parametrize(
    ("broker", "password", "warned"),
    [("pi", True, True), ("pi", False, False), ("localhost", True, False), ("mqtts://pi", True, False)],
)
def test_password_in_clear_is_told(
    monkeypatch: pytest.MonkeyPatch, broker: str, password: bool, warned: bool
) -> None:
    if password:
        monkeypatch.setenv("FLTEA_MQTT_USER", "me")
        monkeypatch.setenv("FLTEA_MQTT_PASSWORD", "hunter2")
    told: list[tuple[str, str]] = []
    MqttSink(MqttConfig(broker=broker), "due", lambda kind, text: told.append((kind, text)))
    assert [kind for kind, _ in told] == ["broker_plain"] * warned
    assert "hunter2" not in str(told)


# --- certificates ---


@pytest.mark.parametrize("name", ["ca", "cert"])
def test_certificates_that_are_none(tmp_path: Path, name: str) -> None:
    file = tmp_path / "x.pem"
    with pytest.raises(UsageError, match=rf"mqtt\.{name} .*No such file"):
        Broker(MqttConfig(broker="mqtts://pi", **{name: str(file)}))
    file.write_text("no certificate")
    with pytest.raises(UsageError, match=rf"mqtt\.{name} .*not a PEM file"):
        Broker(MqttConfig(broker="mqtts://pi", **{name: str(file)}))


def test_only_insecure_takes_any_certificate() -> None:
    assert Broker(MqttConfig(broker="pi")).tls is None
    strict = Broker(MqttConfig(broker="mqtts://pi")).tls
    assert (strict.verify_mode, strict.check_hostname) == (ssl.CERT_REQUIRED, True)
    lax = Broker(MqttConfig(broker="mqtts://pi", insecure=True)).tls
    assert (lax.verify_mode, lax.check_hostname) == (ssl.CERT_NONE, False)
