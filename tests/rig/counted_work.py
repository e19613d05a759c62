"""Count the work of a function, so that tests need not measure time."""

import sys
import tracemalloc
from collections.abc import Callable
from typing import NamedTuple


class Work(NamedTuple):
    """Work of a function. `calls`: calls of functions, and returns. `made_bytes`: memory that was filled.

    What a library does in one call without memory of Python or numpy is not counted.
    """

    calls: int
    made_bytes: int


def work_of(function: Callable[[], object]) -> Work:
    """Run a function and count its work.

    Between two calls, the memory in use rises to a peak. The sum of these rises is at least what was copied,
    even if each copy replaces the one before.
    """
    calls = made_bytes = before = 0

    def count(*_: object) -> None:
        nonlocal calls, made_bytes, before
        now, peak = tracemalloc.get_traced_memory()
        calls += 1
        made_bytes += peak - before
        before = now
        tracemalloc.reset_peak()

    tracemalloc.start()
    sys.setprofile(count)
    try:
        function()
    finally:
        sys.setprofile(None)
        tracemalloc.stop()
    return Work(calls, made_bytes)
