"""`fltea identify … --out verdicts.parquet`: write the verdicts on any number of recordings to a table."""

import contextlib
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fltea.cli.output import say
from fltea.process.interrupted import Interrupted, interrupt
from fltea.records.errors import FlteaError, UsageError
from fltea.records.visible import visible_lines
from fltea.settings.extras import load

if TYPE_CHECKING:
    from fltea.cluster.run import Progress
    from fltea.identification.workers import Workers

SUFFIX = ".parquet"
TELL_S = 30.0
"""Time between two lines of progress on a stderr that is no terminal [s]."""


def check(files: Sequence[str], out: Path | None, others: Sequence[str]) -> None:
    """Refuse options that exclude each other.

    `others`: given flags that work only for one recording or a few, and not with --out.

    Raises:
        UsageError: options exclude each other, or a file's name is empty.
    """
    if "" in files:
        raise UsageError("a file name is empty (an unset shell variable?); the current folder is `.`.")
    urls = [file for file in files if "://" in file]
    if out is None:
        if urls:
            raise UsageError(
                f"{urls[0]}: files by URL need a table for their verdicts: --out verdicts.parquet."
            )
        return
    if out.suffix != SUFFIX:
        raise UsageError(
            f"--out {out}: the table is Parquet; call it NAME{SUFFIX}. For a page use --report DIR."
        )
    if others:
        raise UsageError(f"{others[0]} and --out do not go together: --out writes a table, and nothing else.")


def identify_many(files: Sequence[str], out: Path, ask: Any, open_workers: "Callable[[], Workers]") -> None:
    """Identify all files that are not in the table yet, with a progress bar or lines on stderr.

    Raises:
        UsageError: there is no file to identify, or the options or files cannot be used.
        FlteaError: the table has failures for some files, from this run or an earlier one, or the worker
            processes have ended.
    """
    table_module = load("fltea.cluster.verdict_table", "pyarrow", "tables", "--out needs")
    from fltea.cluster.listing import files_of
    from fltea.cluster.run import run

    signal.signal(signal.SIGTERM, interrupt)
    table = table_module.VerdictTable(out, ask.digest())
    begin = time.monotonic()
    try:
        workers = open_workers()
        try:
            with _reporting(begin) as report:
                done = run(files_of(files), ask, workers, table, report)
        finally:
            workers.close()
    except (KeyboardInterrupt, Interrupted):
        say(f"fltea: {out}: stopped. The same command goes on with the files that are not in the table.")
        raise
    finally:
        table.close()
    say(f"fltea: {out}: {_line(done, time.monotonic() - begin)}")
    if failed := done.failed + done.failed_before:
        raise FlteaError(
            f"{failed} of {done.done + done.skipped} files have a failure in the table (column error). The "
            f"first: {done.first_failure}"
        )


def _line(progress: "Progress", seconds: float) -> str:
    parts = [f"{progress.done:,} files done"]
    if progress.failed:
        parts.append(f"{progress.failed:,} of them with a failure")
    if progress.skipped:
        parts.append(f"{progress.skipped:,} were done before")
    if progress.failed_before:
        parts.append(f"{progress.failed_before:,} of them with a failure")
    rate = progress.read / 1e6 / max(seconds, 1e-3)
    parts.append(f"{progress.read / 1e6:,.1f} MB in {seconds:,.0f} s ({rate:,.1f} MB/s)")
    return ", ".join(parts)


@contextlib.contextmanager
def _reporting(begin: float) -> "Iterator[Callable[[Progress], None]]":
    """Show the progress on stderr: as a bar on a terminal, otherwise as a line every `TELL_S` seconds."""
    from rich.console import Console
    from rich.progress import Progress as Bar
    from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

    if not sys.stderr.isatty():
        last = begin

        def line(progress: "Progress") -> None:
            nonlocal last
            if (now := time.monotonic()) - last >= TELL_S:
                last = now
                say(f"fltea: {_line(progress, now - begin)}")

        yield line
        return
    columns = SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn()
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("listing", total=None)

        def show(progress: "Progress") -> None:
            text = f"{_line(progress, time.monotonic() - begin)}  {progress.now.rpartition('/')[2]}"
            bar.update(task, description=visible_lines(text))

        yield show
