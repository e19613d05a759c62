"""Output of commands: a progress bar and messages on stderr, results on stdout."""

import contextlib
import json
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fltea.cli.standard_output import silence_stdout
from fltea.records.errors import FlteaError
from fltea.records.secret import hidden
from fltea.records.visible import visible_lines
from fltea.records.whole_file import whole_file

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress


AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout, and nothing else.")]
"""The option `--json` of commands that compute a result."""


BAR_AFTER_S = 2.0
"""The progress bar appears after this time [s]. Shorter work needs no bar."""


@contextlib.contextmanager
def progress_bar(total: int | None = None) -> Iterator[Callable[..., None]]:
    """Show a progress bar on stderr after `BAR_AFTER_S`, if stderr is a terminal.

    The context yields a function to report progress. The function's arguments are a text, and `advance`,
    `completed` or `total` with the meaning that they have for rich's `Progress.update`.
    """
    if not sys.stderr.isatty():
        yield lambda text, **far: None
        return
    bar = _LateBar(total)
    try:
        yield bar.show
    finally:
        bar.close()


class _LateBar:
    """A progress bar that appears when the work has taken `BAR_AFTER_S`."""

    def __init__(self, total: int | None) -> None:
        self._total, self._advanced, self._begun_s = total, 0.0, time.monotonic()
        self._newest: tuple[str, dict[str, Any]] = "", {}
        self._bar: Progress | None = None
        self._is_closed = False
        self._alone = threading.Lock()
        self._timer = threading.Timer(BAR_AFTER_S, self._begin)
        self._timer.daemon = True
        self._timer.start()

    def show(self, text: str, **far: Any) -> None:
        """Report progress: a text, and the numbers for rich's `Progress.update`."""
        with self._alone:
            if self._bar is not None:
                self._update(text, far)
            else:
                self._advanced += far.pop("advance", 0)
                self._newest = text, self._newest[1] | far

    def close(self) -> None:
        """Remove the bar."""
        self._timer.cancel()
        with self._alone:
            if self._bar is not None:
                self._bar.stop()
                self._bar = None
            self._is_closed = True

    def _begin(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

        columns = (
            TextColumn("{task.description:<22}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
        )
        with self._alone:
            if self._is_closed:
                return
            self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
            task = self._bar.add_task("", total=self._total)
            self._bar.tasks[task].start_time = self._begun_s
            text, far = self._newest
            self._update(text, {"completed": self._advanced} | far)
            self._bar.start()

    def _update(self, text: str, far: dict[str, Any]) -> None:
        assert self._bar is not None
        self._bar.update(self._bar.task_ids[0], description=visible_lines(text), **far)


def say(text: str) -> None:
    """Write a message to stderr, with control characters from file names made visible."""
    print(visible_lines(hidden(text)), file=sys.stderr, flush=True)


def end_with(failures: Sequence[FlteaError]) -> None:
    """Report all failures except the first on stderr, then raise the first. Do nothing without a failure."""
    for failure in failures[1:]:
        say(f"fltea: error: {failure}")
    if failures:
        raise failures[0]


def print_lines(text: str) -> None:
    """Write lines for a person to stdout, with control characters from boards and files made visible."""
    print(visible_lines(text), flush=True)


@contextlib.contextmanager
def result_console() -> "Iterator[Console]":
    """Yield a rich console whose content is written to stdout when the context ends."""
    from rich.console import Console

    console = Console()
    # the text is captured, since rich would end the program if the reader of stdout has ended
    with console.capture() as shown:
        yield console
    print_result(shown.get())


def write_files(folder: Path, contents: Mapping[str, bytes]) -> list[Path]:
    """Write files, each whole or not at all, and return their paths. `contents`: data by file name."""
    for name, data in contents.items():
        with whole_file(folder / name) as file:
            file.write(data)
    return [folder / name for name in contents]


def escaped(text: str) -> str:
    r"""Return JSON in characters that standard output can encode: `\u03b1` for α if it is ASCII only."""
    try:
        text.encode(sys.stdout.encoding or "utf-8")
    except UnicodeEncodeError:
        return "".join(c if c.isascii() else json.dumps(c)[1:-1] for c in text)
    return text


def print_result(text: str) -> None:
    """Write a result to stdout. It is no error if the reader of stdout has ended."""
    try:
        print(text, end="", flush=True)
    except BrokenPipeError:
        silence_stdout()
