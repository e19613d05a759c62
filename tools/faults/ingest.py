"""Faults of programs that process the samples of many boards, and of the server between them.

A worker of NATS is killed, stopped or cut off, or its clock jumps. The NATS server of two workers, or the
MQTT broker of one program, is killed, is away or has no space left, or its network is cut.
"""

import os
import signal
import time
from collections import Counter
from functools import partial
from typing import Any

from tools.faults.case import Case
from tools.faults.expected import SOME, Bounds, Expected
from tools.faults.ingest_scene import DEVICES, PARTITIONS, Scene, boards_of
from tools.faults.nats_server import NatsServer
from tools.faults.outcome import Outcome
from tools.faults.program import Program, Skip, wait_until
from tools.faults.small_disk import SmallDisk
from tools.faults.stage import Stage
from tools.frames_load import RATE_HZ

PAST_LEASE_S = AWAY_S = 8.0
DAY_NS = 86_400 * 10**9
DISK, STORE = "160m", "96MB"
"""DISK: size of the server's disk. STORE: size to which the server limits its stored messages. STORE is
smaller than the disk, but large enough for the streams (stored messages) that the workers create.
"""


def nats_scene(stage: Stage, **how: Any) -> Scene:
    """Return a `Scene` with a NATS server and two workers."""
    return Scene(stage, NatsServer(stage.folder, PARTITIONS), **how)


# --- faults of a worker ---


def worker_killed(stage: Stage) -> Outcome:
    """Kill a worker with SIGKILL."""
    return _killed(nats_scene(stage))


def worker_stands_still(stage: Stage) -> Outcome:
    """Stop a worker for longer than its lease of partitions (groups of boards); let it continue."""
    scene = nats_scene(stage)
    first, second = scene.workers
    before, published = len(first.records), scene.boards.samples
    os.kill(first.process.pid, signal.SIGSTOP)
    try:
        scene.until_all_by(second)
    finally:
        os.kill(first.process.pid, signal.SIGCONT)
    _share_again(scene, first)
    early = _processed_without_a_lease(first.records[before:], published + 2 * RATE_HZ)
    wrong = [f"it processed {early} samples of the other worker's partitions"] if early else []
    return scene.outcome("both share again", wrong)


def worker_cut_off(stage: Stage) -> Outcome:
    """Cut the network between a worker and the server, and restore it later.

    The network is cut until the other worker has all boards.
    """
    scene = nats_scene(stage)
    first, second = scene.workers
    scene.line.cut()
    cut_s = time.monotonic()
    scene.until_all_by(second)
    taken_s = time.monotonic() - cut_s
    processed = len(first.of("sample"))
    time.sleep(PAST_LEASE_S)
    late = len(first.of("sample")) - processed
    scene.line.heal()
    _share_again(scene, first)
    wrong = [f"the worker that was cut off processed {late} more samples"] if late else []
    return scene.outcome(f"taken over after {taken_s:.0f} s; both share again", wrong)


def clock_jumps(stage: Stage, *days: int) -> Outcome:
    """Set a worker's clock ahead of the true time several times, then kill the worker.

    `days`: one number for each setting: how many days the clock is then ahead of the true time.
    """
    scene, wrong = nats_scene(stage), []
    for ahead in days:
        before = _reported(scene.workers)
        stage.set_clock(ahead * DAY_NS)
        time.sleep(PAST_LEASE_S)
        since = _reported(scene.workers) - before
        # A partition (a group of boards) may move from one worker to another while the connection to NATS is
        # lost. This is no error.
        if since["partition_taken"] and not since["nats_lost"]:
            wrong.append(f"{since['partition_taken']} partitions were taken when the clock was set")
    return _killed(scene, wrong)


def _reported(workers: list[Program]) -> Counter[str]:
    return Counter(kind for worker in workers for kind in worker.errors())


