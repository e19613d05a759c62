"""Tests of MQTT with the real broker mosquitto.

The tests are about the messages that arrive, the losses that are counted, and the clients that are accepted.
"""

import json
import os
import signal
import time
from pathlib import Path

import pytest
from fltea.mqtt import link
from fltea.records.records import Gap
from fltea.settings.mqtt import MqttConfig
from fltea.sinks.mqtt import delivery
from fltea.sinks.mqtt.sink import MqttSink

from tests.rig.host_support import Processes, wait_until
from tests.rig.mosquitto_support import (
    DAEMON,
    HELLO,
    STRANGER,
    WATCHER,
    Stage,
    last_status,
    make_authority,
    sample,
)
from tools.faults.server import free_port

# Warnings are ignored, since the MQTT library leaves it to the garbage collector to close the socket of a
# failed handshake.
pytestmark = [
    pytest.mark.filterwarnings("ignore:.*unclosed <ssl.SSLSocket:ResourceWarning"),
    pytest.mark.filterwarnings("ignore:.*<ssl.SSLSocket:pytest.PytestUnraisableExceptionWarning"),
]
STATUS = "fltea/a0/status"


# --- the real command ---

QUICK = ("-s", "synthetic:?alpha=0.3&f=-1.5", "--startup", "50", "--set", "estimator.window=200")


def test_topics_hold_the_lines_of_stdout(stage: Stage, processes: Processes, tmp_path: Path) -> None:
    """The connection uses TLS, a password file and an access list. The password appears nowhere."""
    ca = make_authority(tmp_path / "authority")
    broker = stage.broker(authority=ca.parent, secure=True)
    watcher = stage.watcher(broker.port, ca, WATCHER)
    secret = tmp_path / "secret"
    secret.write_text(":".join(DAEMON) + "\n")
    secret.chmod(0o600)
    settings = (f"ca={ca}", f"password_file={secret}", "estimate_every=3", "sample_every=1")
    flags = [flag for setting in settings for flag in ("--set", f"mqtt.{setting}")]
    daemon = processes.daemon(*QUICK, "--samples", "--mqtt", f"mqtts://localhost:{broker.port}", *flags)
    daemon.wait_for(lambda: len(watcher.on("fltea/synthetic/estimate")) > 20, "estimates")
    shown = Path(f"/proc/{daemon.process.pid}/cmdline").read_bytes()
    code, stderr = daemon.end(signal.SIGTERM)
    assert (code, stderr) == (0, "")
    assert DAEMON[1].encode() not in shown

    wait_until(lambda: last_status(watcher, "fltea/synthetic/status") == "offline", "the farewell")
    lines = {kind: daemon.of(kind) for kind in ("hello", "epoch", "stats", "sample", "estimate", "fit")}
    lines["estimate"] = [line for line in lines["estimate"] if line["seq"] % 3 == 0]
    for kind, records in lines.items():
        found = [json.loads(one.payload) for one in watcher.on(f"fltea/synthetic/{kind}")]
        assert found == records, kind
        assert found, kind
    assert lines["stats"][-1]["outputs"]["mqtt"]["dropped"] == 0
    said = [json.loads(one.payload) for one in watcher.on("fltea/synthetic/status")]
    assert [one["status"] for one in said] in (["online", "offline"], ["stalled", "online", "offline"])
    assert said[-1]["reason"] == "ended"
    assert said[-1]["device"] == "synthetic"
    late = stage.watcher(broker.port, ca, WATCHER)
    wait_until(lambda: len(late.heard) >= 3, "what is retained")
    time.sleep(0.1)
    assert {one.topic for one in late.heard} == {
        f"fltea/synthetic/{kind}" for kind in ("hello", "status", "fit")
    }
    assert all(one.retained for one in late.heard)


def test_last_will_after_a_kill(stage: Stage, processes: Processes) -> None:
    broker = stage.broker()
    watcher = stage.watcher(broker.port)
    daemon = processes.daemon(*QUICK, "--mqtt", f"localhost:{broker.port}")
    topic = "fltea/synthetic/status"
    daemon.wait_for(lambda: last_status(watcher, topic) == "online", "online")
    daemon.end(signal.SIGKILL)
    wait_until(lambda: last_status(watcher, topic) == "offline", "the will")
    will = json.loads(watcher.on(topic)[-1].payload)
    assert (will["reason"], will["since_ns"], will["device"]) == ("connection_lost", None, "synthetic")
    late = stage.watcher(broker.port)
    wait_until(lambda: last_status(late, topic) == "offline", "the retained will")


# --- a broker that stops and comes back ---


