"""Messages that are on their way to the broker.

Of QoS 0 nobody says what arrived, but a later acknowledgement of the same connection proves it.
"""

from typing import NamedTuple


class Message(NamedTuple):
    """retain: it is a state, said with each new connection. again: sent again if its connection is lost."""

    topic: str
    payload: bytes
    retain: bool = False
    again: bool = False
    qos: int = 1


class Flight:
    """What one connection has been given and the broker has not acknowledged; its length is their number."""

    def __init__(self) -> None:
        self._unacknowledged: dict[int, tuple[Message, int]] = {}
        self._unsure = self._sure = 0

    def __len__(self) -> int:
        return self._unsure - self._sure + len(self._unacknowledged)

    @property
    def messages(self) -> list[Message]:
        """Those that the broker will acknowledge."""
        return [message for message, _ in self._unacknowledged.values()]

    def began(self, mid: int, message: Message) -> None:
        """A message was handed over; mid: its number, if its QoS has one."""
        if message.qos:
            self._unacknowledged[mid] = (message, self._unsure)
        else:
            self._unsure += 1

    def arrived(self, mid: int) -> Message | None:
        """The message that was acknowledged; None for one of QoS 0, which the socket alone acknowledges."""
        entry = self._unacknowledged.pop(mid, None)
        if entry is None:
            return None
        message, before = entry
        self._sure = max(self._sure, before)
        return message

    def end(self) -> tuple[int, list[Message]]:
        """The connection is gone: how many of QoS 0 nobody knows of, and what was not acknowledged."""
        unsure, messages = self._unsure - self._sure, self.messages
        self._unacknowledged, self._unsure, self._sure = {}, 0, 0
        return unsure, messages
