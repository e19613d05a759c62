"""Errors that come when the system gives no more memory, threads or processes: no fault of a file."""

import errno
import resource
from collections.abc import Iterator

from fltea.records.errors import FlteaError

MB = 1_000_000

LEAST_BYTES = 256 * MB
"""Of address space, to compute anything: with less, some libraries end the process, and some never end."""

WORDS = "can't start new thread", "failed to map segment", "cannot allocate memory", "memory allocation"
"""In errors of threads, of the loader of libraries, and of libraries that have no kind of error for it."""


def least_of(what: int, ours: int) -> int:
    """Return the limit of `resource` that a process gets which asks for `ours`: what is set may be less."""
    return min([ours, *(one for one in resource.getrlimit(what) if one != resource.RLIM_INFINITY)])


def address_space() -> int | None:
    """Return how many bytes of addresses this process may have; None if nothing limits it."""
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if soft == resource.RLIM_INFINITY else soft


def check_address_space() -> None:
    """Raise FlteaError where this process may have so few addresses that nothing can be computed."""
    if (limit := address_space()) is not None and limit < LEAST_BYTES:
        raise FlteaError(
            f"this session limits a process to {limit / MB:.0f} MB of addresses (ulimit -v), and numpy with "
            f"its libraries and threads needs {LEAST_BYTES / MB:.0f} MB to begin with. Raise that limit."
        )


def is_scarcity(error: BaseException) -> bool:
    """Whether an error says, or was caused by one that says, that the system gives no more."""
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
    """Return the sentence on it, which names the limit that is the likely cause."""
    said = f" ({error})" if error is not None and str(error) else ""
    limit = address_space()
    if limit is None:
        return FlteaError(
            f"the system gives no more memory or threads{said}. Close other programs, or raise what limits "
            "this one: the memory of its container or service, or `ulimit -u`."
        )
    return FlteaError(
        f"the system gives no more memory{said}: this session limits a process to {limit / MB:.0f} MB of "
        "addresses (ulimit -v), of which libraries and threads reserve a few hundred. Raise that limit."
    )


def _chain(error: BaseException) -> Iterator[BaseException]:
    seen: list[BaseException | None] = [None]
    one: BaseException | None = error
    while one not in seen:
        assert one is not None
        yield one
        seen.append(one)
        one = one.__cause__ or one.__context__
