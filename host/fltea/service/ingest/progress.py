"""Follow up to which message a worker has processed each of its partitions."""

from collections.abc import Mapping

from fltea.service.ingest.catching_up import CatchingUp
from fltea.service.ingest.inbox import Served
from fltea.service.ingest.receiver import Shared
from fltea.service.ingest.snapshots import Snapshots


class Progress:
    """Follows up to which message a worker has processed each of its partitions.

    `shared`, `snapshots`: this worker's part of the partitions, and the snapshots of their devices; None if
    there is only one worker, and no partitions. `walked`: for each partition, a message number: all messages
    up to this number were processed.
    """

    def __init__(self, shared: Shared | None, snapshots: Snapshots | None) -> None:
        self.shared, self.snapshots = shared, snapshots
        self.catching_up = CatchingUp()
        self.walked: dict[int, int] = {}
        self._left_out = set[int]()

    def serves(self, partition: int) -> bool:
        """Return whether messages of a partition may be processed.

        If a message of the partition was left out, no later one is processed either, until the broker
        delivers the messages that were left out again.
        """
        if self.shared is None or partition in self._left_out or not self.shared.serves(partition):
            self._left_out.add(partition)
        return partition not in self._left_out

    def leave_out(self, partition: int | None) -> None:
        """Remember that a message of a partition was not processed."""
        if partition is not None:
            self._left_out.add(partition)

    def note(self, done: Mapping[int, int]) -> None:
        """Remember up to which message each partition is processed.

        `done`: number of the message, by partition.

        A number is ignored if an earlier message of its partition was left out, which has to come again.
        """
        for partition in done.keys() - self._left_out:
            self._note(partition, done[partition])

    def resume(self, partition: int) -> None:
        """Process a partition again: the broker now delivers the messages that were left out once more."""
        assert self.shared is not None
        self._left_out.discard(partition)
        self.shared.resume(partition)

    def forget(self, partition: int) -> None:
        """Forget a partition, since this worker no longer serves it, or begins with it anew."""
        self._left_out.discard(partition)
        self.catching_up.forget(partition)
        self.walked.pop(partition, None)

    def begin(self, item: Served) -> None:
        """Begin to serve a partition."""
        self._note(item.partition, item.start)
        self.catching_up.begin(item.partition, item.done)

    def _note(self, partition: int, mark: int) -> None:
        assert self.shared is not None
        self.walked[partition] = mark
        self.shared.walked(partition, mark)
