"""Waits until a sample is due, for sources that produce samples themselves."""

import time
from collections.abc import Callable

from fltea.records.clock import host_ns

SLICE_S = 0.1


def sleep_until(due_ns: int, closed: Callable[[], bool]) -> None:
    """Sleep until the host's clock reads `due_ns` or the source is closed.

    The function sleeps for at most `SLICE_S` at a time, and then checks whether the source was closed. A
    single long sleep could not be ended, since Python continues to sleep after a signal.
    """
    while not closed() and (left_ns := due_ns - host_ns()) > 0:
        time.sleep(min(left_ns * 1e-9, SLICE_S))
