"""One connection to a broker for many devices, of which each believes that it has its own.

Hundreds of connections would cost a thread each. What is lost by sharing is the last will of each device: a
connection has one, so the program has a status of its own instead.
"""

from collections import deque

from fltea.sinks.mqtt.broker import Broker
from fltea.sinks.mqtt.connection import Acknowledged, Connection, Down, Up, await_end


class View:
    """What a device's sink holds for its connection."""

    def __init__(self, shared: "SharedConnection") -> None:
        self.events: deque[Up | Acknowledged | Down] = deque()
        self._shared = shared

    def publish(self, topic: str, payload: bytes, qos: int, retain: bool) -> int | None:
        """Hand a message over, as `Connection.publish` does."""
        return self._shared.publish(self, topic, payload, qos, retain)

    def close(self) -> None:
        """Leave; the connection goes on for the others."""
        self._shared.leave(self)
        self.events.append(Down("broker_lost", "closed"))


class SharedConnection:
    """Opens the connection when the first view asks for one, and again after it was lost.

    All is called from one thread. will: topic and payload for when the program vanishes.
    """

    def __init__(self, broker: Broker, client_id: str, will: tuple[str, bytes]) -> None:
        self.broker, self._client_id, self._will = broker, client_id, will
        self._connection: Connection | None = None
        self._views: dict[View, None] = {}
        self._mids: dict[int, View] = {}
        self.up = False

    def connect(self) -> View:
        """Return a new view; it gets `Up` when the broker accepts the connection."""
        view = View(self)
        self._views[view] = None
        if self._connection is None:
            self._connection = Connection(self.broker, self._client_id, self._will)
        elif self.up:
            view.events.append(Up())
        return view

    @property
    def waiting(self) -> int:
        """Messages that the broker has not acknowledged."""
        return len(self._mids)

    def pump(self) -> None:
        """Hand the events of the connection to the views."""
        connection = self._connection
        while connection is not None and connection.events:
            event = connection.events.popleft()
            if isinstance(event, Acknowledged):
                view = self._mids.pop(event.mid, None)
                if view is not None:
                    view.events.append(event)
            elif isinstance(event, Up):
                self.up = True
                for view in self._views:
                    view.events.append(event)
            else:
                connection.close()
                self._connection, self.up, connection = None, False, None
                views, self._views = self._views, {}
                self._mids.clear()
                for view in views:
                    view.events.append(event)

    def publish(self, view: View, topic: str, payload: bytes, qos: int, retain: bool) -> int | None:
        """Hand a view's message over."""
        if self._connection is None:
            return None
        mid = self._connection.publish(topic, payload, qos, retain)
        if mid is not None and qos:
            self._mids[mid] = view
        return mid

    def leave(self, view: View) -> None:
        """Forget a view."""
        self._views.pop(view, None)

    def close(self, deadline_s: float) -> None:
        """End the connection, and wait for its end: else the broker would publish the will."""
        connection, self._connection, up = self._connection, None, self.up
        self.up = False
        if connection is not None:
            connection.close()
            if up:
                await_end(connection.events, deadline_s)
