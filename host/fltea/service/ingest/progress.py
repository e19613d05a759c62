"""Follow up to which message a worker has processed each of its partitions."""

from collections.abc import Mapping

from fltea.service.ingest.catching_up import CatchingUp
from fltea.service.ingest.inbox import Served
from fltea.service.ingest.receiver import Shared
from fltea.service.ingest.snapshots import Snapshots


class Progress:
    """Follows up to which message a worker has processed each of its partitions.

    `shared`: this worker's part of the partitions. `snapshots`: the snapshots of their devices. Both are None
    for a broker without partitions, which has only one worker. `walked`: for each partition, a message
    number. All messages up to this number were processed.
    """

    def __init__(self, shared: Shared | None, snapshots: Snapshots | None) -> None:
        self.shared, self.snapshots = shared, snapshots
        self.catching_up = CatchingUp()
        self.walked: dict[int, int] = {}
        self._left_out = set[int]()

    def serves(self, partition: int) -> bool:
        """Return whether messages of a partition may be processed.

        If a message of the partition was skipped, all later ones are skipped, too. This ends when the broker
        delivers the skipped messages a second time (`resume`).
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

        A partition of which a message was skipped is ignored, since processing goes on from that message.
        """
        for partition in done.keys() - self._left_out:
            self._note(partition, done[partition])

    def resume(self, partition: int) -> None:
        """Process a partition again, since the broker now delivers the skipped messages a second time."""
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
