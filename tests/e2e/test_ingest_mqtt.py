"""Frames of many devices through a real broker: each becomes a device of its own, under its topic's name."""

import json

import pytest
from fltea.records.errors import UsageError
from fltea.service.daemon import run
from fltea.settings.config import load_configs
from frames_messages import second_of
from host_support import QUICK, Processes, wait_until
from mosquitto_support import Stage

SECONDS = 6


def test_each_topic_is_a_device_and_nothing_of_it_is_lost(stage: Stage, processes: Processes) -> None:
    broker = stage.broker()
    url = f"mqtt://localhost:{broker.port}"
    client = stage.client(broker.port, "boards")
    client.publish("fltea/old/frames", second_of(9, 0), qos=1, retain=True).wait_for_publish(10)
    watcher = stage.watcher(broker.port)
    daemon = processes.daemon("-s", url, "--mqtt", url, "--set", "name=lab", "--format", "ndjson", *QUICK)
    wait_until(lambda: bool(watcher.on("fltea/lab/ingest")), "the program's own status")
    wait_until(lambda: json.loads(watcher.on("fltea/lab/ingest")[-1].payload)["status"] == "online", "online")
    for second in range(SECONDS):
        for k, name in enumerate(("left", "right", "third")):
            client.publish(f"fltea/{name}/frames", second_of(k, second), qos=1)
        client.publish("fltea/bad name<b>/frames", second_of(3, second), qos=1)
        client.publish("fltea/lab/frames", second_of(3, second), qos=1)
        client.publish("fltea/rubbish/frames", b"\x05no frames at all\x00" * 9, qos=1)
    whole = 100 * (SECONDS - 1)  # a device is let in with its second message
    daemon.wait_for(
        lambda: all(
            sum(r["device"] == name for r in daemon.of("estimate")) == whole - 50
            for name in ("left", "right", "third")
        ),
        "all estimates",
    )
    wait_until(lambda: bool(watcher.on("fltea/right/hello")), "HELLO of a device")
    code, text = daemon.end()
    assert code == 0, text
    last = {r["device"]: r for r in daemon.of("stats")}
    assert set(last) == {"left", "right", "third", "rubbish"}
    for name in ("left", "right", "third"):
        assert last[name]["samples"] == {
            "delivered": whole, "lost": 0, "gaps": 0, "duplicates": 0, "before_hello": 0
        }  # fmt: skip
        assert last[name]["link"]["bad_frames"] == {}
        seqs = [r["seq"] for r in daemon.of("estimate") if r["device"] == name]
        assert seqs == list(range(150, 100 * SECONDS))
    assert sum(last["rubbish"]["link"]["bad_frames"].values()) == 9 * (SECONDS - 1)
    assert "devices_refused" in daemon.errors()
    refused = next(r["message"] for r in daemon.of("error") if r["kind"] == "devices_refused")
    assert "names that no device has" in refused
    heard = {one.topic.split("/")[1] for one in watcher.heard if not one.topic.endswith("/frames")}
    assert heard == {"left", "right", "third", "lab"}, "under the topic's name, never HELLO's"
    for topic in ("fltea/left/status", "fltea/lab/ingest"):
        last_word = json.loads(watcher.on(topic)[-1].payload)
        assert (last_word["status"], last_word["reason"]) == ("offline", "ended")


def test_a_broker_that_goes_and_comes_back(stage: Stage, processes: Processes) -> None:
    broker = stage.broker()
    url = f"mqtt://localhost:{broker.port}"
    daemon = processes.daemon("-s", url, "--mqtt", url, "--set", "name=lab", "--format", "ndjson", *QUICK)
    watcher = stage.watcher(broker.port)
    wait_until(lambda: bool(watcher.on("fltea/lab/ingest")), "the program")
    broker.stop()
    daemon.wait_for(lambda: "broker_lost" in daemon.errors(), "word of it")
    broker.start()
    daemon.wait_for(lambda: "broker_back" in daemon.errors(), "the broker's return")
    client = stage.client(broker.port, "boards")
    for second in range(3):
        client.publish("fltea/left/frames", second_of(0, second), qos=1)
    daemon.wait_for(lambda: len(daemon.of("estimate")) == 150, "its samples")
    wait_until(lambda: bool(watcher.on("fltea/left/hello")), "that it is published")
    assert daemon.end()[0] == 0


@pytest.mark.parametrize(
    "setting",
    [{"once": True}, {"record.folder": "x"}, {"state.file": "x"}, {"dashboard.address": 0}],
)
def test_what_is_for_one_device_is_refused(setting: dict[str, object]) -> None:
    configs = load_configs(None, {"format": "none", **setting}, ["mqtt://localhost:1"])
    with pytest.raises(UsageError, match=f"--{next(iter(setting)).partition('.')[0]}.*many devices"):
        run(configs)
