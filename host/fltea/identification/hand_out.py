"""Hand tasks to workers, and collect their results even if worker processes die.

When a process dies, it is not known which task caused it. So all tasks that were running are tried again, one
at a time. If a process dies again, the task that it was running is the cause.
"""

from collections import deque
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from fltea.identification.workers import UnfitWorker, Workers
from fltea.records.errors import FlteaError

CHECK_S = 5.0
"""Time between two checks that the workers are still alive [s]."""


@dataclass
class Task:
    """A function to call, with its arguments."""

    do: Any
    arguments: tuple[Any, ...]
    again: bool = field(default=False, kw_only=True)
    """Whether a process has died while this task was running, so that the task is tried again."""


T = TypeVar("T", bound=Task)


class HandOut(Generic[T]):
    """Keep the workers busy with tasks until there are no more."""

    def __init__(self, workers: Workers) -> None:
        self._workers = workers
        self._alone: deque[T] = deque()
        """Tasks that are tried one at a time, before all others."""
        self._pending: dict[Future[Any], T] = {}

    def next_task(self) -> T | None:
        """Return the next task to do; None if no task is ready. Tasks to be tried alone come first."""
        raise NotImplementedError

    def settle(self, task: T, result: Any) -> None:
        """Handle the result of a task, or the exception that it ended with."""
        raise NotImplementedError

    def submit(self, task: T) -> "Future[Any]":
        """Submit a task to the workers."""
        return self._workers.submit(task.do, *task.arguments)

    def work(self) -> None:
        """Work until no task is left.

        Raises:
            FlteaError: the workers are gone, or one of them is unfit.
        """
        while self._fill() or self._pending:
            done, _ = wait(self._pending, CHECK_S, FIRST_COMPLETED)
            if not done:
                self._workers.check()
            if [future for future in done if not self._take(future)]:
                self._after_death()

    def _fill(self) -> bool:
        """Submit tasks until the workers have enough of them. Returns False if there are no more tasks."""
        while len(self._pending) < self._room():
            task = self.next_task()
            if task is None:
                return False
            try:
                self._pending[self.submit(task)] = task
            except BrokenExecutor:  # a process died since the last check
                self._alone.appendleft(task)
                self._after_death()
        return True

    def _room(self) -> int:
        alone = self._alone or any(task.again for task in self._pending.values())
        return 1 if alone else self._workers.slots

    def _take(self, future: "Future[Any]") -> bool:
        """Handle the result of a task. Returns False if there is no result because a process died."""
        try:
            result = future.result()
        except BrokenExecutor:
            return False
        except UnfitWorker:
            raise
        except CancelledError as error:  # Dask raises this if its scheduler is lost
            self._workers.check()
            result = error
        except Exception as error:
            result = error
        self.settle(self._pending.pop(future), result)
        return True

    def _after_death(self) -> None:
        tasks = list(self._pending.values())
        self._pending.clear()
        if len(tasks) == 1 and tasks[0].again:
            self.settle(tasks[0], FlteaError("the process that worked on it was killed; did memory run out?"))
        else:
            for task in tasks:
                task.again = True
            self._alone.extend(tasks)
        self._workers.renew()
