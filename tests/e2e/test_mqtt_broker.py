"""MQTT against the real mosquitto: what arrives, what is lost and counted while the broker comes and goes."""

import json
import os
import signal
import time
from pathlib import Path

import pytest
from fltea.records.records import Gap
from fltea.sinks.mqtt import delivery, link
from mosquitto_support import DAEMON, HELLO, WATCHER, Stage, last_status, make_authority, sample
from support import Processes, wait_until

from tools.faults.server import free_port

STATUS = "fltea/a0/status"


# --- the real command ---

QUICK = ("-s", "synthetic:?alpha=0.3&f=-1.5", "--startup", "50", "--set", "estimator.window=200")


def test_topics_hold_the_lines_of_stdout(stage: Stage, processes: Processes, tmp_path: Path) -> None:
    """Through TLS, a password file and an access list; the password shows nowhere."""
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


# --- a broker that goes and comes ---


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
    else:  # what nobody acknowledged counts as lost, whether it arrived or not
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
    """The network takes the bytes, but no acknowledgement comes back: as if a cable were cut."""
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
    """Every attempt is a client of its own: months without a broker must not fill the process."""
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
