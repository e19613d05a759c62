"""Where records go: each sink takes them one by one."""

from typing import Protocol

from fltea.model import AnyRecord


class SinkClosed(Exception):
    """The reader of the output is gone."""


class Sink(Protocol):
    """What the daemon asks of a sink."""

    def write(self, record: AnyRecord) -> None:
        """Take one record.

        Raises:
            SinkClosed: nobody reads any more.
        """

    def close(self) -> None:
        """Write what is pending and release everything."""
