"""Read this computer's clocks.

The monotonic clock counts on while the computer sleeps, if the system offers such a clock.
"""

import time

SECOND_NS = 10**9
"""One second [ns]. Statistics are published at the beginning of each second, and never within a block of
samples. So each block of samples ends at the latest when a second ends.
"""

END_OF_DATES_NS = 4_102_444_800 * SECOND_NS
"""The year 2100 as Unix time [ns]. A later date is taken as a sign that the machine's clock is not set.
Recordings cannot store dates after 2116, so some limit is needed.
"""

_CLOCK = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)


def host_ns() -> int:
    """Return the nanoseconds since an arbitrary fixed moment. Setting the date does not change this clock."""
    return time.clock_gettime_ns(_CLOCK)


def unix_offset_ns() -> int:
    """Return the current offset from `host_ns` to Unix time; 0 if the machine's date is impossible.

    The threads that read ports compute the same offset (`stamp_now` in native/port_reader.cpp).
    """
    unix_ns = time.time_ns()
    return unix_ns - host_ns() if _is_possible(unix_ns) else 0


def unix_ns() -> int:
    """Return the current Unix time [ns].

    If the machine's date is impossible, return the monotonic time `host_ns`.
    """
    return host_ns() + unix_offset_ns()


def _is_possible(unix_ns: int) -> bool:
    """Return whether a Unix time is between 1970 and `END_OF_DATES_NS`."""
    return 0 <= unix_ns < END_OF_DATES_NS


def wrong_date() -> str:
    """Return a message that says what is wrong with the machine's date; empty if the date is possible."""
    unix_ns = time.time_ns()
    if _is_possible(unix_ns):
        return ""
    year = 1970 + unix_ns // SECOND_NS // 31_556_952
    return (
        f"the machine's clock shows the year {year}, which cannot be right. Until the clock is set, times "
        "count from the machine's start, and are shown in the year 1970. Does the machine have a battery "
        "for its clock, and can it reach a time server?"
    )
