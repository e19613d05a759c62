"""Explain errors that mean that the system refuses more memory, threads or processes."""

import errno
import resource
from collections.abc import Iterator

from fltea.records.errors import FlteaError

MB = 1_000_000

LEAST_BYTES = 256 * MB
"""Smallest limit of the address space with which the program computes [bytes]. With a smaller limit, some
libraries end the process, and others hang.
"""

WORDS = "can't start new thread", "failed to map segment", "cannot allocate memory", "memory allocation"
"""An error whose text contains one of these says that memory is lacking. Such errors come from the start of a
thread, from the loading of a library, and from some libraries.
"""


def least_of(what: int, ours: int) -> int:
    """Return the smaller of two limits: `ours`, and the one that the system has set already.

    `what`: which limit of the system, as a constant of the module `resource`.
    """
    return min([ours, *(limit for limit in resource.getrlimit(what) if limit != resource.RLIM_INFINITY)])


def address_space() -> int | None:
    """Return the limit of this process's address space in bytes; None if there is no limit."""
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if soft == resource.RLIM_INFINITY else soft


def check_address_space() -> None:
    """Raise FlteaError if this process's address space is limited to less than computing needs."""
    if (limit := address_space()) is not None and limit < LEAST_BYTES:
        raise FlteaError(
            f"this session limits a process to {limit / MB:.0f} MB of addresses (ulimit -v), and numpy with "
            f"its libraries and threads needs {LEAST_BYTES / MB:.0f} MB to begin with. Raise that limit."
        )


def is_scarcity(error: BaseException) -> bool:
    """Return whether an error, or one of its causes, says that the system refuses more memory or threads."""
    return any(
        isinstance(one, MemoryError)
        or (isinstance(one, OSError) and one.errno == errno.ENOMEM)
        or (
            isinstance(one, RuntimeError | ImportError | OSError)
            and any(w in str(one).lower() for w in WORDS)
        )
        for one in _chain(error)
    )


def scarcity(error: BaseException | None = None) -> FlteaError:
    """Return the error that says that memory or threads are lacking, and which limit likely causes it."""
    said = f" ({error})" if error is not None and str(error) else ""
    limit = address_space()
    if limit is None:
        return FlteaError(
            f"the system grants no more memory or threads{said}. Close other programs, or raise the limits "
            "of this one: the memory of its container or service, or `ulimit -u`."
        )
    return FlteaError(
        f"the system grants no more memory{said}: this session limits a process to {limit / MB:.0f} MB of "
        "addresses (ulimit -v), and libraries and threads alone reserve a few hundred MB. Raise that limit."
    )


def _chain(error: BaseException) -> Iterator[BaseException]:
    seen: list[BaseException | None] = [None]
    one: BaseException | None = error
    while one not in seen:
        assert one is not None
        yield one
        seen.append(one)
        one = one.__cause__ or one.__context__
