"""Count the work of a function, so that tests need not measure time."""

import sys
import tracemalloc
from collections.abc import Callable
from typing import NamedTuple


class Work(NamedTuple):
    """Work of a function. `calls`: number of calls and returns. `made_bytes`: memory that was filled [bytes].

    What a library does within one call is counted only if it takes memory from Python or numpy.
    """

    calls: int
    made_bytes: int


def work_of(function: Callable[[], object]) -> Work:
    """Run a function and count its work.

    The memory in use is read at each call and return. Between two readings it rises to a peak. `made_bytes`
    is the sum of these rises, so each copy of data counts, even if it replaces an earlier copy.
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
