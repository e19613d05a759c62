"""Limits of a reader process, and the error message if a limit ended the process.

The operating system enforces the limits, whatever a library does: on processor time, on time without output,
and on memory. Files cannot be written at all. Lower limits of the login session apply too. The reader process
ends when the process that started it ends.
"""

import contextlib
import ctypes
import errno
import os
import resource
import signal
import sys
from collections.abc import Iterator

import msgspec

from fltea.recording.quota import Quota
from fltea.records.errors import FlteaError, UsageError
from fltea.records.scarce import LEAST_BYTES, MB, is_scarcity, least_of

STARTUP_S = 10
"""Processor time for importing a library [s]; the largest library takes 4 s on a Raspberry Pi."""

STARTUP_BYTES = 2 << 30
"""Address space that the interpreter and libraries reserve [bytes]."""

SILENT_RATIO = 4
"""The longest time without output is this many times the limit of processor time. The factor is above 1,
since a process may have to wait for a processor or disk.
"""

OUT_OF_MEMORY = 75
"""Exit code of a reader process that ran out of memory."""

PR_SET_PDEATHSIG = 1
"""Operation number of Linux's prctl(2) that requests a signal when the parent process ends."""

FALLS = signal.SIGSEGV, signal.SIGBUS, signal.SIGABRT, signal.SIGILL, signal.SIGFPE, signal.SIGSYS


class ProcessLimits(msgspec.Struct, frozen=True):
    """Limits of one reader process. `parent`: ID of the process that starts the reader process.

    `cpu_s`: processor time [s]. `silent_s`: longest time between two blocks of output [s]. `memory_bytes`:
    address space [bytes]. `is_cpu_ours`, `is_memory_ours`: whether the limit of processor time, and of
    memory, comes from the file's quota. If not, it is the lower limit of the login session.
    """

    parent: int
    cpu_s: int
    silent_s: int
    memory_bytes: int
    is_cpu_ours: bool = True
    is_memory_ours: bool = True

    @classmethod
    def of(cls, quota: Quota) -> "ProcessLimits":
        """Return the limits by the quota of the file to read, or by the login session if lower."""
        cpu_s = STARTUP_S + round(quota.seconds)
        memory_bytes = STARTUP_BYTES + 2 * quota.limits.whole_bytes
        least_s = least_of(resource.RLIMIT_CPU, cpu_s)
        least_bytes = least_of(resource.RLIMIT_AS, memory_bytes)
        silent_s = SILENT_RATIO * cpu_s
        ours = least_s == cpu_s, least_bytes == memory_bytes
        return cls(os.getpid(), least_s, silent_s, least_bytes, *ours)

    def hold(self) -> None:
        """Apply the limits to this process, and let it end when its parent ends."""
        if sys.platform == "linux":
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        # if the parent process ended before the call of prctl, the requested signal will not come
        if os.getppid() != self.parent:
            os._exit(1)
        # the parent process may have ignored or blocked these signals
        for number in (signal.SIGXCPU, signal.SIGALRM):
            signal.signal(number, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
        for what, most in (
            (resource.RLIMIT_AS, self.memory_bytes),
            (resource.RLIMIT_FSIZE, 0),
            (resource.RLIMIT_CORE, 0),
        ):
            most = _within(what, most)
            resource.setrlimit(what, (most, most))
        hard = _within(resource.RLIMIT_CPU, self.cpu_s + 1)
        # SIGXCPU comes one second before SIGKILL. So the signal that ended the process shows that processor
        # time was the reason.
        resource.setrlimit(resource.RLIMIT_CPU, (min(self.cpu_s, max(1, hard - 1)), hard))
        signal.alarm(self.silent_s)

    @contextlib.contextmanager
    def waiting(self) -> Iterator[None]:
        """Suspend the limit on the time without output while this process waits for its parent process."""
        signal.alarm(0)
        try:
            yield
        finally:
            signal.alarm(self.silent_s)

    def ended(self, quota: Quota, code: int) -> FlteaError:
        """Return the error for a reader process that ended too early.

        `code`: exit code in the form that `subprocess` reports.
        """
        path = quota.path
        number = -code if code < 0 else 0
        if code == OUT_OF_MEMORY and self.is_memory_ours:
            needed = f"more than the {self.memory_bytes / 1e9:.1f} GB would be needed"
            return UsageError(f"{path}: {needed} that a file of its size may take.")
        has_room = self.is_memory_ours or self.memory_bytes > LEAST_BYTES
        if number == signal.SIGXCPU and self.is_cpu_ours and has_room:
            return quota.too_slow()
        if has_room and (number == signal.SIGXCPU or (number == signal.SIGKILL and self.cpu_s <= 1)):
            return FlteaError(
                f"{path}: reading it takes more than the {self.cpu_s} s of processor time that this session "
                "allows a process (ulimit -t). Raise that limit."
            )
        if number == signal.SIGALRM:
            return FlteaError(
                f"{path}: nothing came of it for {self.silent_s} s, and little processor time was used. Is "
                "it on a disk that does not answer, or is the machine overloaded? Try again, or copy it to a "
                "local disk first."
            )
        if not self.is_memory_ours:
            return FlteaError(
                f"{path}: {_ended(code)}, most likely since this session limits a process to "
                f"{self.memory_bytes / MB:.0f} MB of addresses (ulimit -v). Raise that limit."
            )
        if number == signal.SIGKILL:
            return FlteaError(
                f"{path}: {_ended(code)}, most likely since the memory ran out (`journalctl -k` tells). "
                "Close other programs, or raise the memory of the container or service, and try again."
            )
        if number in FALLS or not number:
            return UsageError(f"{path}: cannot be read: {_ended(code)}. Is the file damaged?")
        return FlteaError(f"{path}: {_ended(code)}, by somebody who ended it. Try again.")


def _within(what: int, most: int) -> int:
    """Return `most`, or the system's hard limit for the resource `what` if that is lower."""
    hard = resource.getrlimit(what)[1]
    return most if hard == resource.RLIM_INFINITY else min(most, hard)


def _ended(code: int) -> str:
    if code == OUT_OF_MEMORY:
        return "reading it needs more memory than there is"
    if code >= 0:
        return f"its library failed on it (exit code {code})"
    number = -code
    name = signal.Signals(number).name if number in {*signal.Signals} else f"signal {number}"
    if number in FALLS:
        return f"its library failed on it ({signal.strsignal(number)}, {name})"
    return f"the process that read it was killed by the system ({name})"


def not_started(path: object, error: OSError) -> FlteaError:
    """Return the error to raise if no reader process can be started."""
    advice = "Close other programs, or raise the limit of processes (ulimit -u) or of memory."
    if error.errno in (errno.EMFILE, errno.ENFILE):
        advice = "Raise the limit of open files (ulimit -n)."
    elif not (error.errno == errno.EAGAIN or is_scarcity(error)):
        advice = "Is the installation of Python whole?"
    return FlteaError(f"{path}: no process can be started to read it ({error.strerror or error}). {advice}")
