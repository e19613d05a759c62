"""Where events come from: each source is an iterator of them behind one small interface."""

from collections.abc import Iterator
from typing import Protocol

from fltea.model import Event, LinkStats


class Source(Protocol):
    """What the daemon asks of a source.

    live: it may fall silent and come back.
    prompt: its samples come at their own pace, so records must go out at once.
    unix_offset_ns: what to add to its events' host_ns to get Unix time.
    """

    live: bool
    prompt: bool

    @property
    def unix_offset_ns(self) -> int:
        """Nanoseconds from the source's monotonic clock to Unix time, as of now."""

    def events(self) -> Iterator[Event]:
        """Yield events until the source ends or is closed."""

    def link_stats(self) -> LinkStats:
        """Count what arrived and what was lost on the way."""

    def close(self) -> None:
        """Release everything; may be called from a signal handler's thread and twice."""
