"""Follow how late a worker reads the messages of its partitions, and which messages it processes twice.

A partition is the messages of a fixed part of the devices. When a worker takes a partition over, it begins
some messages earlier than the previous worker has stopped, so it processes these messages a second time.
"""

from dataclasses import dataclass

BEHIND_NS = 5 * 10**9
"""After a message of a partition was read late, no device of the partition counts as silent for this time
[ns].
"""

WAITED_NS = 2 * 10**9
"""A message was read late if it waited at least this long [ns]."""

IN_TIME_NS = 10**9
"""If a message waited less than this before it was read, the worker has caught up with its partition [ns]."""


@dataclass
class _Again:
    """Messages of a partition that are processed a second time.

    `until`: number (position in the stream) of the last message that is processed a second time. `count`: how
    many messages were processed a second time so far.
    """

    until: int
    count: int = 0


class CatchingUp:
    """Knows for each partition of a worker how late its messages are read.

    It also counts the messages of the partition that the worker processes a second time.
    """

    def __init__(self) -> None:
        self._again: dict[int, _Again] = {}
        self._caught_up: set[int] = set()
        self._behind_ns: dict[int, int] = {}

    def begin(self, partition: int, done: int) -> None:
        """Begin to serve a partition. `done`: number of its last message that another worker processed."""
        self._again[partition] = _Again(done)

    def forget(self, partition: int) -> None:
        """Forget a partition, since this worker no longer serves it, or begins with it anew."""
        self._caught_up.discard(partition)
        self._again.pop(partition, None)

    def shows_pressure(self, partition: int, waited_ns: int, now_ns: int) -> bool:
        """Note how long a message waited. Return whether this time shows how fast this machine is.

        At first, messages may have waited for another reason, for example because no worker served the
        partition. Until the worker has caught up with these messages, the time does not show how fast the
        machine is.
        """
        if waited_ns >= WAITED_NS:
            self._behind_ns[partition] = now_ns
        if partition in self._caught_up:
            return True
        if waited_ns < IN_TIME_NS:
            self._caught_up.add(partition)
        return False

    def is_behind(self, partition: int, now_ns: int) -> bool:
        """Return whether further messages of the partition may still wait to be read."""
        return now_ns - self._behind_ns.get(partition, 0) < BEHIND_NS

    def walked_again(self, partition: int, mark: int) -> int:
        """Count message number `mark` of a partition if it is processed a second time.

        If the message is the first one that is not, return the number of messages that were processed a
        second time. Otherwise return 0.
        """
        again = self._again.get(partition)
        if again is None:
            return 0
        if mark <= again.until:
            again.count += 1
            return 0
        del self._again[partition]
        return again.count
