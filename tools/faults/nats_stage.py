"""Where faults of the ingest through NATS are played: a server, boards, and two workers."""

import contextlib
import time
from collections.abc import Callable
from pathlib import Path

from tools.fault_script.cut_line import CutLine
from tools.fault_script.program import SHIM, Program, wait_until
from tools.faults.boards import Boards
from tools.faults.sample_books import heard, until_all_again
from tools.nats_server import Server

PARTITIONS, SNAPSHOT_S, KEPT_MB = 4, 2, 24


class Stage:
    """Server, boards and two workers that share them.

    server: one that runs; else the stage has its own. line: between the first worker and the server. clock:
    of the first worker, eight bytes that are added to its Unix time [ns].
    """

    def __init__(self, folder: Path, qos: int = 1, server: Server | None = None) -> None:
        self._stack = contextlib.ExitStack()
        with contextlib.ExitStack() as stack:
            self.server = server or Server(folder, PARTITIONS)
            stack.callback(self.server.kill)
            self.line = CutLine(self.server.port)
            stack.callback(self.line.close)
            self.clock = folder / "clock"
            self.clock.write_bytes(bytes(8))
            self.workers = [self._worker(stack, "first", f"nats://127.0.0.1:{self.line.port}")]
            self.boards = Boards(self.server.mqtt_port, qos)
            stack.callback(self.boards.close)
            self.workers[0].wait_for(self.server.has_stream, "the stream")
            self.boards.start()
            self.until(lambda: heard(self.workers[0]) == self.names, "the first worker")
            self.workers.append(self._worker(stack, "second", self.server.url))
            self.until(lambda: bool(heard(self.workers[1])), "the second worker's share")
            time.sleep(2 * SNAPSHOT_S + 1)  # snapshots
            self._stack = stack.pop_all()

    def _worker(self, stack: contextlib.ExitStack, name: str, url: str) -> Program:
        chosen = {
            "name": name,
            "live.on": "false",
            "ingest.partitions": PARTITIONS,
            "ingest.snapshot_s": SNAPSHOT_S,
            "ingest.keep_mb": KEPT_MB,
            "ingest.snapshots_mb": KEPT_MB,
        }
        flags = [word for key, value in chosen.items() for word in ("--set", f"{key}={value}")]
        clock = {"FLTEA_SHIM_CLOCK": str(self.clock)} if name == "first" else {}
        made = Program(("-s", url, "--format", "ndjson", *flags), module=SHIM, environment=clock)
        stack.callback(made.kill)
        return made

    @property
    def names(self) -> set[str]:
        """Of the boards."""
        return set(self.boards.names)

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Wait, but not for ever."""
        wait_until(condition, what)

    def until_all_again(self) -> None:
        """Wait until samples of all boards arrive that are not published yet."""
        until_all_again(self.boards, self.workers)

    def close(self) -> None:
        """End all."""
        self._stack.close()
