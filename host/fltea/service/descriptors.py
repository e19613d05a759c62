"""The budget of file descriptors: a device that would find none left is an error before anything begins."""

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
"""For outputs, their clients, the state, a new file of a recording, and ports while they are opened."""

OF_OTHERS = 4
"""Most that a source has open that is no port with a descriptor, of which there is one each."""

MOST = 1 << 16
"""Not all that a system allows, which may be a milliard."""


def check_descriptors(sources: Sequence[Source], configs: Sequence[Config]) -> None:
    """Let this process have as many descriptors as it may, and see that they are enough for its devices.

    Raises:
        UsageError: they are not.
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
    """Return the limit, after it was raised as far as that is possible and sensible."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY:
        return MOST
    most = MOST if hard == resource.RLIM_INFINITY else min(hard, MOST)
    if most > soft:
        with contextlib.suppress(OSError, ValueError):  # a system that forbids it
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
            return most
    return soft
