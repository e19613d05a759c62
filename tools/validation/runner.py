"""How every part is run: tasks, in parallel, that draw records and count; the rows of each are kept."""

import signal
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from fltea.cli.output import progress_bar, write_files
from fltea.identification.workers import Workers
from fltea.records.errors import FlteaError, UsageError

Row = dict[str, Any]
"""One line of a table of figures: name to text, number, truth value or None."""


class Options(NamedTuple):
    """What of a part is asked for."""

    seeds: int
    """series, records or axes of each kind, as the part says"""
    quick: bool = False
    only: tuple[str, ...] = ()
    """texts, of which the names of what is drawn have to hold one; none: all"""
    first: int = 0
    """number of the first record of the gallery: others are other draws of the same noises"""
    hours: int = 0
    """of one sensor, in which false steps are counted; 0: as many as the part has by itself"""

    def wanted(self, name: str) -> bool:
        """Return whether a name holds one of the texts."""
        return not self.only or any(text in name for text in self.only)


class Task(NamedTuple):
    """Something to do in a process of its own; what it gives depends on nothing but its arguments."""

    name: str
    work: Callable[..., list[Row]]
    arguments: tuple[Any, ...]
    samples: int = 0
    """of the record, where records differ in length: the longest begin first"""

    @property
    def key(self) -> str:
        """Which task it is, in the file of what was kept."""
        return msgspec.json.encode([self.name, *self.arguments]).decode()


class _Kept(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    task: str
    rows: list[Row]


def run(tasks: Sequence[Task], workers: Workers, file: Path, *, resume: bool = False) -> list[Row]:
    """Do all tasks and return their rows in the order of the tasks, whoever works in whatever order.

    file: NDJSON, which gets a line a task as soon as it is done, and at last all in their order. resume: what
    it holds of these tasks is not done again.

    Raises:
        FlteaError: a worker died.
        UsageError: the file to resume from is not of this program.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    done = _known(file) if resume else {}
    waiting = sorted((one for one in tasks if one.key not in done), key=lambda one: one.samples)
    pending: dict[Future[list[Row]], Task] = {}
    with file.open("ab" if resume else "wb") as lines, progress_bar(len(tasks)) as show:
        show("", advance=len(tasks) - len(waiting))
        while waiting or pending:
            try:
                # None waits for a free process: large records would only wait in memory.
                while waiting and len(pending) < max(1, workers.slots - 1):
                    task = waiting.pop()
                    pending[workers.submit(task.work, *task.arguments)] = task
                for future in wait(pending, return_when=FIRST_COMPLETED).done:
                    task = pending.pop(future)
                    done[task.key] = future.result()
                    lines.write(_line(task.key, done[task.key]))
                    lines.flush()
                    show(task.name, advance=1)
            except BrokenExecutor as error:
                raise FlteaError(
                    "a process that worked on it was killed; did memory run out? Try --jobs 1."
                ) from error
    whole = b"".join(_line(one.key, done[one.key]) for one in tasks)
    write_files(file.parent, {file.name: whole})
    # As a program that reads the file has them: tuples are lists, and what is not finite is None.
    return read_rows(file)


def read_rows(file: Path) -> list[Row]:
    """Return all rows of the file of an earlier run.

    Raises:
        UsageError: there is none, or it is not of this program.
    """
    if not file.exists():
        raise UsageError(f"{file}: there is no such file.")
    return [row for rows in _known(file).values() for row in rows]


def _line(key: str, rows: list[Row]) -> bytes:
    return msgspec.json.encode(_Kept(key, rows)) + b"\n"


def _known(file: Path) -> dict[str, list[Row]]:
    """What an earlier run left; a last line that was cut off is done again."""
    if not file.exists():
        return {}
    *whole, rest = file.read_bytes().split(b"\n")
    if rest:
        file.write_bytes(b"".join(line + b"\n" for line in whole))
    try:
        kept = [msgspec.json.decode(line, type=_Kept) for line in whole]
    except msgspec.MsgspecError as error:
        raise UsageError(
            f"{file} is not of this program ({error}); without --resume it is made again."
        ) from error
    return {one.task: one.rows for one in kept}
