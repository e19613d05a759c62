"""How far a worker is behind in the partitions that it serves, and what it walks a second time (pure)."""

from dataclasses import dataclass

BEHIND_NS = 5 * 10**9
"""For this long after a message that had waited nobody of its partition is taken for silent."""

WAITED_NS = 2 * 10**9
"""A message that waited this long shows that the stream is read behind its time."""

IN_TIME_NS = 10**9
"""A message that waited less shows that the stream has been caught up with."""


@dataclass
class _Again:
    """Messages of a partition up to `until` that are walked a second time."""

    until: int
    count: int = 0


class CatchingUp:
    """Follows each partition from the message where another worker left it."""

    def __init__(self) -> None:
        self._again: dict[int, _Again] = {}
        self._caught_up: set[int] = set()
        self._behind_ns: dict[int, int] = {}

    def begin(self, partition: int, done: int) -> None:
        """Begin with a partition, whose messages up to `done` another has walked."""
        self._again[partition] = _Again(done)

    def forget(self, partition: int) -> None:
        """Serve a partition no more, or from its beginning."""
        self._caught_up.discard(partition)
        self._again.pop(partition, None)

    def shows_pressure(self, partition: int, waited_ns: int, now_ns: int) -> bool:
        """Take note how long a message waited; return whether that shows that this machine is too slow.

        A stream that is read behind its time shows nothing until it has been caught up with.
        """
        if waited_ns >= WAITED_NS:
            self._behind_ns[partition] = now_ns
        if partition in self._caught_up:
            return True
        if waited_ns < IN_TIME_NS:
            self._caught_up.add(partition)
        return False

    def is_behind(self, partition: int, now_ns: int) -> bool:
        """Return whether what devices of a partition sent may still wait in the stream."""
        return now_ns - self._behind_ns.get(partition, 0) < BEHIND_NS

    def walked_again(self, partition: int, mark: int) -> int:
        """Take note of a message that is walked.

        Returns:
            How many were walked a second time, with the first message behind them; else 0.
        """
        again = self._again.get(partition)
        if again is None:
            return 0
        if mark <= again.until:
            again.count += 1
            return 0
        del self._again[partition]
        return again.count
