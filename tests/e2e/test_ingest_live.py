"""Tests in which frames of many devices pass through real servers.

Workers share the devices, and every frame is accounted for.
"""

import asyncio
import json
import ssl
import time
from collections import Counter
from pathlib import Path
from typing import Any

import nats
import nats.js.errors
import pytest
from fltea.records.errors import UsageError
from fltea.records.stats import SampleStats
from fltea.service.daemon import run
from fltea.service.ingest.inbox import Inbox
from fltea.service.ingest.mqtt import MqttFrames
from fltea.service.ingest.receivers import receiver_of
from fltea.settings.config import load_configs
from fltea.settings.mqtt import MqttConfig

from tests.rig.frames_messages import second_of
from tests.rig.host_support import PATIENCE_S, QUICK, Daemon, Processes, wait_until
from tests.rig.mosquitto_support import Stage, make_authority
from tests.rig.nats_support import PARTITIONS, single, three_nodes

DEVICES = ("s0", "s1", "s2", "s3", "s4", "s5")
SNAPSHOT_S = 2
EVERY = 10


def worker(processes: Processes, url: str, name: str, *more: str) -> Daemon:
    chosen = {
        "name": name,
        "live.on": "false",
        "ingest.partitions": PARTITIONS,
        "ingest.snapshot_s": SNAPSHOT_S,
    }
    flags = [word for key, value in chosen.items() for word in ("--set", f"{key}={value}")]
    return processes.daemon("-s", url, "--format", "ndjson", "--every", str(EVERY), *QUICK, *flags, *more)


class Boards:
    """Simulated boards that publish from an event loop in a thread.

    Each message contains the frames of one device for one second.
    """

    def __init__(self, url: str, **options: Any) -> None:
        self._loop = asyncio.new_event_loop()
        self.refused: list[str] = []
        self._client = self._loop.run_until_complete(
            nats.connect(url, error_cb=self._on_error, allow_reconnect=False, **options)
        )
        self.second = 0

    async def _on_error(self, error: Exception) -> None:
        self.refused.append(str(error))

    def has_stream(self) -> bool:
        """Return whether a worker has made the stream in the server. Messages that are published before would
        be lost.
        """
        asked = self._client.jetstream().stream_info("FLTEA_FRAMES")
        try:
            return bool(self._loop.run_until_complete(asked))
        except nats.js.errors.NotFoundError:
            return False

    def publish(self, *names: str) -> None:
        async def all_of_them() -> None:
            for k, name in enumerate(names):
                await self._client.publish(f"fltea.{name}.frames", second_of(k, self.second))
            await self._client.flush()

        self._loop.run_until_complete(all_of_them())
        self.second += 1

    def close(self) -> None:
        self._loop.run_until_complete(self._client.close())
        self._loop.close()


def estimated(*daemons: Daemon) -> dict[str, Counter[int]]:
    found: dict[str, Counter[int]] = {name: Counter() for name in DEVICES}
    for daemon in daemons:
        for record in daemon.of("estimate"):
            found[record["device"]][record["seq"]] += 1
    return found


@pytest.mark.slow
def test_a_worker_that_is_killed_is_replaced_and_no_frame_is_lost(
    tmp_path: Path, processes: Processes, stage: Stage
) -> None:
    server = single(tmp_path / "nats")
    stage.callback(server.kill)
    url = f"nats://127.0.0.1:{server.port}"
    first = worker(processes, url, "first")
    boards, begin_s = Boards(url), time.monotonic()

    def go_on_until(condition: Any, what: str) -> None:
        """Publish samples, three times as fast as real boards, until a condition holds."""
        while not condition():
            assert time.monotonic() - begin_s < PATIENCE_S, what
            boards.publish(*DEVICES)
            time.sleep(0.33)

    wait_until(boards.has_stream, "the stream")
    go_on_until(lambda: all(estimated(first).values()), "the first worker")
    second = worker(processes, url, "second")
    go_on_until(lambda: any(estimated(second).values()), "a share of the second worker")
    shared_s = time.monotonic()
    go_on_until(lambda: time.monotonic() - shared_s > 2 * SNAPSHOT_S + 1, "snapshots")
    theirs = {name for name, seqs in estimated(second).items() if seqs}
    assert 0 < len(theirs) < len(DEVICES), "each has some"
    before = estimated(second)
    first.process.kill()
    killed_s = time.monotonic()
    go_on_until(lambda: all(estimated(second).values()), "the second worker for all")
    taken_s = time.monotonic() - killed_s
    assert taken_s < 10, "the lease says when; a busy machine may take some seconds more"
    last = 100 * boards.second
    second.wait_for(lambda: all(last - EVERY in seqs for seqs in estimated(second).values()), "the end")
    boards.close()
    second.end_well()
    first.end(None)
    for name, seqs in estimated(first, second).items():
        assert set(seqs) == set(range(50, last, EVERY)), f"{name}: all but the window"
        again = sum(count - 1 for count in seqs.values())
        assert again <= 2 * 100 // EVERY * 3 * (2 * SNAPSHOT_S + 2), (
            f"{name}: twice only what came since the snapshots"
        )
    stats = {record["device"]: record["sample_counts"] for record in second.of("stats")}
    assert set(stats) == set(DEVICES)
    assert not any(samples["lost"] or samples["before_hello"] for samples in stats.values())
    resumed = {record["device"] for record in second.of("epoch") if record["reason"] == "resumed"}
    assert resumed >= {name for name in DEVICES if not before[name]}
    taken = [record["message"] for record in second.of("error") if record["kind"] == "partition_taken"]
    assert any("gone silent" in message for message in taken)


