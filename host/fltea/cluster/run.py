"""Lists, hands out and collects: how every file comes into the table of verdicts once."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from dataclasses import dataclass
from typing import Any, NamedTuple

import msgspec

from fltea.cluster.cut import Cut
from fltea.cluster.listing import File, Unlisted
from fltea.cluster.pieces import cuts_of
from fltea.cluster.rows import Key, Row, failed
from fltea.cluster.summed import PieceSums, fit_pieces, sum_piece
from fltea.cluster.verdict_table import VerdictTable
from fltea.cluster.whole import Ask, identify_file
from fltea.identification.workers import Workers
from fltea.records.errors import FlteaError, UsageError

CHECK_S = 5.0
"""Between two looks at whether the workers are still there."""


class Progress(msgspec.Struct):
    """What has been done so far. read: bytes of those done.

    skipped: files that were in the table already, or are named twice. failed_before: those of them that have
    a failure there.
    """

    listed: int = 0
    skipped: int = 0
    done: int = 0
    failed: int = 0
    failed_before: int = 0
    read: int = 0
    first_failure: str = ""
    now: str = ""


@dataclass
class _Pieces:
    """A file whose pieces are being summed."""

    sums: list[PieceSums | None]
    failed: bool = False


class _Task(NamedTuple):
    """What is done to a file, or to one of its pieces, of that number."""

    file: File
    do: Callable[..., Any]
    arguments: tuple[Any, ...]
    pieces: _Pieces | None = None
    number: int = 0
    again: bool = False
    """whether a process has died of it, or of what was under way at the same time"""


def run(
    files: Iterable[File | Unlisted],
    ask: Ask,
    workers: Workers,
    table: VerdictTable,
    report: Callable[[Progress], None] = lambda progress: None,
) -> Progress:
    """Identify all files that are not in the table as they are now.

    Files are listed as they are needed, so memory does not grow with their number but for some bytes each.

    Raises:
        FlteaError: the workers are gone, the table cannot be written, or the files cannot be listed.
    """
    return _Loop(files, ask, workers, table, report).run()


class _Loop:
    def __init__(
        self,
        files: Iterable[File | Unlisted],
        ask: Ask,
        workers: Workers,
        table: VerdictTable,
        report: Callable[[Progress], None],
    ) -> None:
        self._progress = Progress()
        self._files = self._new(files, table)
        self._ask, self._workers, self._table, self._report = ask, workers, table, report
        self._digest = ask.digest()
        self._next: deque[_Task] = deque()
        self._alone: deque[_Task] = deque()
        self._pending: dict[Future[Any], _Task] = {}
        self._under_way: set[File] = set()

    def run(self) -> Progress:
        """Work until nothing is left."""
        while self._hand_out() or self._pending:
            done, _ = wait(self._pending, CHECK_S, FIRST_COMPLETED)
            if not done:
                self._workers.check()
            if [future for future in done if not self._take(future)]:
                self._after_death()
        self._report(self._progress)
        return self._progress

    def _new(self, files: Iterable[File | Unlisted], table: VerdictTable) -> Iterator[File]:
        for file in files:
            if isinstance(file, Unlisted):
                self._finish(file.folder, failed(Key(file.folder, self._digest), file.reason, again=True))
                continue
            self._progress.listed += 1
            if file in table or file in self._under_way:
                self._progress.skipped += 1
                failure = table.failure_of(file)
                if failure is not None:
                    self._progress.failed_before += 1
                    self._name_failure(file, failure)
            else:
                self._under_way.add(file)
                yield file

    def _task(self) -> _Task | None:
        for queue in (self._alone, self._next):
            while queue:
                task = queue.popleft()
                if task.pieces is None or not task.pieces.failed:
                    return task
        file = next(self._files, None)
        if file is None:
            return None
        large = file.size > self._ask.block_bytes
        return _Task(file, cuts_of if large else identify_file, (file, self._ask))

    def _hand_out(self) -> bool:
        """Give the workers what they have room for; False if there is nothing more."""
        while len(self._pending) < self._room():
            task = self._task()
            if task is None:
                return False
            try:
                future = self._workers.submit(task.do, *task.arguments)
            except BrokenExecutor:  # died since the last look
                self._next.appendleft(task)
                self._after_death()
                continue
            self._pending[future] = task
        return True

    def _room(self) -> int:
        alone = self._alone or any(task.again for task in self._pending.values())
        return 1 if alone else self._workers.slots

    def _take(self, future: Future[Any]) -> bool:
        """Take a result; False if there is none because a process died."""
        try:
            result = future.result()
        except BrokenExecutor:
            return False
        except CancelledError as error:  # Dask does so when it has lost its scheduler
            self._workers.check()
            result = error
        except Exception as error:
            result = error
        self._settle(self._pending.pop(future), result)
        return True

    def _settle(self, task: _Task, result: Any) -> None:
        file, pieces = task.file, task.pieces
        if pieces is not None and pieces.failed:
            return
        if isinstance(result, FlteaError):
            self._fail(task, str(result), again=not isinstance(result, UsageError))
        elif isinstance(result, BaseException):
            self._fail(task, f"{type(result).__name__}: {result}", again=True)
        elif task.do is cuts_of:
            self._cut(file, result)
        elif pieces is None:
            self._finish(file, result)
        elif isinstance(result, str):
            self._fail(task, result, again=False)
        else:
            pieces.sums[task.number] = result
            self._progress.now = f"{file.url} piece {task.number + 1} of {len(pieces.sums)}"
            self._report(self._progress)
            if None not in pieces.sums:
                self._next.appendleft(_Task(file, fit_pieces, (file, self._ask, pieces.sums)))

    def _cut(self, file: File, cuts: list[Cut]) -> None:
        if not cuts:
            self._next.append(_Task(file, identify_file, (file, self._ask)))
            return
        pieces = _Pieces([None] * len(cuts))
        for number, cut in enumerate(cuts):
            self._next.append(_Task(file, sum_piece, (file, cut, self._ask), pieces, number))

    def _fail(self, task: _Task, reason: str, *, again: bool) -> None:
        if task.pieces is not None:
            task.pieces.failed = True
            reason = f"piece {task.number + 1} of {len(task.pieces.sums)}: {reason}"
        self._finish(task.file, failed(Key(task.file, self._digest), reason, again=again))

    def _finish(self, file: File, rows: list[Row]) -> None:
        self._table.add(rows)
        self._under_way.discard(file)
        progress = self._progress
        progress.done += 1
        progress.read += max(file.size, 0)
        errors = [row.error for row in rows if row.error is not None]
        if errors:
            progress.failed += 1
            self._name_failure(file, errors[0])
        progress.now = file.url
        self._report(progress)

    def _name_failure(self, file: File, error: str) -> None:
        named = error if error.startswith(file.url) else f"{file.url}: {error}"
        self._progress.first_failure = self._progress.first_failure or named

    def _after_death(self) -> None:
        """One of those under way killed its process; each is tried alone: who dies then did it."""
        tasks = list(self._pending.values())
        self._pending.clear()
        if len(tasks) == 1 and tasks[0].again:
            self._settle(tasks[0], MemoryError("the process that worked on it was killed; out of memory?"))
        else:
            self._alone.extend(task._replace(again=True) for task in tasks)
        self._workers.renew()
