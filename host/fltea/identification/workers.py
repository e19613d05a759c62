"""Where the work of `fltea identify` is done: in this process, in others on this machine, or by Dask."""

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

T = TypeVar("T")

SAFE_PATH = "PYTHONSAFEPATH"
SMALL = 6_000_000
"""Samples of all axes together, 5 hours of three, up to which processes take long to start."""


class UnfitWorker(FlteaError):
    """One of the workers must be given nothing. That ends all the work: it would fail each task it gets."""


class Workers:
    """What runs tasks; all but `submit` may be left out."""

    @property
    def slots(self) -> int:
        """The number of tasks that are worth handing over at a time."""
        return 1

    def expect(self, samples: int) -> None:
        """Take note that a recording of so many samples, of all its axes, is to be worked on."""

    def submit(self, task: Callable[..., T], *arguments: Any) -> "Future[T]":
        """Begin a task, which may be done by then."""
        raise NotImplementedError

    def renew(self) -> None:
        """Go on after a worker's death has broken all that was under way (`BrokenExecutor`)."""

    def check(self) -> None:
        """Raise an error if the workers are lost; it is called now and then while tasks are awaited.

        Raises:
            FlteaError: they will never be done.
        """

    def close(self) -> None:
        """End at once what is under way."""


class Here(Workers):
    """This process and thread; done when `submit` returns."""

    def submit(self, task: Callable[..., T], *arguments: Any) -> "Future[T]":
        """Do it now."""
        future: Future[T] = Future()
        try:
            future.set_result(task(*arguments))
        except Exception as error:
            future.set_exception(error)
        return future


class Threads(Workers):
    """Threads of this process: nearly all work is native, and processes take long to start."""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._pool = ThreadPoolExecutor(jobs)

    @property
    def slots(self) -> int:
        """One more than threads, so that none has to wait for its next task."""
        return self._jobs + 1

    def submit(self, task: Callable[..., T], *arguments: Any) -> "Future[T]":
        """Begin a task when a thread is free."""
        return self._pool.submit(task, *arguments)

    def close(self) -> None:
        """Begin nothing more, and wait for what is under way: a second or two.

        An interpreter that ended meanwhile would abort in a thread that comes back from native code.
        """
        self._pool.shutdown(cancel_futures=True)


def _reduce(array: "np.memmap[Any, Any]") -> Any:
    """Return how another process of this machine gets a whole file in memory: by its name."""
    if isinstance(array.base, mmap.mmap) and array.filename is not None:
        return np.memmap, (array.filename, array.dtype, "r", array.offset, array.shape)
    return np.array, (np.array(array),)


ForkingPickler.register(np.memmap, _reduce)


@contextlib.contextmanager
def _safe_path() -> Iterator[None]:
    """Let processes that start now look for no modules in the current folder.

    What forks them is started by `python -c`, which would run a random.py of that folder for Python's own.
    Who calls us starts other programs, too, so the setting does not stay.
    """
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        yield
    finally:
        os.environ.pop(SAFE_PATH)
        os.environ.update({} if before is None else {SAFE_PATH: before})


class Processes(Workers):
    """Processes on this machine, copies of one that has loaded all they need and has no threads of ours."""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._context = multiprocessing.get_context("forkserver")
        # It loads while a recording is read here.
        self._context.set_forkserver_preload(["fltea.identification.run"])
        # A terminal sends Ctrl-C to all of us: without this, while it loads, it would end with a traceback.
        ours = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            with _safe_path():
                forkserver.ensure_running()
        finally:
            signal.signal(signal.SIGINT, ours)
        self._pool = self._start()

    @property
    def slots(self) -> int:
        """One more than processes, so that none has to wait for its next task."""
        return self._jobs + 1

    def _start(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self._jobs, self._context, _prepare)

    def submit(self, task: Callable[..., T], *arguments: Any) -> "Future[T]":
        """Begin a task when a process is free."""
        with _safe_path():  # what forks processes is started again here if it has died
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
    """Threads for one small recording, processes for a large one: which it is, is known when it was read."""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._own: Workers = Here()

    @property
    def slots(self) -> int:
        """As many as they have."""
        return self._own.slots

    def expect(self, samples: int) -> None:
        """Begin with those that take less time for so many samples."""
        self._own = Threads(self._jobs) if samples <= SMALL else Processes(self._jobs)

    def submit(self, task: Callable[..., T], *arguments: Any) -> "Future[T]":
        """Hand a task on."""
        return self._own.submit(task, *arguments)

    def renew(self) -> None:
        """Go on after a worker's death."""
        self._own.renew()

    def close(self) -> None:
        """End what is under way."""
        self._own.close()


def _prepare() -> None:
    """Let a new process end at Ctrl-C without a word, and with the program that started it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    parent = multiprocessing.parent_process()

    def follow() -> None:
        if parent is not None:
            parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


def open_local(jobs: int | None, *, recordings: int = 0) -> Workers:
    """Open as many processes as asked for, or as this one may use processors; none for one.

    recordings: that are to be identified; of a single one that is small threads do it.
    """
    wanted = jobs or len(os.sched_getaffinity(0))
    if wanted == 1:
        return Here()
    return BySize(wanted) if recordings == 1 else Processes(wanted)
