"""Add fits to the stored history of many devices (a fleet), and let the history write and delete rows."""

import math
from pathlib import Path
from typing import Any

from fltea.fleet.databases import Sqlite
from fltea.fleet.figures import Figure
from fltea.fleet.history import TABLES, History
from fltea.fleet.roll import Axis


def opened(path: Path | None, every_s: float) -> History:
    return History(Sqlite(path, TABLES), every_s)


def axis(verdict: str = "white", value: float = 1.0) -> Axis:
    return Axis(verdict, "text", "deg/s", 100, {"N": Figure(value, value - 0.1, value + 0.1)}, 0.0)


def add(history: History, *unix_s: float, device: str = "a") -> None:
    """Add a fit of a device at each of these times [Unix s]."""
    for second in unix_s:
        history.add(second, device, {"gyro_x": axis()})


def times_of(history: History, device: str) -> list[float]:
    return [row["unix_s"] for row in rows_of(history, device)]


def write_out(history: History, before_unix_s: float = -math.inf) -> int:
    """Let the history write its rows and delete those before a time; return how many it deleted."""
    before = history.pruned
    history.work(before_unix_s)
    history.settle()
    return history.pruned - before


def rows_of(history: History, device: str, most: int = 2000) -> list[dict[str, Any]]:
    return history.of_device(device, most).result()
