"""Faults of the NATS server that two workers share: killed, away, its store full, its disk full."""

import contextlib
import time
from collections.abc import Callable
from pathlib import Path

from tools.faults.nats_stage import PARTITIONS, Stage
from tools.faults.row import Row
from tools.faults.sample_books import row
from tools.faults.small_server import SmallServer

AWAY_S = 8.0
"""Longer than a lease."""

SERVER_AWAY = f"NATS server away for {AWAY_S:g} s"
STORE_FULL = f"NATS server's store at its limit for {AWAY_S:g} s"


def server_restarted(folder: Path) -> Row:
    """Killed, and started at once."""
    return _server_killed(folder, 0.0, "NATS server killed (`kill -9`), started again at once")


def server_away(folder: Path) -> Row:
    """Killed, and started after longer than a lease."""
    return _server_killed(folder, AWAY_S, SERVER_AWAY)


def server_away_boards_keep_nothing(folder: Path) -> Row:
    """The same with boards that publish once and forget (QoS 0)."""
    return _server_killed(folder, AWAY_S, f"{SERVER_AWAY}, boards send with QoS 0", qos=0)


def store_full(folder: Path) -> Row:
    """A stream of somebody else fills the server's store up to its limit; it is deleted."""
    return _full(folder, STORE_FULL, SmallServer.fill_store, SmallServer.empty_store)


def store_full_boards_keep_nothing(folder: Path) -> Row:
    """The same with boards that publish once and forget (QoS 0)."""
    name = f"{STORE_FULL}, boards send with QoS 0"
    return _full(folder, name, SmallServer.fill_store, SmallServer.empty_store, qos=0)


def disk_full(folder: Path) -> Row:
    """Files of somebody else fill the server's disk; they are deleted, and the server is started again."""

    def room(server: SmallServer) -> None:
        server.disk.free()
        server.kill()
        server.start()

    return _full(
        folder,
        f"NATS server's disk full for {AWAY_S:g} s; room again, and the server started again",
        lambda server: server.disk.fill(),
        room,
    )


def _server_killed(folder: Path, away_s: float, name: str, qos: int = 1) -> Row:
    with contextlib.closing(Stage(folder, qos)) as stage:
        stage.server.kill()
        time.sleep(away_s)
        stage.server.start()
        return _row_when_back(stage, name)


def _full(
    folder: Path,
    name: str,
    fill: Callable[[SmallServer], None],
    free: Callable[[SmallServer], None],
    qos: int = 1,
) -> Row:
    with (
        contextlib.closing(SmallServer(folder, PARTITIONS)) as server,
        contextlib.closing(Stage(folder, qos, server)) as stage,
    ):
        fill(server)
        stage.until(lambda: all("nats_lost" in worker.errors() for worker in stage.workers), "word of it")
        time.sleep(AWAY_S)
        free(server)
        return _row_when_back(stage, name)


def _row_when_back(stage: Stage, name: str) -> Row:
    back_s = time.monotonic()
    stage.until_all_again()
    again_s = time.monotonic() - back_s
    told = max(worker.errors().count("nats_lost") for worker in stage.workers)
    more = (
        f"samples of all sensors again {again_s:.0f} s after it was back; `nats_lost` {told} times a worker"
    )
    return row(name, stage.boards, stage.workers, more)


CASES = (
    server_restarted,
    server_away,
    server_away_boards_keep_nothing,
    store_full,
    store_full_boards_keep_nothing,
    disk_full,
)
