"""Define what an ingest needs from the receiver of its messages."""

from typing import Protocol


class Shared(Protocol):
    """A worker's share of the partitions of devices, and the store of the devices' snapshots.

    `unix_offset_ns`: offset from `host_ns` to the time of the stream, which is the same for all workers,
    whatever their own clocks say.
    """

    unix_offset_ns: int

    def serves(self, partition: int) -> bool:
        """Return whether messages of a partition may still be processed here."""

    def resume(self, partition: int) -> None:
        """Note that the messages which were left out while `serves` was false come again."""

    def walked(self, partition: int, mark: int) -> None:
        """Note the last message that was processed."""

    def keep(self, partition: int, device: str, data: bytes) -> bool:
        """Store a snapshot in the background; return False if there is no room for it now."""

    def drop(self, partition: int, device: str) -> None:
        """Delete the snapshot of a device that is given up, in the background."""


class Receiver(Protocol):
    """Puts messages into the inbox. `partitions`: this worker's share; None with only one worker."""

    url: str

    @property
    def partitions(self) -> Shared | None:
        """This worker's share of the partitions."""

    @property
    def connected(self) -> bool:
        """Whether messages can come now."""

    def start(self) -> None:
        """Begin to receive."""

    def close(self) -> None:
        """Receive no more."""