def _killed(scene: Scene, wrong: list[str] | None = None) -> Outcome:
    """Kill the first worker, and wait until the second one has taken over all boards.

    `wrong`: what the caller has already found wrong, as texts for the outcome.
    """
    first, second = scene.workers
    before = boards_of(second)
    epochs = len(second.of("epoch"))
    first.kill()
    killed_s = time.monotonic()
    scene.until_all_by(second)
    taken_s = time.monotonic() - killed_s
    reasons = {r["device"]: r["reason"] for r in second.of("epoch")[epochs:] if r["device"] not in before}
    found = [f"did not go on from snapshots: {reasons}"] if set(reasons.values()) != {"resumed"} else []
    more = f"{DEVICES - len(before)} of {DEVICES} sensors taken over after {taken_s:.0f} s"
    return scene.outcome(more, [*(wrong or []), *found])


def _processed_without_a_lease(records: list[dict[str, Any]], since: int) -> int:
    """Count the samples that a worker delivered too early: before it reported that it has a group of boards.

    `since`: number of the first sample that is counted. Earlier samples were already on the way to the worker
    when it was stopped.
    """
    lease = next(i for i, r in enumerate(records) if r["class"] == "error" and r["kind"] == "partition_taken")
    return sum(r["class"] == "sample" and r["seq"] >= since for r in records[:lease])


def _share_again(scene: Scene, worker: Program) -> None:
    since = scene.boards.samples
    wait_until(lambda: bool(boards_of(worker, since)), "its share")
    scene.until_all_again()


# --- faults of the server ---


def server_killed(stage: Stage, *, nats: bool, away_s: float, qos: int = 1) -> Outcome:
    """Kill the server, and start it again after `away_s` seconds.

    `qos`: MQTT's quality of service; with 0 the boards do not repeat lost messages.
    """
    scene = nats_scene(stage, qos=qos) if nats else Scene(stage, stage.broker())
    scene.server.kill()
    time.sleep(away_s)
    scene.server.start()
    return _outcome_when_back(scene)


def cut_off(stage: Stage) -> Outcome:
    """Cut the network between program and broker until the program has reported the loss of the broker.

    The boards keep sending.
    """
    scene = Scene(stage, stage.broker())
    (program,) = scene.workers
    scene.line.cut()
    cut_s = time.monotonic()
    program.wait_for(lambda: "broker_lost" in program.errors(), "word of it")
    reported_s = time.monotonic() - cut_s
    scene.line.heal()
    scene.until_all_again()
    return scene.outcome(f"reported after {reported_s:.0f} s")


def store_full(stage: Stage, *, qos: int = 1) -> Outcome:
    """Fill the server's store up to its limit with a stream of another program. Then delete this stream."""
    server, _ = _server_on_small_disk(stage)
    scene = Scene(stage, server, qos)
    server.fill_store()
    _wait_until_lost(scene)
    server.empty_store()
    return _outcome_when_back(scene)


def disk_full(stage: Stage) -> Outcome:
    """Let other files fill the server's disk; then delete the files, and start the server again."""
    server, disk = _server_on_small_disk(stage)
    scene = Scene(stage, server)
    disk.fill()
    _wait_until_lost(scene)
    disk.free()
    server.kill()
    server.start()
    return _outcome_when_back(scene)


def _server_on_small_disk(stage: Stage) -> tuple[NatsServer, SmallDisk]:
    """Return a server whose files are on a small disk that survives a kill of the server, and this disk."""
    disk = stage.disk("js", size=DISK)
    if not disk.is_mounted:
        raise Skip("no small disk can be made here (unshare, mount)")
    return NatsServer(stage.folder, PARTITIONS, store=STORE, before=disk.hold()), disk


def _wait_until_lost(scene: Scene) -> None:
    """Wait until all workers have reported the loss of the server, and for AWAY_S more."""
    for worker in scene.workers:
        worker.wait_for(lambda worker=worker: "nats_lost" in worker.errors(), "word of it")  # type: ignore[misc]
    time.sleep(AWAY_S)


