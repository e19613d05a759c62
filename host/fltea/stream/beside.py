"""What is done beside the walks: the looks at all axes of all devices of a program, in other threads."""

import threading
import time
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any, TypeVar

T = TypeVar("T")


class Beside:
    """What the looks of a program share; this one makes each where its result is asked for.

    devices: how many there are. slower: how many times rarer than usual looks come, for all alike, because
    the processor does not keep up. Who runs many devices changes both.
    """

    def __init__(self, devices: int = 1, slower: float = 1.0) -> None:
        self.devices, self.slower = devices, slower

    def begin(self, work: Callable[[], T]) -> Callable[[], T]:
        """Begin some work; what this returns gives its result, and raises what it raised."""
        return work


class _Work:
    """Some work, and what came of it; concurrent.futures would cost each start of the program 5 ms."""

    def __init__(self, work: Callable[[], Any]) -> None:
        self._work, self._done = work, threading.Event()
        self._found: Any = None
        self._error: BaseException | None = None

    def run(self) -> None:
        try:
            self._found = self._work()
        except BaseException as error:
            self._error = error
        self._done.set()

    def result(self) -> Any:
        self._done.wait()
        if self._error is not None:
            raise self._error
        return self._found


class BesideThreads(Beside):
    """Does the work of all in so many threads, in the order in which it was begun, until it is closed."""

    def __init__(self, devices: int = 1, threads: int = 1) -> None:
        super().__init__(devices)
        self._waiting: SimpleQueue[_Work | None] = SimpleQueue()
        self._threads = [
            threading.Thread(target=self._run, name=f"looks {k}", daemon=True) for k in range(threads)
        ]
        self._lock = threading.Lock()
        self._begun = self._closed = False

    def begin(self, work: Callable[[], T]) -> Callable[[], T]:
        """Begin some work as soon as a thread has done what was begun before."""
        one = _Work(work)
        with self._lock:
            if not (self._begun or self._closed):
                self._begun = True
                for thread in self._threads:
                    thread.start()
        self._waiting.put(one)
        return one.result

    def close(self, timeout_s: float | None) -> bool:
        """Begin nothing more; False if what is being done did not end in time."""
        with self._lock:
            self._closed = True
            if not self._begun:
                return True
        until_s = None if timeout_s is None else time.monotonic() + timeout_s
        for _ in self._threads:
            self._waiting.put(None)
        for thread in self._threads:
            thread.join(None if until_s is None else max(0.0, until_s - time.monotonic()))
        return not any(thread.is_alive() for thread in self._threads)

    def _run(self) -> None:
        while (one := self._waiting.get()) is not None and not self._closed:
            one.run()
