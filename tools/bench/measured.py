"""What the benchmarks share: works in turns, and what programs cost."""

import contextlib
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import psutil

T = TypeVar("T")

ROOT = Path(__file__).resolve().parents[2]


def cpu_seconds(work: Callable[[], object]) -> float:
    """Return the processor time of a work, which a busy machine changes least."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def in_turns(works: Mapping[str, Callable[[], T]], rounds: int) -> dict[str, list[T]]:
    """Return what each work gives, round by round, so that a busy machine is busy for all of them."""
    found: dict[str, list[T]] = {name: [] for name in works}
    for _ in range(rounds):
        for name, work in works.items():
            found[name].append(work())
    return found


class Share(NamedTuple):
    """What a program takes."""

    cpu_percent: float
    """of a core"""
    rss_mb: float
    threads: int


class Watch:
    """Looks at running programs from when it is made to its `end`."""

    def __init__(self, pids: Mapping[str, int]) -> None:
        self._programs = {name: psutil.Process(pid) for name, pid in pids.items()}
        self.begin_ns = time.monotonic_ns()
        self._before = self._cpu_s()

    def _cpu_s(self) -> dict[str, float]:
        times = {name: one.cpu_times() for name, one in self._programs.items()}
        return {name: one.user + one.system for name, one in times.items()}

    def end(self) -> dict[str, Share]:
        """Return what each took since then, and its memory and threads as of now."""
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
    """Return the shares as a benchmark reports those of several programs."""
    return {
        name: {program: round(getattr(one, name), 1) for program, one in shares.items()}
        for name in ("cpu_percent", "rss_mb")
    }


def started(stack: contextlib.ExitStack, module: str, *arguments: object, **options: Any) -> Any:
    """Start a module of Python, which is killed with the stack if it has not ended by then."""
    command = [sys.executable, "-m", module, *map(str, arguments)]
    program = subprocess.Popen(command, cwd=ROOT, **options)
    stack.callback(program.wait)
    stack.callback(program.kill)
    return program
