"""Check before the start that the system allows enough file descriptors."""

import contextlib
import os
import resource
from collections.abc import Sequence
from itertools import accumulate

from fltea.records.errors import UsageError
from fltea.records.ports import Source
from fltea.settings.config import Config
from fltea.sources.serial import SerialSource

RESERVE = 64
"""This number of file descriptors is reserved for outputs and their clients, for the file of snapshots, for
the next file of a recording, and for opening serial ports again.
"""

OF_OTHERS = 4
"""A source that is no serial port needs at most this number of file descriptors. A serial port needs one."""

MOST = 1 << 16
"""This program asks the system for at most this limit of file descriptors. Some systems would allow a
thousand million.
"""


def check_descriptors(sources: Sequence[Source], configs: Sequence[Config]) -> None:
    """Raise the limit on this process's file descriptors, and check that the limit is enough for all devices.

    Raises:
        UsageError: the limit is too low.
    """
    each = [
        (1 if isinstance(source, SerialSource) and source.port.has_descriptor else OF_OTHERS)
        + (config.record.folder is not None)
        for source, config in zip(sources, configs, strict=True)
    ]
    limit, others = _raised_limit(), RESERVE + len(os.listdir("/dev/fd"))
    needed = others + sum(each)
    if needed > limit:
        fit = sum(one <= limit - others for one in accumulate(each))
        raise UsageError(
            f"{len(each)} devices need {needed} file descriptors (one for each device, or two with --record, "
            f"and {others} for everything else), but this process may have only {limit}, which is enough for "
            f"{fit} devices. Allow more: 'ulimit -n {needed}' before the program starts, or "
            f"LimitNOFILE={needed} in its systemd unit."
        )


def _raised_limit() -> int:
    """Raise the limit of file descriptors to `MOST`, or as far as the system allows, and return it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY:
        return MOST
    most = MOST if hard == resource.RLIM_INFINITY else min(hard, MOST)
    if most > soft:
        with contextlib.suppress(OSError, ValueError):  # the system may forbid raising the limit
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
            return most
    return soft
