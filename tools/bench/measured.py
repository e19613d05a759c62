"""Helpers that the benchmarks share: they run tasks alternately, and measure the cost of programs."""

import contextlib
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import psutil

T = TypeVar("T")
K = TypeVar("K", bound=Hashable)

ROOT = Path(__file__).resolve().parents[2]


def cpu_seconds(work: Callable[[], object]) -> float:
    """Return the processor time of a call of a function [s].

    Processor time depends less than wall-clock time on how busy the machine is.
    """
    begin = time.process_time()
    work()
    return time.process_time() - begin


def in_turns(works: Mapping[K, Callable[[], T]], rounds: int) -> dict[K, list[T]]:
    """Run several functions alternately; return the results of each.

    Each round calls every function once, so that a busy machine slows all of them.
    """
    found: dict[K, list[T]] = {name: [] for name in works}
    for _ in range(rounds):
        for name, work in works.items():
            found[name].append(work())
    return found


class Share(NamedTuple):
    """Processor time, memory and threads of a program."""

    cpu_percent: float
    """Processor time in percent of one core."""
    rss_mb: float
    threads: int


class Watch:
    """Measures running programs from the construction of this object to `end`."""

    def __init__(self, pids: Mapping[str, int]) -> None:
        self._programs = {name: psutil.Process(pid) for name, pid in pids.items()}
        self.begin_ns = time.monotonic_ns()
        self._before = self._cpu_s()

    def _cpu_s(self) -> dict[str, float]:
        times = {name: one.cpu_times() for name, one in self._programs.items()}
        return {name: one.user + one.system for name, one in times.items()}

    def end(self) -> dict[str, Share]:
        """Return each program's processor time since the construction, and its present memory and threads."""
        seconds, after = (time.monotonic_ns() - self.begin_ns) * 1e-9, self._cpu_s()
        return {
            name: Share(
                100 * (after[name] - self._before[name]) / seconds,
                one.memory_info().rss / 2**20,
                one.num_threads(),
            )
            for name, one in self._programs.items()
        }


def rounded(shares: Mapping[str, Share]) -> dict[str, dict[str, float]]:
    """Return the costs of several programs in the form in which benchmarks report them."""
    return {
        name: {program: round(getattr(one, name), 1) for program, one in shares.items()}
        for name in ("cpu_percent", "rss_mb")
    }


def allow_open_files(count: int) -> None:
    """Raise this process's limit of open files, which child processes inherit.

    RuntimeError is raised if the system permits fewer.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and count > hard:
        raise RuntimeError(
            f"{count} open files are needed, and {hard} are allowed: 'ulimit -Hn {count}' as root"
        )
    if soft != resource.RLIM_INFINITY and count > soft:
        resource.setrlimit(resource.RLIMIT_NOFILE, (count, hard))


def started(stack: contextlib.ExitStack, module: str, *arguments: object, **options: Any) -> Any:
    """Start a Python module as a program. When `stack` is closed, it is killed if it still runs."""
    return started_command(stack, [sys.executable, "-m", module, *map(str, arguments)], **options)


def started_command(stack: contextlib.ExitStack, command: list[str], **options: Any) -> Any:
    """Start a program. When `stack` is closed, the program is killed if it still runs."""
    program = subprocess.Popen(command, cwd=ROOT, **options)
    for pipe in (program.stdin, program.stdout, program.stderr):
        if pipe is not None:
            stack.callback(pipe.close)
    stack.callback(program.wait)
    stack.callback(program.kill)
    return program
