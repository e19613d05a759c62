"""The host's clock: monotonic, and going on while the machine sleeps where the system offers that."""

import time

SECOND_NS = 10**9
"""Statistics go out with each new second; what groups samples must not reach across its end."""

END_OF_DATES_NS = 4_102_444_800 * SECOND_NS
"""The year 2100 as Unix time: a clock beyond it is not set, and recordings hold dates up to 2116 only."""

_CLOCK = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)


def host_ns() -> int:
    """Return nanoseconds since some fixed moment; no change of the date moves it."""
    return time.clock_gettime_ns(_CLOCK)


def unix_offset_ns() -> int:
    """Return what to add to `host_ns` to get Unix time, as of now; 0 if the machine's date cannot be.

    The threads that read ports do the same (`stamp_now` in native/port_reader.cpp).
    """
    unix_ns = time.time_ns()
    return unix_ns - host_ns() if 0 <= unix_ns < END_OF_DATES_NS else 0


def unix_ns() -> int:
    """Return Unix time as of now; the time since the machine's start if its date cannot be."""
    return host_ns() + unix_offset_ns()


def wrong_date() -> str:
    """Return what is wrong with the machine's date, as text for a person; empty if it can be."""
    unix_s = time.time_ns() // SECOND_NS
    if 0 <= unix_s < END_OF_DATES_NS // SECOND_NS:
        return ""
    return (
        f"the machine's clock says the year {1970 + unix_s // 31_556_952}, which is not believed: times "
        "count from the machine's start, in the year 1970, until it is set. Has it a battery for its "
        "clock, and does it reach a time server?"
    )
