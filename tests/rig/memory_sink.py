"""An output that keeps its records in memory, for the tests of outputs, of the hub and of many devices."""

import threading
from collections.abc import Callable

from fltea.records.ports import Departed, Item, Sink

from tools.faults.program import PATIENCE_S


class Memory(Sink):
    """A sink that keeps the records that it receives. A test can make its writing block or fail."""

    def __init__(self, name: str = "memory", capacity: int = 10_000) -> None:
        self.name = name
        self.capacity = capacity  # type: ignore[misc]
        self.items: list[Item] = []
        self.overflows: list[tuple[int, int]] = []
        self.go = threading.Event()
        self.go.set()
        self.entered = threading.Event()
        self.fail: Callable[[], Exception] | None = None
        self.gone: list[Departed] = []
        self.flushes = 0
        self.closed = False

    def write(self, item: Item) -> None:
        self.entered.set()
        assert self.go.wait(PATIENCE_S)
        if self.fail is not None:
            raise self.fail()
        self.items.append(item)

    def flush(self) -> None:
        self.flushes += 1

    def on_overflow(self, count: int) -> None:
        self.overflows.append((len(self.items), count))

    def depart(self, departed: Departed) -> None:
        self.gone.append(departed)

    def close(self) -> None:
        self.closed = True

    def held(self) -> "Memory":
        self.go.clear()
        return self
