"""Boards that publish by MQTT, and the programs that walk their samples: workers of NATS, or one alone."""

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import chain

from tools.faults.account import Sample, account, heard
from tools.faults.case import Outcome
from tools.faults.mqtt_boards import Boards
from tools.faults.nats_server import NatsServer
from tools.faults.program import Program, wait_until
from tools.faults.stage import Stage

PARTITIONS, SNAPSHOT_S, KEPT_MB = 4, 2, 24


class BrokerScene:
    """A broker, boards that send with QoS 1, and a program. line: between broker and program."""

    def __init__(self, stage: Stage) -> None:
        self.broker = stage.broker()
        self.line = stage.line(self.broker.port)
        self.workers = [_walker(stage, f"mqtt://127.0.0.1:{self.line.port}", {"name": "lab"})]
        self.workers[0].wait_for(self.broker.has_subscriber, "its subscription")
        self.boards = stage.closing(Boards(self.broker.port, qos=1))
        self.boards.start()
        until_all_again(self.boards, self.workers)


class NatsScene:
    """Server, boards and two workers that share them.

    server: one that runs; else the scene has its own. line: between the first worker and the server. The
    first worker has the stage's clock.
    """

    def __init__(self, stage: Stage, qos: int = 1, server: NatsServer | None = None) -> None:
        self.server = server or NatsServer(stage.folder, PARTITIONS)
        stage.later(self.server.kill)
        self.line = stage.line(self.server.port)
        self.workers = [_worker(stage, "first", f"nats://127.0.0.1:{self.line.port}")]
        self.boards = stage.closing(Boards(self.server.mqtt_port, qos))
        self.workers[0].wait_for(self.server.has_stream, "the stream")
        self.boards.start()
        self.until_all_by(self.workers[0])
        self.workers.append(_worker(stage, "second", self.server.url))
        wait_until(lambda: bool(walked_by(self.workers[1])), "the second worker's share")
        time.sleep(2 * SNAPSHOT_S + 1)  # snapshots

    def until_all_by(self, worker: Program) -> None:
        """Wait until a worker has walked samples of all boards."""
        wait_until(lambda: walked_by(worker) == set(self.boards.names), "one worker for all")


def _worker(stage: Stage, name: str, url: str) -> Program:
    chosen = {
        "name": name,
        "ingest.partitions": PARTITIONS,
        "ingest.snapshot_s": SNAPSHOT_S,
        "ingest.keep_mb": KEPT_MB,
        "ingest.snapshots_mb": KEPT_MB,
    }
    return _walker(stage, url, chosen, **({"clock": stage.clock} if name == "first" else {}))


def _walker(stage: Stage, url: str, chosen: dict[str, object], **how: object) -> Program:
    flags = [word for key, value in chosen.items() for word in ("--set", f"{key}={value}")]
    return stage.daemon("-s", url, "--format", "ndjson", "--set", "live.on=false", *flags, **how)


def walked_by(worker: Program, since: int = 0) -> set[str]:
    """The boards of which a worker has walked samples of these numbers or later."""
    return {device for device, newest in worker.walked.copy().items() if newest >= since}


def until_all_again(boards: Boards, workers: Sequence[Program]) -> None:
    """Wait until samples of all boards arrive that are not published yet."""
    since = boards.samples
    wait_until(
        lambda: set().union(*(walked_by(one, since) for one in workers)) == set(boards.names),
        "samples of all sensors",
    )


def outcome(boards: Boards, workers: Sequence[Program], more: str, wrong: Sequence[str] = ()) -> Outcome:
    """Let all that was published arrive, end the workers, and account for it."""
    time.sleep(1.0)
    boards.stop()
    living = [worker for worker in workers if worker.code is None]
    last = boards.samples - 1
    wait_until(
        lambda: set().union(*(walked_by(one, last) for one in living)) == set(boards.names),
        "the last samples",
    )
    with ThreadPoolExecutor() as pool:  # at the same time: else the last one takes what the others give back
        list(pool.map(lambda worker: worker.end(), living))
    found = [*wrong, *(worker.stderr[-500:] for worker in living if worker.code != 0)]
    return samples_of(boards.names, boards.samples, workers, more, found)


def samples_of(
    names: Sequence[str],
    published: int,
    workers: Sequence[Program],
    more: str = "",
    wrong: Sequence[str] = (),
) -> Outcome:
    """What became of the samples from 0 to `published` of each board, as the workers' records have it."""

    def sample(record: dict[str, object]) -> Sample:
        return record["device"], int(str(record["seq"]))

    found = [heard([*one.of("sample"), *one.of("gap")], sample) for one in workers]
    due = {(name, number) for name in names for number in range(published)}
    sums = account(due, found)
    twice = sum(one.delivered.total() for one in found) - sums.where["delivered"]
    return Outcome(
        list(dict.fromkeys(chain(*(worker.errors() for worker in workers)))),
        sums.due,
        sums.where,
        more=f"{more}; {twice} delivered twice",
        wrong=[*wrong, *sums.wrong],
    )
