"""Share one connection to a broker among many devices, as if each had its own.

Hundreds of connections would need a thread each. Sharing costs each device's last will, since a connection
has only one; the program has a status of its own instead.
"""

from collections import deque

from fltea.mqtt.broker import Broker
from fltea.mqtt.connection import Acknowledged, Connection, Down, Event, Session, Up, await_end


class View:
    """A device's part of the shared connection; used like a `Connection`."""

    def __init__(self, shared: "SharedConnection") -> None:
        self.events: deque[Event] = deque()
        self._shared = shared

    def publish(self, topic: str, payload: bytes, qos: int, retain: bool) -> int | None:
        """Pass a message on, as `Connection.publish` does."""
        return self._shared.publish(self, topic, payload, qos, retain)

    def close(self) -> None:
        """Leave the connection, which stays open for the other devices."""
        self._shared.leave(self)
        self.events.append(Down("broker_lost", "closed"))


class SharedConnection:
    """Opens the connection when the first view asks for one, and again after it was lost.

    One thread calls all methods. `will`: topic and payload that are published if the program vanishes.
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
            self._connection = Connection(self.broker, self._client_id, Session(self._will))
        elif self.up:
            view.events.append(Up())
        return view

    @property
    def waiting(self) -> int:
        """Number of messages that the broker has not acknowledged."""
        return len(self._mids)

    def pump(self) -> None:
        """Pass the events of the connection on to the views."""
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
        """Pass a view's message on."""
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
        """End the connection, and wait for its end, since otherwise the broker would publish the will."""
        connection, self._connection, up = self._connection, None, self.up
        self.up = False
        if connection is not None:
            connection.close()
            if up:
                await_end(connection.events, deadline_s)