@pytest.mark.parametrize("qos", [0, 1])
def test_delivered_and_lost_are_what_was_sent_through_a_restart_of_the_broker(stage: Stage, qos: int) -> None:
    broker = stage.broker()
    watcher = stage.watcher(broker.port)
    driven = stage.drive(broker.port, stream_qos=qos)
    driven.write(HELLO)
    driven.until(lambda: driven.sink._link.up, "the broker")
    driven.write(*map(sample, range(200)))
    driven.until(lambda: len(watcher.on("fltea/a0/sample")) >= 50, "samples before")

    broker.stop()
    driven.until_told("broker_lost")
    for seq in range(200, 400):
        driven.write(sample(seq))
    driven.write(*(Gap(seq, 1, 1, 0, device="due") for seq in range(5)))
    driven.until(lambda: driven.sink._link._failures >= 2, "a second attempt")
    broker.start()
    text = driven.until_told("broker_back")
    driven.write(*map(sample, range(400, 600)))
    driven.write(Gap(5, 1, 1, 0, device="due"))
    gaps = "fltea/a0/gap"
    driven.until(lambda: len(watcher.on(gaps)) >= 6, "gaps")
    driven.until(lambda: not driven.sink._delivery._flight, "acknowledgements")

    def samples() -> set[int]:
        return {json.loads(one.payload)["seq"] for one in watcher.on("fltea/a0/sample")}

    driven.until(lambda: len(samples()) + driven.sink.lost >= 600, "the last samples")
    arrived = samples()
    assert set(range(400, 600)) <= arrived
    assert not set(range(200, 400)) & arrived
    if qos:
        assert driven.sink.lost == 200
        assert len(arrived) == 400
    else:  # Messages that were not acknowledged count as lost, whether or not they arrived.
        assert 200 <= driven.sink.lost <= 400
    assert f"{driven.sink.lost} records were lost" in text
    assert [json.loads(one.payload)["seq"] for one in watcher.on(gaps)] == list(range(6))
    assert last_status(watcher) == "online"
    assert driven.kinds() == ["broker_lost", "broker_back"]


def test_restarted_broker_without_a_memory_is_told_the_state_anew(stage: Stage, tmp_path: Path) -> None:
    broker = stage.broker()
    driven = stage.drive(broker.port)
    driven.write(HELLO, sample(0))
    driven.until(lambda: driven.sink._link.up and not driven.sink._delivery._flight, "the broker")
    broker.kill()
    (tmp_path / "broker1/mosquitto.db").unlink(missing_ok=True)
    driven.until_told("broker_lost")
    broker.start()
    driven.until_told("broker_back")
    watcher = stage.watcher(broker.port)
    wait_until(lambda: len(watcher.heard) >= 2, "the state")
    assert {one.topic for one in watcher.heard} == {STATUS, "fltea/a0/hello"}


def test_broker_that_is_absent_at_the_start_is_waited_for(stage: Stage) -> None:
    broker = stage.broker()
    broker.stop()
    driven = stage.drive(broker.port)
    driven.write(HELLO, Gap(7, 1, 1, 0, device="due"))
    text = driven.until_told("broker_lost")
    assert f"localhost:{broker.port}" in text
    assert "is the broker running" in text
    driven.write(sample(0))
    assert driven.sink.lost == 1
    driven.until(lambda: driven.sink._link._failures >= 2, "a second attempt")
    broker.start()
    driven.until_told("broker_back")
    watcher = stage.watcher(broker.port)
    wait_until(lambda: last_status(watcher) in ("online", "stalled"), "the status")
    assert driven.kinds() == ["broker_lost", "broker_back"]


def test_frozen_broker_blocks_nobody_and_what_it_cannot_take_is_counted(stage: Stage) -> None:
    """The broker is frozen. The network accepts the bytes, but no acknowledgement comes back, as if a cable
    were cut.
    """
    broker = stage.broker()
    watcher = stage.watcher(broker.port)
    driven = stage.drive(broker.port)
    driven.write(HELLO, sample(0))
    driven.until(lambda: len(watcher.on("fltea/a0/sample")) == 1, "the first sample")
    broker.pause()
    total = 2 * delivery.IN_FLIGHT
    driven.write(*map(sample, range(1, total)))
    assert total - 1 - delivery.IN_FLIGHT <= driven.sink.lost < total
    broker.go_on()
    driven.write(Gap(0, 1, 1, 0, device="due"))
    driven.until(lambda: len(watcher.on("fltea/a0/gap")) == 1, "the broker")
    driven.until(lambda: not driven.sink._delivery._flight, "acknowledgements")
    assert len(watcher.on("fltea/a0/sample")) + driven.sink.lost == total
    driven.write(sample(total))
    driven.until(lambda: watcher.on("fltea/a0/sample")[-1].payload.count(b'"seq":%d,' % total) == 1, "flow")
    assert driven.told == []


def test_no_thread_and_no_socket_stays_behind(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every attempt to connect uses a new client.

    Months without a broker must not exhaust the process's threads and descriptors.
    """
    monkeypatch.setattr(link, "BACKOFF_S", (0.0,))
    driven = stage.drive(free_port())
    driven.write(HELLO)

    def attempts(n: int) -> None:
        driven.until(lambda: driven.sink._link._failures >= n, "attempts")

    attempts(5)
    before = len(os.listdir("/proc/self/fd")), len(os.listdir("/proc/self/task"))
    attempts(60)
    after = len(os.listdir("/proc/self/fd")), len(os.listdir("/proc/self/task"))
    assert after[0] <= before[0] + 4
    assert after[1] <= before[1] + 2


# --- access control ---


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
    # mosquitto 2.0.11 closes the connection after each message that the access list forbids
    driven.until(lambda: driven.sink.lost == 2, "the end of both")
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