@pytest.mark.slow
def test_three_nodes_with_tls_and_accounts(
    tmp_path: Path, processes: Processes, stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    ca = make_authority(tmp_path / "ca")
    folder = tmp_path / "nodes"
    folder.mkdir()
    servers = three_nodes(folder, tmp_path / "ca")
    for one in servers:
        stage.callback(one.kill)
    monkeypatch.setenv("FLTEA_NATS_USER", "worker")
    monkeypatch.setenv("FLTEA_NATS_PASSWORD", "worker-secret")
    urls = ",".join(f"nats://localhost:{one.port}" for one in servers)
    settings = ["--set", f"ingest.ca={ca}", "--set", "ingest.replicas=3", "--set", "ingest.partitions=16"]
    daemon = worker(processes, urls, "secure", *settings)
    tls = ssl.create_default_context(cafile=str(ca))
    boards = Boards(f"nats://localhost:{servers[1].port}", tls=tls, user="s1", password="s1-secret")

    def heard(condition: Any) -> Any:
        def met() -> bool:
            boards.publish("s1")
            time.sleep(0.2)
            return bool(condition())

        return met

    daemon.wait_for(heard(lambda: daemon.of("estimate")), "estimates through the cluster")
    wait_until(lambda: boards.publish("s2") or "permissions violation" in str(boards.refused), "the refusal")
    servers[0].kill()
    count = len(daemon.of("estimate"))
    daemon.wait_for(heard(lambda: len(daemon.of("estimate")) > count + 1000 // EVERY), "a node less")
    boards.close()
    daemon.end_well()
    assert {record["device"] for record in daemon.of("estimate")} == {"s1"}


@pytest.mark.parametrize(
    "url",
    [
        "nats:",
        "nats://user:secret@host",
        "nats://host,mqtt://other",
        "nats://host:abc",
        "nats://host:70000",
        "nats://host:0",
        "nats://host:",
        "nats://:4222",
        "nats://[::1",
        "mqtt:",
        "mqtt://user:secret@host",
        "mqtt://host/topic",
    ],
)
def test_an_address_that_is_none_is_refused_without_its_password(url: str) -> None:
    with pytest.raises(UsageError, match="source") as caught:
        receiver_of(load_configs(None, {}, [url])[0])
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize("url", ["nats://host", "nats://host:4222,nats://10.0.0.1:1", "nats://[::1]:4222"])
def test_an_address_with_or_without_port_is_not_refused(url: str) -> None:
    receiver_of(load_configs(None, {}, [url])[0])


SECONDS = 6


def test_a_broker_that_does_not_let_us_in_is_told_once_and_by_that_name(stage: Stage) -> None:
    broker, told = stage.broker(secure=True), list[str]()
    settings = MqttConfig(broker=f"mqtt://localhost:{broker.port}")
    frames = MqttFrames(settings, Inbox(10, 1000), lambda kind, text: told.append(kind))
    frames.start()
    try:
        wait_until(lambda: broker.said().count("not authori") >= 2, "that it is tried again")
    finally:
        frames.close()
    assert told == ["broker_refused"]


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
    whole = 100 * SECONDS
    daemon.wait_for(
        lambda: all(
            sum(r["device"] == name for r in daemon.of("estimate")) == whole - 50
            for name in ("left", "right", "third")
        ),
        "all estimates",
    )
    wait_until(lambda: bool(watcher.on("fltea/right/hello")), "HELLO of a device")
    daemon.end_well()
    last = {r["device"]: r for r in daemon.of("stats")}
    assert set(last) == {"left", "right", "third", "rubbish"}
    for name in ("left", "right", "third"):
        assert last[name]["sample_counts"] == dict.fromkeys(SampleStats.__struct_fields__, 0) | {
            "delivered": whole
        }
        assert last[name]["link"]["bad_frames"] == {}
        seqs = [r["seq"] for r in daemon.of("estimate") if r["device"] == name]
        assert seqs == list(range(50, 100 * SECONDS))
    assert sum(last["rubbish"]["link"]["bad_frames"].values()) == 9 * SECONDS
    assert "devices_refused" in daemon.errors()
    refused = next(r["message"] for r in daemon.of("error") if r["kind"] == "devices_refused")
    assert "impossible names" in refused
    heard = {one.topic.split("/")[1] for one in watcher.heard if not one.topic.endswith("/frames")}
    assert heard == {"left", "right", "third", "lab"}, "under the topic's name, never HELLO's"
    for topic in ("fltea/left/status", "fltea/lab/ingest"):
        last_word = json.loads(watcher.on(topic)[-1].payload)
        assert (last_word["status"], last_word["reason"]) == ("offline", "ended")


@pytest.mark.slow
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
    daemon.end_well()


@pytest.mark.parametrize(
    "setting", [{"once": True}, {"record.folder": "x"}, {"state.file": "x"}, {"dashboard.address": 0}]
)
def test_what_is_for_one_device_is_refused(setting: dict[str, object]) -> None:
    configs = load_configs(None, {"format": "none", **setting}, ["mqtt://localhost:1"])
    with pytest.raises(UsageError, match=f"--{next(iter(setting)).partition('.')[0]}.*many devices"):
        run(configs)
