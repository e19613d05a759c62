"""Runs the tasks of a part in parallel, and keeps the rows that each task returns."""

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
"""One row of results: a text, number, truth value or None for each name."""


class Options(NamedTuple):
    """Which tasks of a part of `make validate` are run."""

    seeds: int
    """Number of series of each noise. In some parts of `make validate` it is that of records or axes."""
    quick: bool = False
    only: tuple[str, ...] = ()
    """Only noises whose name contains one of these texts are used. If empty, all noises are used."""
    first: int = 0
    """Number of the first record in the part `gallery`. Records with other numbers are other random samples
    of the same noises.
    """
    hours: int = 0
    """Number of hours of one sensor's data in which false steps of the bias are counted. If 0, the default of
    the part is used.
    """

    def wanted(self, name: str) -> bool:
        """Return whether a noise with this name is used."""
        return not self.only or any(text in name for text in self.only)


class Task(NamedTuple):
    """Work that a process of its own can do. The result depends on nothing but the task's arguments."""

    name: str
    work: Callable[..., list[Row]]
    arguments: tuple[Any, ...]
    samples: int = 0
    """Length of the task's record. Tasks with the longest records begin first."""

    @property
    def key(self) -> str:
        """Text that identifies the task in the file of its rows."""
        return msgspec.json.encode([self.name, *self.arguments]).decode()


class _Kept(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    task: str
    rows: list[Row]


def run(tasks: Sequence[Task], workers: Workers, file: Path, *, resume: bool = False) -> list[Row]:
    """Run all tasks. Return their rows in the order of the tasks, in whatever order the tasks are done.

    `file`: NDJSON file that gets a line for each task when the task is done. At the end it is written anew,
    with all lines in the order of the tasks.
    `resume`: if True, tasks whose rows the file already has are not repeated.

    Raises:
        FlteaError: a worker died.
        UsageError: the file to resume from was not written by this program.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    done = _known(file) if resume else {}
    waiting = sorted((one for one in tasks if one.key not in done), key=lambda one: one.samples)
    pending: dict[Future[list[Row]], Task] = {}
    with file.open("ab" if resume else "wb") as lines, progress_bar(len(tasks)) as show:
        show("", advance=len(tasks) - len(waiting))
        while waiting or pending:
            try:
                # Only as many tasks are submitted as there are free processes, since waiting tasks would take
                # up memory.
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
                    "a process that worked on a task was killed; did memory run out? Try --jobs 1."
                ) from error
    whole = b"".join(_line(one.key, done[one.key]) for one in tasks)
    write_files(file.parent, {file.name: whole})
    # Return the rows as they would be if they were read from the file: tuples become lists, and values that
    # are not finite become None.
    return read_rows(file)


def read_rows(file: Path) -> list[Row]:
    """Return all rows of the file of an earlier run.

    Raises:
        UsageError: the file does not exist, or was not written by this program.
    """
    if not file.exists():
        raise UsageError(f"{file}: there is no such file.")
    return [row for rows in _known(file).values() for row in rows]


def _line(key: str, rows: list[Row]) -> bytes:
    return msgspec.json.encode(_Kept(key, rows)) + b"\n"


def _known(file: Path) -> dict[str, list[Row]]:
    """Return the rows of an earlier run by task.

    A last line that was cut off is removed, so that its task is repeated.
    """
    if not file.exists():
        return {}
    *whole, rest = file.read_bytes().split(b"\n")
    if rest:
        file.write_bytes(b"".join(line + b"\n" for line in whole))
    try:
        kept = [msgspec.json.decode(line, type=_Kept) for line in whole]
    except msgspec.MsgspecError as error:
        raise UsageError(
            f"{file} was not written by this program ({error}); without --resume it is replaced."
        ) from error
    return {one.task: one.rows for one in kept}
