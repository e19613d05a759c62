"""Messages on their way to a broker: what waits, what is sent and not acknowledged, and what is lost.

Nobody acknowledges a message of QoS 0, but a later acknowledgement of the same connection proves its arrival.
"""

import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from fltea.records.ports import Report
from fltea.sinks.mqtt.connection import POLL_S, Acknowledged, Up
from fltea.sinks.mqtt.link import Link

BACKLOG = 1000
"""Rare records that are kept while the broker is away; the oldest go first."""

IN_FLIGHT = 2000
"""Messages that the broker has not yet acknowledged; beyond it new ones are lost: the network is too slow."""


class Message(NamedTuple):
    """A message that is published.

    retain: it is a state, published with each new connection. again: sent again if its connection is lost.
    """

    topic: str
    payload: bytes
    retain: bool = False
    again: bool = False
    qos: int = 1


class Flight:
    """What one connection was given and the broker has not acknowledged; its length is their number."""

    def __init__(self) -> None:
        self._unacknowledged: dict[int, tuple[Message, int]] = {}
        self._unsure = self._sure = 0

    def __len__(self) -> int:
        return self._unsure - self._sure + len(self._unacknowledged)

    @property
    def messages(self) -> list[Message]:
        """Messages that the broker will acknowledge."""
        return [message for message, _ in self._unacknowledged.values()]

    def began(self, mid: int, message: Message) -> None:
        """Take note that a message was handed over; mid: its number, if its QoS has one."""
        if message.qos:
            self._unacknowledged[mid] = (message, self._unsure)
        else:
            self._unsure += 1

    def arrived(self, mid: int) -> Message | None:
        """Return the message that was acknowledged; None for QoS 0, which the socket alone acknowledges."""
        entry = self._unacknowledged.pop(mid, None)
        if entry is None:
            return None
        message, before = entry
        self._sure = max(self._sure, before)
        return message

    def end(self) -> tuple[int, list[Message]]:
        """End with the connection: return how many of QoS 0 are unsure, and what was not acknowledged."""
        unsure, messages = self._unsure - self._sure, self.messages
        self._unacknowledged, self._unsure, self._sure = {}, 0, 0
        return unsure, messages


class Delivery:
    """Hands messages to a link, and counts those that are lost.

    introduce: publishes the states of the device, when a new connection is up. lost: messages that no broker
    took, or that nobody can be sure of.
    """

    def __init__(self, link: Link, report: Report, introduce: Callable[[], None]) -> None:
        self._link, self._report, self._introduce = link, report, introduce
        self.lost = 0
        self._lost_before: int | None = None
        self._waiting: deque[Message] = deque()
        self._flight = Flight()
        self._refusal_reported = False

    def begin(self) -> None:
        """Begin with another device: a refusal is reported again."""
        self._refusal_reported = False

    def state(self, message: Message) -> None:
        """Publish a state if the broker is there; else it is published when it comes back."""
        if self._link.up:
            self._publish(message)

    def stream(self, message: Message) -> None:
        """Publish one of many: lost if the broker is away, or does not keep up."""
        if self._link.up:
            self.lost += not (len(self._flight) < IN_FLIGHT and self._publish(message))
        elif not self._link.in_outage and len(self._waiting) < BACKLOG:
            self._waiting.append(message)  # the first connection is being made: a matter of milliseconds
        else:
            self.lost += 1

    def keep(self, message: Message) -> None:
        """Publish what is rare: it waits for the broker."""
        self._waiting.append(message)
        if len(self._waiting) > BACKLOG:
            self._waiting.popleft()
            self.lost += 1

    def send_waiting(self) -> None:
        """Publish what waits, as far as the broker keeps up."""
        while self._link.up and self._waiting and len(self._flight) < IN_FLIGHT:
            if not self._publish(self._waiting[0]):
                return
            self._waiting.popleft()

    def poll(self) -> None:
        """Take note of what happened to the connection and to messages."""
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
        """End the connection, but not before the broker acknowledged all: it may else publish the will."""
        deadline_s = time.monotonic() + farewell_s
        self.send_waiting()
        while self._link.up and self._flight.messages and time.monotonic() < deadline_s:
            time.sleep(POLL_S)
            self.poll()
            self.send_waiting()
        if self._link.close(deadline_s):
            self._take_back()

    def give_up(self) -> None:
        """Count what waits as lost: nothing more is sent."""
        self.lost += len(self._waiting)
        self._waiting.clear()

    def _publish(self, message: Message) -> bool:
        mid = self._link.publish(message.topic, message.payload, message.qos, message.retain)
        if mid is None:
            return False
        self._flight.began(mid, message)
        return True

    def _take_back(self) -> None:
        """The connection is gone: count what nobody acknowledged, keep what is sent again."""
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
        self.send_waiting()  # may hold an older status, so before the newest
        self._introduce()
        if away_s is not None and lost_before is not None:
            lost = self.lost - lost_before
            count = f"{lost} records were lost" if lost else "nothing was lost"
            self._report("broker_back", f"{self._link.broker.address} is back after {away_s:.1f} s; {count}.")
