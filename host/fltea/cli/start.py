"""The program's entry point: load the command line, and run it."""

import os
import signal
from types import FrameType


def main() -> None:
    """Run the command. Ctrl-C ends it without a traceback, also while it loads its modules.

    The exception KeyboardInterrupt would not do: within the start of a compiled module, it becomes another.
    """
    usual = signal.getsignal(signal.SIGINT)
    is_handled = usual is signal.default_int_handler  # in the background of a script, Ctrl-C is ignored
    if is_handled:
        signal.signal(signal.SIGINT, _end)
    from fltea.cli import app

    if is_handled:
        signal.signal(signal.SIGINT, usual)
    app.main()


def _end(number: int, frame: FrameType | None) -> None:
    os._exit(128 + number)
