"""Check the number of file descriptors, so that too few of them are an error before anything begins."""

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
"""Number of descriptors for outputs and their clients, the state, a new file of a recording, and ports that
open.
"""

OF_OTHERS = 4
"""Most descriptors that a source uses, unless it is a port with a single descriptor."""

MOST = 1 << 16
"""Largest limit to ask the system for, since a system may allow a thousand million descriptors."""


def check_descriptors(sources: Sequence[Source], configs: Sequence[Config]) -> None:
    """Raise this process's limit of descriptors, and check that the limit is enough for all devices.

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
            f"{len(each)} devices need {needed} file descriptors (one each, two with --record, {others} for "
            f"all else), and this process may have {limit}: {fit} devices fit. Allow more: 'ulimit "
            f"-n {needed}' before the program starts, or LimitNOFILE={needed} in its systemd unit."
        )


def _raised_limit() -> int:
    """Raise the limit as far as it is possible and sensible, and return it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY:
        return MOST
    most = MOST if hard == resource.RLIM_INFINITY else min(hard, MOST)
    if most > soft:
        with contextlib.suppress(OSError, ValueError):  # the system may forbid it
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
            return most
    return soft
