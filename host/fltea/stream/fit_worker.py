"""Make the refits of all devices of a program in one thread, while other threads process samples."""

import threading
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any, TypeVar

T = TypeVar("T")


class FitWorker:
    """Makes the refits of all devices of a program.

    This class makes a refit in the thread that asks for the result. `FitThread` uses a thread of its own.

    `devices`: number of devices of the program. `slower`: factor by which the time between refits is longer
    than usual because the processor does not keep up. The code that runs many devices sets both numbers.
    """

    def __init__(self, devices: int = 1, slower: float = 1.0) -> None:
        self.devices, self.slower = devices, slower

    def begin(self, work: Callable[[], T]) -> Callable[[], T]:
        """Begin the task `work`.

        The returned function does the work if it is not done yet. It returns the result of `work`, or raises
        its exception.
        """
        return _Work(work).result


class _Work:
    """A task and its result. It replaces concurrent.futures, whose import would delay the start by 5 ms."""

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
    """Does all tasks in one separate thread, in the order in which they were queued.

    If a caller needs the result of a task that has not started yet, the caller's thread does the task itself.
    So a replay uses two processor cores.
    """

    def __init__(self, devices: int = 1) -> None:
        super().__init__(devices)
        self._waiting: SimpleQueue[_Work | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="looks", daemon=True)
        self._lock = threading.Lock()
        self._closed = False

    def begin(self, work: Callable[[], T]) -> Callable[[], T]:
        """Queue `work`, which starts when all work that was queued before is done."""
        part = _Work(work)
        with self._lock:
            if self._thread.ident is None and not self._closed:
                self._thread.start()
        self._waiting.put(part)
        return part.result

    def close(self, timeout_s: float | None) -> bool:
        """Start no more work. Return False if the task that is running does not end within `timeout_s`."""
        with self._lock:
            self._closed = True
            if self._thread.ident is None:
                return True
        self._waiting.put(None)
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (part := self._waiting.get()) is not None and not self._closed:
            part.run()
