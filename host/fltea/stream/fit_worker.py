"""What is done beside the walks: the looks at all axes of all devices of a program, in one thread."""

import threading
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any, TypeVar

T = TypeVar("T")


class FitWorker:
    """What the looks of a program share; this one makes each where its result is asked for.

    devices: how many there are. slower: how many times rarer than usual looks come, for all alike, because
    the processor does not keep up. Who runs many devices changes both.
    """

    def __init__(self, devices: int = 1, slower: float = 1.0) -> None:
        self.devices, self.slower = devices, slower

    def begin(self, work: Callable[[], T]) -> Callable[[], T]:
        """Begin some work; what this returns gives its result, and raises what it raised."""
        return _Work(work).result


class _Work:
    """Some work, and what came of it; concurrent.futures would cost each start of the program 5 ms."""

    def __init__(self, work: Callable[[], Any]) -> None:
        self._work, self._done, self._begun = work, threading.Event(), threading.Lock()
        self._found: Any = None
        self._error: BaseException | None = None

    def run(self) -> None:
        if not self._begun.acquire(blocking=False):
            return
        try:
            self._found = self._work()
        except BaseException as error:
            self._error = error
        self._done.set()

    def result(self) -> Any:
        self.run()
        self._done.wait()
        if self._error is not None:
            raise self._error
        return self._found


class FitThread(FitWorker):
    """Does the work of all in a thread of its own, in the order in which it was begun, until it is closed.

    Whoever waits for what nobody has begun does it himself, so that a replay has two cores for its looks.
    """

    def __init__(self, devices: int = 1) -> None:
        super().__init__(devices)
        self._waiting: SimpleQueue[_Work | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="looks", daemon=True)
        self._lock = threading.Lock()
        self._closed = False

    def begin(self, work: Callable[[], T]) -> Callable[[], T]:
        """Begin some work as soon as what was begun before is done."""
        one = _Work(work)
        with self._lock:
            if self._thread.ident is None and not self._closed:
                self._thread.start()
        self._waiting.put(one)
        return one.result

    def close(self, timeout_s: float | None) -> bool:
        """Begin nothing more; False if what is being done did not end in time."""
        with self._lock:
            self._closed = True
            if self._thread.ident is None:
                return True
        self._waiting.put(None)
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (one := self._waiting.get()) is not None and not self._closed:
            one.run()
