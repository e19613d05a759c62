"""How commands that compute something show it: a bar on stderr meanwhile, the result on stdout."""

import contextlib
from collections.abc import Callable, Iterator

from fltea.records.errors import FlteaError


@contextlib.contextmanager
def progress_bar(total: int) -> Iterator[Callable[[str, int], None]]:
    """Show a bar on stderr, if that is a terminal; what it gives takes a text and a number of steps done."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description:<22}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=total)
        yield lambda text, steps: bar.update(task, advance=steps, description=text)


def print_result(text: str) -> None:
    """Write to stdout; a reader that has left is no failure."""
    try:
        print(text, end="", flush=True)
    except OSError as error:
        from fltea.service.daemon import silence_stdout

        silence_stdout()
        if not isinstance(error, BrokenPipeError):
            raise FlteaError(f"cannot write the output: {error}.") from error