def _outcome_when_back(scene: Scene) -> Outcome:
    back_s = time.monotonic()
    scene.until_all_again()
    more = f"samples of all sensors again {time.monotonic() - back_s:.0f} s after it was back"
    if isinstance(scene.server, NatsServer):
        reported = max(worker.errors().count("nats_lost") for worker in scene.workers)
        more += f"; `nats_lost` {reported} times a worker"
    return scene.outcome(more)


AWAY = f"away for {AWAY_S:g} s"
STORE_FULL = f"NATS server's store at its limit for {AWAY_S:g} s"
AT_ONCE = "killed (`kill -9`), started again at once"
QOS_0 = ", boards send with QoS 0"
TAKEN = frozenset({"partition_taken"})
LOST_AND_TAKEN = TAKEN | {"nats_lost", "nats_back"}
PERHAPS = frozenset({"fits_slowed", "partition_caught_up", "silent", "snapshot_failed"})
"""Kinds of errors that may be reported but need not. Whether they are reported depends on how busy the
machine is, and on which worker had a board.
"""
NATS_PERHAPS = PERHAPS | {"nats_lost", "nats_back"}


def _nats(reported: frozenset[str], *, lost: Bounds = 0, perhaps: frozenset[str] = PERHAPS) -> Expected:
    """Return the expected outcome of a fault of NATS.

    `excused` is None, so any number of samples may be missing that no record counts as lost. The reason is
    that a program's output may drop records; it counts them itself.
    """
    return Expected(reported, perhaps=perhaps, lost=lost, excused=None)


MQTT = Expected(
    frozenset({"broker_lost", "broker_back"}),
    perhaps=PERHAPS,
    lost=None,  # Samples that are sent before the program is back are lost. Their number depends on chance.
    excused=None,
)

CASES = (
    Case("one of two workers killed (`kill -9`)", worker_killed, _nats(TAKEN), tested=False),
    Case(
        "one of two workers stopped (SIGSTOP) until the other had all, and let go on",
        worker_stands_still,
        _nats(TAKEN, perhaps=NATS_PERHAPS),
        tested=False,
    ),
    Case(
        "one of two workers cut off from the server until the other had all",
        worker_cut_off,
        _nats(LOST_AND_TAKEN),
        tested=False,
    ),
    Case(
        "clock of a worker set a day forward, and back; then it was killed",
        lambda stage: clock_jumps(stage, 1, 0),
        _nats(TAKEN | {"nats_clock"}, perhaps=NATS_PERHAPS),
        tested=False,
    ),
    Case(
        "a worker killed while its clock was a day ahead",
        lambda stage: clock_jumps(stage, 1),
        _nats(TAKEN | {"nats_clock"}, perhaps=NATS_PERHAPS),
        tested=False,
    ),
    Case(
        f"NATS server {AT_ONCE}",
        partial(server_killed, nats=True, away_s=0.0),
        _nats(LOST_AND_TAKEN),
        tested=False,
    ),
    Case(f"NATS server {AWAY}", partial(server_killed, nats=True, away_s=AWAY_S), _nats(LOST_AND_TAKEN)),
    Case(
        f"NATS server {AWAY}{QOS_0}",
        partial(server_killed, nats=True, away_s=AWAY_S, qos=0),
        _nats(LOST_AND_TAKEN, lost=SOME),
        tested=False,
    ),
    Case(STORE_FULL, store_full, _nats(LOST_AND_TAKEN), tested=False),
    Case(STORE_FULL + QOS_0, partial(store_full, qos=0), _nats(LOST_AND_TAKEN, lost=SOME), tested=False),
    Case(f"MQTT broker {AT_ONCE}", partial(server_killed, nats=False, away_s=0.0), MQTT),
    Case(f"MQTT broker {AWAY}", partial(server_killed, nats=False, away_s=AWAY_S), MQTT, tested=False),
    Case("cut off from the MQTT broker until it was reported", cut_off, MQTT, tested=False),
    Case(
        f"NATS server's disk full for {AWAY_S:g} s; room again, and the server started again",
        disk_full,
        _nats(LOST_AND_TAKEN),
        tested=False,
    ),
)
