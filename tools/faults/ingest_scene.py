"""Boards that publish by MQTT, and the programs that process their samples.

The programs are two workers behind a NATS server, or one program behind an MQTT broker.
"""

import contextlib
import threading
import time
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import chain

from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion

from tools.faults.account import Sample, account, heard, wrong_ends
from tools.faults.nats_server import NatsServer
from tools.faults.outcome import Outcome
from tools.faults.program import Program, wait_until
from tools.faults.server import Broker
from tools.faults.stage import Stage
from tools.frames_load import RATE_HZ, Sensors

DEVICES = 8
EVERY_S = 0.5
"""Time between two messages of a board [s]. Each message has the samples of one second. So boards send two
seconds of samples in each second, twice as many as real boards.
"""
PARTITIONS, SNAPSHOT_S, KEPT_MB = 4, 2, 24
OF_NATS = {
    "ingest.partitions": PARTITIONS,
    "ingest.snapshot_s": SNAPSHOT_S,
    "ingest.keep_mb": KEPT_MB,
    "ingest.snapshots_mb": KEPT_MB,
}


class Boards:
    """Boards that repeatedly publish messages with a second of samples.

    All boards publish from one thread and over one connection.

    `qos`: with 1, messages that were not acknowledged are sent again. Messages are then sent one at a time,
    because after an outage the MQTT library would change the order of several unacknowledged messages.
    `seconds`: number of seconds that each board has published.
    """

    def __init__(self, port: int, qos: int) -> None:
        self._qos = qos
        self._sensors = Sensors(DEVICES)
        self.names = self._sensors.names
        self.seconds = 0
        self._waiting: deque[tuple[str, bytes]] = deque()
        self._lock, self._sending = threading.RLock(), False
        self._client = Client(CallbackAPIVersion.VERSION2, "boards", protocol=MQTTProtocolVersion.MQTTv311)
        self._client.on_publish = lambda *_: self._next(acknowledged=True)
        self._client.reconnect_delay_set(1, 1)
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    @property
    def samples(self) -> int:
        """Number of samples that each board has published."""
        return self.seconds * RATE_HZ

    def _run(self) -> None:
        while not self._stop.wait(EVERY_S):
            for k, name in enumerate(self.names):
                self._waiting.append((f"fltea/{name}/frames", self._sensors.message(k, self.seconds)))
                self._next()
            self.seconds += 1

    def _next(self, *, acknowledged: bool = False) -> None:
        """Send messages that wait to be sent.

        With QoS 1, send one message, and only after the server has acknowledged the message before. With QoS
        0, send all: the MQTT library keeps no sent messages then, so it cannot change their order.
        """
        with self._lock:
            self._sending = self._sending and self._qos > 0 and not acknowledged
            while self._waiting and not self._sending:
                self._client.publish(*self._waiting.popleft(), qos=self._qos)
                self._sending = self._qos > 0

    def stop(self) -> None:
        """Stop publishing; return when the server has all waiting messages."""
        self._stop.set()
        self._thread.join()
        with contextlib.suppress(TimeoutError):
            wait_until(lambda: not (self._waiting or self._sending), "acknowledgements")

    def close(self) -> None:
        """Stop publishing and disconnect."""
        self.stop()
        self._client.disconnect()
        self._client.loop_stop()


class Scene:
    """A server, boards that publish to it, and the programs that receive from it.

    The programs are one program for an MQTT broker, or two workers for a NATS server.

    `line`: the connection between the server and the first program, which can be cut. Only the first
    program's clock is shifted by `Stage.set_clock`.
    """

    def __init__(self, stage: Stage, server: Broker | NatsServer, qos: int = 1) -> None:
        self._stage, self.server = stage, server
        stage.callback(server.kill)
        self.line = stage.line(server.port)
        self._shared = OF_NATS if isinstance(server, NatsServer) else {}
        first = self._worker("first", server.url.replace(str(server.port), str(self.line.port)))
        self.workers = [first]
        first.wait_for(server.is_heard, "that it listens")
        self.boards = stage.closing(Boards(server.mqtt_port, qos))
        self.until_all_by(first)
        if self._shared:
            self.workers.append(self._worker("second", server.url))
            wait_until(lambda: bool(boards_of(self.workers[1])), "the second worker's share")
            time.sleep(2 * SNAPSHOT_S + 1)  # time for the workers to write snapshots

    def _worker(self, name: str, url: str) -> Program:
        chosen = {"name": name, "live.on": "false", **self._shared}
        flags = [word for key, value in chosen.items() for word in ("--set", f"{key}={value}")]
        how = {"clock": self._stage.clock} if name == "first" else {}
        return self._stage.daemon("-s", url, "--format", "ndjson", *flags, **how)

    def until_all_by(self, *workers: Program, since: int = 0) -> None:
        """Wait until, for each board, at least one of these workers has processed a new sample.

        New samples are those whose numbers are at least `since`.
        """
        names = set(self.boards.names)
        wait_until(
            lambda: set().union(*(boards_of(one, since) for one in workers)) == names,
            "samples of all sensors",
        )

    def until_all_again(self) -> None:
        """Wait until the programs together have processed new samples of all boards."""
        self.until_all_by(*self.workers, since=self.boards.samples)

    def outcome(self, more: str, wrong: Sequence[str] = ()) -> Outcome:
        """Let all published samples arrive, end the workers, and return what became of all samples."""
        time.sleep(1.0)
        boards = self.boards
        boards.stop()
        living = [worker for worker in self.workers if worker.code is None]
        self.until_all_by(*living, since=boards.samples - 1)
        # End all workers at the same time. Otherwise the last worker takes over the boards of the others.
        with ThreadPoolExecutor() as pool:
            list(pool.map(lambda worker: worker.end(), living))
        return samples_of(boards.names, boards.samples, self.workers, more, wrong)


def boards_of(worker: Program, since: int = 0) -> set[str]:
    """Return the names of boards of which a worker has processed a sample with a number from `since` on."""
    return {device for device, newest in worker.newest.copy().items() if newest >= since}


def samples_of(
    names: Sequence[str],
    published: int,
    workers: Sequence[Program],
    more: str = "",
    wrong: Sequence[str] = (),
) -> Outcome:
    """Return how many of each board's first `published` samples were delivered, counted as lost, or neither.

    The numbers come from the records that the workers wrote.
    """

    def sample(record: dict[str, object]) -> Sample:
        return record["device"], int(str(record["seq"]))

    found = [heard(one.records, sample) for one in workers]
    sums = account({(name, number) for name in names for number in range(published)}, found)
    twice = sum(one.delivered.total() for one in found) - sums.where["delivered"]
    return Outcome(
        list(dict.fromkeys(chain(*(worker.errors() for worker in workers)))),
        sums.due,
        sums.where,
        more=f"{more}; {twice} delivered twice",
        wrong=[*wrong, *chain(*map(wrong_ends, workers)), *sums.wrong],
    )
