"""What the loop of an ingest needs of whoever receives its messages."""

from typing import Protocol


class Shared(Protocol):
    """A worker's share of the partitions that devices belong to, and the store of their snapshots.

    unix_offset_ns: what to add to `host_ns` for the time of the stream, which is the same for all workers,
    whatever their own clocks say.
    """

    unix_offset_ns: int

    def serves(self, partition: int) -> bool:
        """Whether messages of a partition may still be walked here."""

    def resume(self, partition: int) -> None:
        """Take note that the messages come again that were left out while `serves` was false."""

    def walked(self, partition: int, mark: int) -> None:
        """Take note of the last message that was walked."""

    def keep(self, partition: int, device: str, data: bytes) -> bool:
        """Store a snapshot, in the background; False if there is no room for it now."""

    def drop(self, partition: int, device: str) -> None:
        """Delete the snapshot of a device that is given up, in the background."""


class Receiver(Protocol):
    """Puts messages into the inbox. partitions: those of several workers; None where there is one only."""

    url: str

    @property
    def partitions(self) -> Shared | None:
        """This worker's share."""

    @property
    def connected(self) -> bool:
        """Whether messages can come now."""

    def start(self) -> None:
        """Begin to receive."""

    def close(self) -> None:
        """Receive no more."""
