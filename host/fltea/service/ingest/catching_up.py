"""Follow how far a worker is behind in its partitions, and which messages it processes a second time."""

from dataclasses import dataclass

BEHIND_NS = 5 * 10**9
"""Time after a message that had waited in which no device of its partition counts as silent [ns]."""

WAITED_NS = 2 * 10**9
"""A message that waited this long shows that the stream is read late [ns]."""

IN_TIME_NS = 10**9
"""A message that waited less shows that the worker has caught up with the stream [ns]."""


@dataclass
class _Again:
    """Messages of a partition, up to number `until`, that are processed a second time."""

    until: int
    count: int = 0


class CatchingUp:
    """Follows each partition from the message at which another worker left it."""

    def __init__(self) -> None:
        self._again: dict[int, _Again] = {}
        self._caught_up: set[int] = set()
        self._behind_ns: dict[int, int] = {}

    def begin(self, partition: int, done: int) -> None:
        """Begin with a partition; another worker has processed its messages up to number `done`."""
        self._again[partition] = _Again(done)

    def forget(self, partition: int) -> None:
        """Stop serving a partition, or begin again from its start."""
        self._caught_up.discard(partition)
        self._again.pop(partition, None)

    def shows_pressure(self, partition: int, waited_ns: int, now_ns: int) -> bool:
        """Note how long a message waited; return whether that shows that this machine is too slow.

        A stream that is read late shows nothing until the worker has caught up with it.
        """
        if waited_ns >= WAITED_NS:
            self._behind_ns[partition] = now_ns
        if partition in self._caught_up:
            return True
        if waited_ns < IN_TIME_NS:
            self._caught_up.add(partition)
        return False

    def is_behind(self, partition: int, now_ns: int) -> bool:
        """Return whether messages of a partition's devices may still wait in the stream."""
        return now_ns - self._behind_ns.get(partition, 0) < BEHIND_NS

    def walked_again(self, partition: int, mark: int) -> int:
        """Note a message that is processed.

        Returns:
            The number of messages that were processed a second time, at the first message after these; else
            0.
        """
        again = self._again.get(partition)
        if again is None:
            return 0
        if mark <= again.until:
            again.count += 1
            return 0
        del self._again[partition]
        return again.count
