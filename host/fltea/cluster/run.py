"""Lists files, distributes them to workers, and writes the results of each file to the table once."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import msgspec

from fltea.cluster.cut import Cut
from fltea.cluster.listing import File, Unlisted
from fltea.cluster.pieces import cuts_of
from fltea.cluster.rows import Key, Row, failed
from fltea.cluster.summed import PieceSums, fit_pieces, sum_piece
from fltea.cluster.verdict_table import VerdictTable
from fltea.cluster.whole import Ask, identify_file
from fltea.identification.hand_out import HandOut, Task
from fltea.identification.workers import Workers
from fltea.records.errors import FlteaError, UsageError


class Progress(msgspec.Struct):
    """Progress of a run.

    `read`: number of bytes in all files that were identified or have failed.
    `skipped`: number of files that were in the table already, or that the user named twice.
    `failed_before`: number of skipped files for which the table holds a failure.
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
    """A file whose pieces are being read by workers."""

    sums: list[PieceSums | None]
    failed: bool = False


@dataclass
class _Task(Task):
    """Work for one worker: identify a whole file, or compute the sums over one piece of it.

    `number`: index of the piece.
    """

    file: File
    pieces: _Pieces | None = None
    number: int = 0


def run(
    files: Iterable[File | Unlisted],
    ask: Ask,
    workers: Workers,
    table: VerdictTable,
    report: Callable[[Progress], None] = lambda progress: None,
) -> Progress:
    """Identify the noise of all files that the table does not yet hold in their present state.

    Files are listed when they are needed, so memory grows by only a few bytes for each file.

    Raises:
        FlteaError: there are no workers left, the table cannot be written, or the files cannot be listed.
    """
    loop = _Loop(files, ask, workers, table, report)
    loop.work()
    report(loop.progress)
    return loop.progress


class _Loop(HandOut[_Task]):
    def __init__(
        self,
        files: Iterable[File | Unlisted],
        ask: Ask,
        workers: Workers,
        table: VerdictTable,
        report: Callable[[Progress], None],
    ) -> None:
        super().__init__(workers)
        self.progress = Progress()
        self._files = self._new(files, table)
        self._ask, self._table, self._report = ask, table, report
        self._digest = ask.digest()
        self._next: deque[_Task] = deque()
        self._under_way: set[File] = set()

    def _new(self, files: Iterable[File | Unlisted], table: VerdictTable) -> Iterator[File]:
        for file in files:
            if isinstance(file, Unlisted):
                self._finish(file.folder, failed(Key(file.folder, self._digest), file.reason, again=True))
                continue
            self.progress.listed += 1
            if file in table or file in self._under_way:
                self.progress.skipped += 1
                failure = table.failure_of(file)
                if failure is not None:
                    self.progress.failed_before += 1
                    self._name_failure(file, failure)
            else:
                self._under_way.add(file)
                yield file

    def next_task(self) -> _Task | None:
        """Return the next piece of a file that is being read, or else the next file."""
        for queue in (self._alone, self._next):
            while queue:
                task = queue.popleft()
                if task.pieces is None or not task.pieces.failed:
                    return task
        file = next(self._files, None)
        if file is None:
            return None
        large = file.size > self._ask.block_bytes
        return _Task(cuts_of if large else identify_file, (file, self._ask), file)

    def settle(self, task: _Task, result: Any) -> None:
        """Handle the result of a task.

        The rows of an identified file are written to the table. If a file is so large that it was cut, each
        of its pieces becomes a task. When the sums of all pieces are there, one more task fits them. A
        failure is written to the table, too.
        """
        file, pieces = task.file, task.pieces
        if pieces is not None and pieces.failed:
            return
        if isinstance(result, FlteaError):
            self._fail(task, str(result), again=not isinstance(result, UsageError))
        elif isinstance(result, BaseException):
            self._fail(task, f"{type(result).__name__}: {result}", again=True)
        elif not self._is_answer(task, result):
            reason = f"the worker's answer (a {type(result).__name__}) does not belong to its task"
            self._fail(task, f"{reason}. Does the worker have the same fltea?", again=True)
        elif task.do is cuts_of:
            self._cut(file, result)
        elif pieces is None:
            self._finish(file, result)
        elif isinstance(result, str):
            self._fail(task, result, again=False)
        else:
            pieces.sums[task.number] = result
            self.progress.now = f"{file.url} piece {task.number + 1} of {len(pieces.sums)}"
            self._report(self.progress)
            if None not in pieces.sums:
                self._next.appendleft(_Task(fit_pieces, (file, self._ask, pieces.sums), file))

    def _is_answer(self, task: _Task, result: Any) -> bool:
        """Return whether a result has the type that its task requires, and belongs to its file."""
        if task.do is sum_piece:
            return isinstance(result, PieceSums | str)
        if not isinstance(result, list):
            return False
        if task.do is cuts_of:
            return all(isinstance(one, Cut) for one in result)
        key = Key(task.file, self._digest)
        return bool(result) and all(key.has(row) for row in result)

    def _cut(self, file: File, cuts: list[Cut]) -> None:
        if not cuts:
            self._next.append(_Task(identify_file, (file, self._ask), file))
            return
        pieces = _Pieces([None] * len(cuts))
        for number, cut in enumerate(cuts):
            self._next.append(_Task(sum_piece, (file, cut, self._ask), file, pieces, number))

    def _fail(self, task: _Task, reason: str, *, again: bool) -> None:
        if task.pieces is not None:
            task.pieces.failed = True
            reason = f"piece {task.number + 1} of {len(task.pieces.sums)}: {reason}"
        self._finish(task.file, failed(Key(task.file, self._digest), reason, again=again))

    def _finish(self, file: File, rows: list[Row]) -> None:
        self._table.add(rows)
        self._under_way.discard(file)
        progress = self.progress
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
        self.progress.first_failure = self.progress.first_failure or named
