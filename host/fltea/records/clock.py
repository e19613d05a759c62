"""The host's clock: monotonic, and going on while the machine sleeps where the system offers that."""

import time

SECOND_NS = 10**9
"""Statistics go out with each new second; what groups samples must not reach across its end."""

_CLOCK = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)


def host_ns() -> int:
    """Return nanoseconds since some fixed moment; no change of the date moves it."""
    return time.clock_gettime_ns(_CLOCK)


def unix_offset_ns() -> int:
    """Return what to add to `host_ns` to get Unix time, as of now."""
    return time.time_ns() - host_ns()
