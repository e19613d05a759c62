"""Where faults of the ingest are played: a NATS server, boards that publish by MQTT, and workers."""

import asyncio
import contextlib
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path

import nats
from nats.js.errors import NotFoundError
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion

from tools.fault_script.program import PATIENCE_S, Program, wait_until
from tools.fault_script.stage import Skip
from tools.frames_load import Sensors

DEVICES, PARTITIONS, SNAPSHOT_S = 8, 4, 2
EVERY_S = 0.5
"""From message to message of a board. Each holds a second of samples: twice as fast as real boards."""


def free_port() -> int:
    """A port of this machine that nobody has."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Server:
    """nats-server with JetStream, the mapping that makes partitions, and MQTT."""

    def __init__(self, folder: Path, partitions: int = PARTITIONS) -> None:
        program = shutil.which("nats-server", path="/usr/sbin:/usr/bin:/usr/local/bin")
        if program is None:
            raise Skip("nats-server is not installed: sudo apt-get install nats-server")
        self.port, self.mqtt_port = free_port(), free_port()
        settings = folder / "nats.conf"
        mapping = f"fltea.frames.{{{{partition({partitions},1)}}}}.{{{{wildcard(1)}}}}"
        settings.write_text(
            f"listen: 127.0.0.1:{self.port}\nserver_name: one\nmax_payload: 2MB\n"
            f'jetstream {{ store_dir: "{folder}/js" }}\nmqtt {{ listen: 127.0.0.1:{self.mqtt_port} }}\n'
            f'mappings {{ "fltea.*.frames": "{mapping}" }}\n'
        )
        self._command = [program, "-c", str(settings)]
        self.url = f"nats://127.0.0.1:{self.port}"
        self.start()

    def start(self) -> None:
        """Start it, or start it again."""
        self.process = subprocess.Popen(self._command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wait_until(self._listens, "nats-server")

    def _listens(self) -> bool:
        for port in (self.port, self.mqtt_port):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) != 0:
                    return False
        return True

    def has_stream(self) -> bool:
        """Whether a worker has made it; what is published before goes nowhere."""

        async def ask() -> bool:
            client = await nats.connect(self.url, allow_reconnect=False)
            try:
                return bool(await client.jetstream().stream_info("FLTEA_FRAMES"))
            except NotFoundError:
                return False
            finally:
                await client.close()

        return asyncio.run(ask())

    def kill(self) -> None:
        """By `kill -9`."""
        self.process.kill()
        self.process.wait(PATIENCE_S)


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
            self.server = Server(folder)
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
