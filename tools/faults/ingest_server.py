"""Faults of the server that sends samples to us: killed, away, cut off, its store full, its disk full.

It is the NATS server that two workers share, or the MQTT broker of one program.
"""

import time
from functools import partial

from tools.faults.case import Case, Outcome
from tools.faults.ingest_scene import PARTITIONS, BrokerScene, NatsScene, outcome, until_all_again
from tools.faults.nats_server import NatsServer
from tools.faults.program import Skip
from tools.faults.small_disk import SmallDisk
from tools.faults.stage import Stage

AWAY_S = 8.0
"""Longer than a lease."""

DISK, STORE = "160m", "96MB"
"""The server's limit is less than the disk, and has room for what workers ask for."""

SERVER_AWAY = f"NATS server away for {AWAY_S:g} s"
STORE_FULL = f"NATS server's store at its limit for {AWAY_S:g} s"
QOS_0 = ", boards send with QoS 0"


def server_killed(stage: Stage, *, away_s: float, qos: int = 1) -> Outcome:
    """The server is killed, and started again after some seconds. qos: 0 if boards keep nothing."""
    scene = NatsScene(stage, qos)
    scene.server.kill()
    time.sleep(away_s)
    scene.server.start()
    return _outcome_when_back(scene)


def broker_killed(stage: Stage, *, away_s: float) -> Outcome:
    """The broker is killed, and started again after some seconds."""
    scene = BrokerScene(stage)
    scene.broker.kill()
    time.sleep(away_s)
    scene.broker.start()
    return _outcome_when_back(scene)


def program_cut_off(stage: Stage) -> Outcome:
    """The network between it and the broker is split until it reports so; boards go on."""
    scene = BrokerScene(stage)
    (program,) = scene.workers
    scene.line.cut()
    cut_s = time.monotonic()
    program.wait_for(lambda: "broker_lost" in program.errors(), "word of it")
    reported_s = time.monotonic() - cut_s
    scene.line.heal()
    until_all_again(scene.boards, scene.workers)
    return outcome(scene.boards, scene.workers, f"reported after {reported_s:.0f} s")


def store_full(stage: Stage, *, qos: int = 1) -> Outcome:
    """A stream of somebody else fills the server's store up to its limit; it is deleted."""
    server, _ = _server_on_small_disk(stage)
    scene = NatsScene(stage, qos, server)
    server.fill_store()
    _wait_until_lost(scene)
    server.empty_store()
    return _outcome_when_back(scene)


def disk_full(stage: Stage) -> Outcome:
    """Files of somebody else fill the server's disk; they are deleted, and the server is started again."""
    server, disk = _server_on_small_disk(stage)
    scene = NatsScene(stage, server=server)
    disk.fill()
    _wait_until_lost(scene)
    disk.free()
    server.kill()
    server.start()
    return _outcome_when_back(scene)


def _server_on_small_disk(stage: Stage) -> tuple[NatsServer, SmallDisk]:
    """A server that may be killed and started again; the disk stays."""
    disk = stage.disk("js", size=DISK)
    if not disk.is_mounted:
        raise Skip("no small disk can be made here (unshare, mount)")
    return NatsServer(stage.folder, PARTITIONS, store=STORE, before=disk.hold()), disk


def _wait_until_lost(scene: NatsScene) -> None:
    """Until all workers have reported it, and for some seconds more."""
    for worker in scene.workers:
        worker.wait_for(lambda worker=worker: "nats_lost" in worker.errors(), "word of it")  # type: ignore[misc]
    time.sleep(AWAY_S)


def _outcome_when_back(scene: NatsScene | BrokerScene) -> Outcome:
    back_s = time.monotonic()
    until_all_again(scene.boards, scene.workers)
    again_s = time.monotonic() - back_s
    more = f"samples of all sensors again {again_s:.0f} s after it was back"
    if isinstance(scene, NatsScene):
        reported = max(worker.errors().count("nats_lost") for worker in scene.workers)
        more += f"; `nats_lost` {reported} times a worker"
    return outcome(scene.boards, scene.workers, more)


CASES = (
    Case("NATS server killed (`kill -9`), started again at once", partial(server_killed, away_s=0.0)),
    Case(SERVER_AWAY, partial(server_killed, away_s=AWAY_S)),
    Case(SERVER_AWAY + QOS_0, partial(server_killed, away_s=AWAY_S, qos=0)),
    Case(STORE_FULL, store_full),
    Case(STORE_FULL + QOS_0, partial(store_full, qos=0)),
    Case("MQTT broker killed (`kill -9`), started again at once", partial(broker_killed, away_s=0.0)),
    Case(f"MQTT broker away for {AWAY_S:g} s", partial(broker_killed, away_s=AWAY_S)),
    Case("cut off from the MQTT broker until it was reported", program_cut_off),
    Case(f"NATS server's disk full for {AWAY_S:g} s; room again, and the server started again", disk_full),
)
