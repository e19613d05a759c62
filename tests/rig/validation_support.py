"""A plan small enough for a test, and workers who do it backwards."""

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from fltea.identification.workers import Here

from tools.validation.evaluate.cases import Case
from tools.validation.evaluate.run import Plan

STRONG = Case(0.8, -1.0, 30.0)
TINY = Plan(
    seeds=3,
    fit_seeds=4,
    coverage_series=100,
    grid=(Case(), STRONG),
    lengths=(1_000, 1_500),
    changed_on=(Case(), STRONG),
    changed_lengths=(2_100,),
    fitted_samples=1_000,
    refereed=(),
    shifts=(),
    coverage=(),
    mixed=("relaxation",),
    claimed=(1_000,),
)


class Backwards(Here):
    """Three tasks at a time, of which those begun last are done first."""

    slots = 4

    def __init__(self) -> None:
        self._tasks: list[tuple[Future[Any], Callable[..., Any], tuple[Any, ...]]] = []

    def submit(self, task: Callable[..., Any], *arguments: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self._tasks.append((future, task, arguments))
        threading.Timer(0.02, self._work).start()
        return future

    def _work(self) -> None:
        future, task, arguments = self._tasks.pop()
        future.set_result(task(*arguments))
