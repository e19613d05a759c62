"""Send messages to a broker, and count those that wait, are not acknowledged, or are lost.

A broker does not acknowledge messages of QoS 0. But when it acknowledges a message of QoS 1, all messages of
QoS 0 that were sent earlier on the same connection have arrived, too.
"""

import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from fltea.mqtt.connection import POLL_S, Acknowledged, Up
from fltea.mqtt.link import Link
from fltea.records.ports import Report

BACKLOG = 1000
"""While there is no connection, at most this number of messages with rare records wait. If there are more,
the oldest ones are dropped.
"""

IN_FLIGHT = 2000
"""At most this number of messages may have been sent without an acknowledgement. As long as there are so
many, the network is too slow, and new messages of frequent records (such as samples) are lost.
"""


class Message(NamedTuple):
    """A message to publish.

    `retain`: whether the message is a state, which is published again on each new connection. `again`: if the
    connection is lost before the message is acknowledged, whether the message is sent again.
    """

    topic: str
    payload: bytes
    retain: bool = False
    again: bool = False
    qos: int = 1


class Flight:
    """The messages sent over one connection that are not acknowledged yet. `len` returns their number."""

    def __init__(self) -> None:
        self._unacknowledged: dict[int, tuple[Message, int]] = {}
        self._unsure = self._sure = 0

    def __len__(self) -> int:
        return self._unsure - self._sure + len(self._unacknowledged)

    @property
    def messages(self) -> list[Message]:
        """Those messages of QoS 1 that the broker has not acknowledged yet."""
        return [message for message, _ in self._unacknowledged.values()]

    def began(self, mid: int, message: Message) -> None:
        """Note that a message was sent. `mid`: number of the message, which is not used for QoS 0."""
        if message.qos:
            self._unacknowledged[mid] = (message, self._unsure)
        else:
            self._unsure += 1

    def arrived(self, mid: int) -> Message | None:
        """Note that the message number `mid` is acknowledged, and return this message.

        Return None for a message of QoS 0. The broker does not acknowledge such a message; the library only
        says that it was written to the socket.
        """
        entry = self._unacknowledged.pop(mid, None)
        if entry is None:
            return None
        message, before = entry
        self._sure = max(self._sure, before)
        return message

    def end(self) -> tuple[int, list[Message]]:
        """Forget all messages, since the connection has ended.

        Return how many messages of QoS 0 may be lost, and the unacknowledged messages of QoS 1.
        """
        unsure, messages = self._unsure - self._sure, self.messages
        self._unacknowledged, self._unsure, self._sure = {}, 0, 0
        return unsure, messages


class Delivery:
    """Sends messages over the connection to a broker, and counts the lost ones.

    `introduce`: function that publishes the states of the device on a new connection. `lost`: number of
    messages that no broker accepted, or whose arrival is uncertain.
    """

    def __init__(self, link: Link, report: Report, introduce: Callable[[], None]) -> None:
        self._link, self._report, self._introduce = link, report, introduce
        self.lost = 0
        self._lost_before: int | None = None
        self._waiting: deque[Message] = deque()
        self._flight = Flight()
        self._refusal_reported = False

    def begin(self) -> None:
        """Begin to send the messages of another device.

        A refusal by the broker is reported once for each device.
        """
        self._refusal_reported = False

    def state(self, message: Message) -> None:
        """Publish a state if there is a connection.

        Otherwise `introduce` publishes it on the next connection.
        """
        if self._link.up:
            self._publish(message)

    def stream(self, message: Message) -> None:
        """Publish a frequent message, which is lost if the broker is away or too slow."""
        if self._link.up:
            self.lost += not (len(self._flight) < IN_FLIGHT and self._publish(message))
        elif not self._link.in_outage and len(self._waiting) < BACKLOG:
            # the first connection will soon be open, so the message waits for it
            self._waiting.append(message)
        else:
            self.lost += 1

    def keep(self, message: Message) -> None:
        """Publish a rare message, which waits if the broker is away."""
        self._waiting.append(message)
        if len(self._waiting) > BACKLOG:
            self._waiting.popleft()
            self.lost += 1

    def send_waiting(self) -> None:
        """Publish waiting messages until too many are unacknowledged."""
        while self._link.up and self._waiting and len(self._flight) < IN_FLIGHT:
            if not self._publish(self._waiting[0]):
                return
            self._waiting.popleft()

    def poll(self) -> None:
        """Handle the events of the connection: its opening, its loss, and acknowledgements."""
        for event in self._link.events():
            if isinstance(event, Acknowledged):
                self._on_acknowledged(event)
            elif isinstance(event, Up):
                self._on_up()
            else:
                if self._lost_before is None:
                    self._lost_before = self.lost
                self._take_back()

    def leave(self, farewell_s: float) -> None:
        """End the connection in an orderly way, so that the broker does not publish the will.

        Wait at most `farewell_s` until the broker has acknowledged all messages.
        """
        deadline_s = time.monotonic() + farewell_s
        self.send_waiting()
        while self._link.up and self._flight.messages and time.monotonic() < deadline_s:
            time.sleep(POLL_S)
            self.poll()
            self.send_waiting()
        if self._link.close(deadline_s):
            self._take_back()

    def give_up(self) -> None:
        """Count the waiting messages as lost, since nothing more is sent."""
        self.lost += len(self._waiting)
        self._waiting.clear()

    def _publish(self, message: Message) -> bool:
        mid = self._link.publish(message.topic, message.payload, message.qos, message.retain)
        if mid is None:
            return False
        self._flight.began(mid, message)
        return True

    def _take_back(self) -> None:
        """Count the messages that were lost with a connection. Keep those that have to be sent again."""
        unsure, messages = self._flight.end()
        self.lost += unsure
        waiting, self._waiting = self._waiting, deque()
        for message in (*[m for m in messages if m.again], *waiting):
            self.keep(message)
        self.lost += sum(not (message.again or message.retain) for message in messages)

    def _on_acknowledged(self, event: Acknowledged) -> None:
        message = self._flight.arrived(event.mid)
        if message is None or event.refusal is None:
            return
        self.lost += not message.retain
        if not self._refusal_reported:
            self._refusal_reported = True
            base = message.topic.rpartition("/")[0]
            text = (
                f"{self._link.broker.address}: the broker does not take {message.topic} ({event.refusal}): "
                f"its access list has to let this user write to {base}/#."
            )
            self._report("broker_refused", text)

    def _on_up(self) -> None:
        away_s = self._link.end_outage()
        lost_before, self._lost_before = self._lost_before, None
        self.send_waiting()  # waiting messages are sent first, since an older status may be among them
        self._introduce()
        if away_s is not None and lost_before is not None:
            lost = self.lost - lost_before
            count = f"{lost} records were lost" if lost else "nothing was lost"
            self._report("broker_back", f"{self._link.broker.address} is back after {away_s:.1f} s; {count}.")
