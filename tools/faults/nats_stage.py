"""Where faults of the ingest are played: a NATS server, boards that publish by MQTT, and workers."""

import contextlib
import threading
import time
from collections.abc import Callable
from pathlib import Path

from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion

from tools.fault_script.program import Program, wait_until
from tools.frames_load import Sensors
from tools.nats_server import Server

DEVICES, PARTITIONS, SNAPSHOT_S = 8, 4, 2
EVERY_S = 0.5
"""From message to message of a board. Each holds a second of samples: twice as fast as real boards."""


class Boards:
    """Publish a second of samples each, again and again, from a thread.

    qos: with 1 what is not acknowledged is sent again.
    """

    def __init__(self, port: int, qos: int) -> None:
        self._qos = qos
        self._sensors = Sensors(DEVICES)
        self.names = self._sensors.names
        self.seconds = 0
        self._client = Client(CallbackAPIVersion.VERSION2, "boards", protocol=MQTTProtocolVersion.MQTTv311)
        self._client.reconnect_delay_set(1, 1)
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def start(self) -> None:
        """Begin to publish."""
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.wait(EVERY_S):
            for k, name in enumerate(self.names):
                self._client.publish(
                    f"fltea/{name}/frames", self._sensors.message(k, self.seconds), qos=self._qos
                )
            self.seconds += 1

    def stop(self) -> None:
        """Publish no more; comes back when the server has all that waited."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        with contextlib.suppress(TimeoutError):
            wait_until(lambda: not self._client._out_messages, "acknowledgements")

    def close(self) -> None:
        """Leave."""
        self.stop()
        self._client.disconnect()
        self._client.loop_stop()


class Stage:
    """Server, boards and two workers that share them."""

    def __init__(self, folder: Path, qos: int = 1) -> None:
        self._stack = contextlib.ExitStack()
        with contextlib.ExitStack() as stack:
            self.server = Server(folder, PARTITIONS)
            stack.callback(lambda: self.server.kill())
            self.workers = [self._worker(stack, "first")]
            self.boards = Boards(self.server.mqtt_port, qos)
            stack.callback(self.boards.close)
            self.workers[0].wait_for(self.server.has_stream, "the stream")
            self.boards.start()
            self.until(lambda: self.heard(self.workers[0]) == set(self.boards.names), "the first worker")
            self.workers.append(self._worker(stack, "second"))
            self.until(lambda: bool(self.heard(self.workers[1])), "the second worker's share")
            time.sleep(2 * SNAPSHOT_S + 1)  # snapshots
            self._stack = stack.pop_all()

    def _worker(self, stack: contextlib.ExitStack, name: str) -> Program:
        chosen = {
            "name": name,
            "live.on": "false",
            "ingest.partitions": PARTITIONS,
            "ingest.snapshot_s": SNAPSHOT_S,
        }
        flags = [word for key, value in chosen.items() for word in ("--set", f"{key}={value}")]
        made = Program(("-s", self.server.url, "--format", "ndjson", *flags))
        stack.callback(made.kill)
        return made

    def heard(self, worker: Program) -> set[str]:
        """Whose samples a worker has walked."""
        return {record["device"] for record in worker.of("sample")}

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Wait, but not for ever."""
        wait_until(condition, what)

    def close(self) -> None:
        """End all."""
        self._stack.close()
