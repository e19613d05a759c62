"""Define what a receiver of messages from many devices offers to the code that processes them."""

from collections.abc import Callable, Iterator
from typing import Protocol

from fltea.diagnostics.asked import AskedSource
from fltea.diagnostics.finding import Finding
from fltea.records.ports import Report
from fltea.service.ingest.inbox import Inbox
from fltea.settings.config import Config


class Shared(Protocol):
    """This worker's part of the partitions of devices, with a store for snapshots of the devices.

    `unix_offset_ns`: what has to be added to `host_ns` to get Unix time by the clock of the server. All
    workers use the server's clock, so their times agree even if their own clocks do not.
    """

    unix_offset_ns: int

    def serves(self, partition: int) -> bool:
        """Return whether this worker may still process messages of a partition."""

    def resume(self, partition: int) -> None:
        """Note that the messages that were left out while `serves` was False now arrive again."""

    def walked(self, partition: int, mark: int) -> None:
        """Note the number `mark` of the partition's last message that was processed."""

    def keep(self, partition: int, device: str, data: bytes) -> bool:
        """Store a snapshot of a device in the background. Return False if there is no room for it now."""

    def drop(self, partition: int, device: str) -> None:
        """Delete the snapshot of a device that is given up, in the background."""


class Receiver(Protocol):
    """Receives messages from a broker and puts them into the inbox."""

    url: str

    @property
    def partitions(self) -> Shared | None:
        """This worker's part of the partitions; None if there is only one worker, and no partitions."""

    @property
    def connected(self) -> bool:
        """Whether the connection to the broker works, so that messages can arrive."""

    def start(self) -> None:
        """Begin to receive messages."""

    def close(self) -> None:
        """Stop receiving messages."""


class ReceiverModule(Protocol):
    """The functions of a module that a row of `SOURCES` names, for a shared source."""

    def receiver_of(self, config: Config) -> Callable[[Inbox, Report], Receiver]:
        """Return a function that makes the receiver. Its arguments are an inbox and a function for reports.

        Raises:
            UsageError: the URL is not the address of a broker.
        """

    def check_source(self, asked: AskedSource) -> Iterator[Finding]:
        """Yield what `fltea doctor` finds about the source, at least one finding."""
