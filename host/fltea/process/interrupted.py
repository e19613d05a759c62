"""A signal that ends a command before it is done, and the exit code of the command."""

from types import FrameType


class Interrupted(SystemExit):
    """A signal that ends a command before it is done.

    The exit code is 128 and the signal's number, as shells give it for a program that a signal has ended.
    With KeyboardInterrupt, the library of the command line would make it 130, whatever the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(128 + number)


def interrupt(number: int, frame: FrameType | None) -> None:
    """Handle a signal: end the command, with the chance to clean up."""
    raise Interrupted(number)
