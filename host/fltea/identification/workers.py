"""Run the tasks of `fltea identify` in this process, in other processes of this machine, or by Dask."""

import contextlib
import mmap
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import forkserver
from multiprocessing.reduction import ForkingPickler
from typing import Any, TypeVar

import numpy as np

from fltea.records.errors import FlteaError
from fltea.records.temporary import process_folder

T = TypeVar("T")

SAFE_PATH = "PYTHONSAFEPATH"
SMALL = 6_000_000
"""For a recording of at most this many samples, all axes together, starting processes would take longer than
the processes save.

Three axes at 100 Hz have this number of samples after 5 hours.
"""

LONGEST_FOLDER = 107 - len("/listener-abcdefgh")
"""Longest path of the folder of the fork server's socket [bytes]. Linux allows 107 bytes for the path of a
socket.
"""


class UnfitWorker(FlteaError):
    """Raised if a worker must not get any task, because it would fail each one.

    The error ends the run of `fltea identify`.
    """


class Workers:
    """Run tasks. A subclass has to implement only `submit`."""

    @property
    def slots(self) -> int:
        """Number of tasks that are worth submitting at a time."""
        return 1

    def expect(self, samples: int) -> None:
        """Prepare for a recording with `samples` samples, summed over its axes."""

    def submit(self, task: Callable[..., T], *arguments: Any) -> "Future[T]":
        """Start a task. It may already be done when this returns."""
        raise NotImplementedError

    def renew(self) -> None:
        """Recover after all running tasks failed because a worker died (`BrokenExecutor`)."""

    def check(self) -> None:
        """Check that the workers are alive. The caller does this now and then while it waits for results.

        Raises:
            FlteaError: the workers are lost, so that the tasks will never be done.
        """

    def close(self) -> None:
        """Stop the running tasks at once."""


class Here(Workers):
    """Run each task in this process and thread, before `submit` returns."""

    def submit(self, task: Callable[..., T], *arguments: Any) -> "Future[T]":
        """Run the task now."""
        future: Future[T] = Future()
        try:
            future.set_result(task(*arguments))
        except Exception as error:
            future.set_exception(error)
        return future


class Threads(Workers):
    """Run tasks in threads of this process.

    Nearly all work is native code, which threads do in parallel, and processes would start slowly.
    """

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._pool = ThreadPoolExecutor(jobs)

    @property
    def slots(self) -> int:
        """One more than the number of threads, so that no thread waits for its next task."""
        return self._jobs + 1

    def submit(self, task: Callable[..., T], *arguments: Any) -> "Future[T]":
        """Start a task as soon as a thread is free."""
        return self._pool.submit(task, *arguments)

    def close(self) -> None:
        """Start no further task, and wait for the running ones, which takes a second or two.

        If the interpreter ended before the running tasks, it would abort when a thread returns from native
        code.
        """
        self._pool.shutdown(cancel_futures=True)


def _reduce(array: "np.memmap[Any, Any]") -> Any:
    """Pickle a memory-mapped array as the name of its file, for other processes of this machine."""
    if isinstance(array.base, mmap.mmap) and array.filename is not None:
        return np.memmap, (array.filename, array.dtype, "r", array.offset, array.shape)
    return np.array, (np.array(array),)


ForkingPickler.register(np.memmap, _reduce)


@contextlib.contextmanager
def _safe_path() -> Iterator[None]:
    """Keep processes that start now from importing modules in the current folder.

    The fork server is started by `python -c`, which would import a random.py of that folder in place of
    Python's own. The environment variable that prevents this is reset afterwards, since our caller starts
    other programs, too.
    """
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        yield
    finally:
        os.environ.pop(SAFE_PATH)
        os.environ.update({} if before is None else {SAFE_PATH: before})


@contextlib.contextmanager
def _signals_wait() -> Iterator[None]:
    """Let SIGINT and SIGTERM wait until the end of the block, and then be handled as usual.

    If a signal ended the program while a worker process starts, nobody would know that process and end it.
    """
    came: list[int] = []
    before: dict[signal.Signals, Any] = {}
    try:
        if threading.current_thread() is threading.main_thread():  # signals are handled there alone
            for number in (signal.SIGINT, signal.SIGTERM):
                if signal.getsignal(number) not in (None, signal.SIG_IGN):
                    before[number] = signal.signal(number, lambda number, _: came.append(number))
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])


def _keep_socket_in_our_folder() -> None:
    """Keep the fork server's socket in our folder, which the next run removes if this process is killed.

    If the path of our folder is too long for a socket, Python keeps the socket in a folder of its own.
    """
    folder, config = process_folder(), multiprocessing.current_process()._config  # type: ignore[attr-defined]
    if len(os.fsencode(folder)) <= LONGEST_FOLDER:
        config.setdefault("tempdir", str(folder))


class Processes(Workers):
    """Run tasks in processes on this machine.

    They are forked from a server process that has already loaded all modules.
    """

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._context = multiprocessing.get_context("forkserver")
        # The server process loads modules while this process reads a recording.
        self._context.set_forkserver_preload(["fltea.identification.run"])
        _keep_socket_in_our_folder()
        # Ctrl-C reaches all processes of the terminal. It is ignored here, since it would end the server with
        # a traceback while it loads modules.
        ours = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            with _safe_path():
                forkserver.ensure_running()
        finally:
            signal.signal(signal.SIGINT, ours)
        self._pool = self._start()

    @property
    def slots(self) -> int:
        """One more than the number of processes, so that no process waits for its next task."""
        return self._jobs + 1

    def _start(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self._jobs, self._context, _prepare)

    def submit(self, task: Callable[..., T], *arguments: Any) -> "Future[T]":
        """Start a task as soon as a process is free."""
        with _signals_wait(), _safe_path():  # if the fork server has died, it is restarted here
            return self._pool.submit(task, *arguments)

    def renew(self) -> None:
        """Start new processes in place of the old ones."""
        self.close()
        self._pool = self._start()

    def close(self) -> None:
        """End the processes."""
        processes = list((self._pool._processes or {}).values())
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()
        for process in processes:
            process.join()


class BySize(Workers):
    """Use threads for one small recording, and processes for a large one, once its size is known."""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._own: Workers = Here()

    @property
    def slots(self) -> int:
        """Number of tasks that are worth submitting at a time to the chosen workers."""
        return self._own.slots

    def expect(self, samples: int) -> None:
        """Choose the workers that take less time for a recording with `samples` samples."""
        self._own = Threads(self._jobs) if samples <= SMALL else Processes(self._jobs)

    def submit(self, task: Callable[..., T], *arguments: Any) -> "Future[T]":
        """Pass a task to the chosen workers."""
        return self._own.submit(task, *arguments)

    def renew(self) -> None:
        """Recover after the death of a worker."""
        self._own.renew()

    def close(self) -> None:
        """Stop the running tasks."""
        self._own.close()


def _prepare() -> None:
    """Prepare a new process: it ends silently at Ctrl-C, and it ends if its parent ends."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    parent = multiprocessing.parent_process()

    def follow() -> None:
        if parent is not None:
            parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


def open_local(jobs: int | None, *, recordings: int = 0) -> Workers:
    """Open workers for the tasks of `fltea identify`.

    `jobs`: number of processes; None: one for each processor that this process may use.

    If the number of processes is one, tasks are done in this process.

    `recordings`: number of recordings to identify. A single small recording is analysed by threads.
    """
    wanted = jobs or len(os.sched_getaffinity(0))
    if wanted == 1:
        return Here()
    return BySize(wanted) if recordings == 1 else Processes(wanted)
