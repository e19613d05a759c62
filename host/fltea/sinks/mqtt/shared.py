"""Share one connection to a broker among many devices, as if each device had its own connection.

If each of hundreds of devices had its own connection, the program would need hundreds of threads. But a
connection has only one last will, so devices that share a connection have no last wills of their own.
Instead, the last will of the shared connection is a status of the program.
"""

from collections import deque
from collections.abc import Iterator

from fltea.diagnostics.addresses import answers
from fltea.diagnostics.asked import AskedOutput
from fltea.diagnostics.finding import Finding, refused
from fltea.mqtt.broker import Broker
from fltea.mqtt.connection import Acknowledged, Connection, Down, Event, Session, Up, await_end


class View:
    """One device's view of the shared connection. It is used like a `Connection` of the device's own."""

    def __init__(self, shared: "SharedConnection") -> None:
        self.events: deque[Event] = deque()
        self._shared = shared

    def publish(self, topic: str, payload: bytes, qos: int, retain: bool) -> int | None:
        """Publish a message over the shared connection, as `Connection.publish` does."""
        return self._shared.publish(self, topic, payload, qos, retain)

    def close(self) -> None:
        """Stop using the shared connection, which stays open for the other devices."""
        self._shared.leave(self)
        self.events.append(Down("broker_lost", "closed"))


class SharedConnection:
    """Opens the one shared connection when the first device asks for a connection.

    If the connection was lost, opens it again when a device next asks for a connection.

    One thread calls all methods. `will`: topic and payload of the message that the broker publishes if the
    program vanishes.
    """

    def __init__(self, broker: Broker, client_id: str, will: tuple[str, bytes]) -> None:
        self.broker, self._client_id, self._will = broker, client_id, will
        self._connection: Connection | None = None
        self._views: dict[View, None] = {}
        self._mids: dict[int, View] = {}
        self.up = False

    def connect(self) -> View:
        """Return a new `View` of the connection, for one device.

        When the broker has accepted the connection, the view's `events` contain `Up`.
        """
        view = View(self)
        self._views[view] = None
        if self._connection is None:
            self._connection = Connection(self.broker, self._client_id, Session(self._will))
        elif self.up:
            view.events.append(Up())
        return view

    @property
    def waiting(self) -> int:
        """Number of sent messages that the broker has not acknowledged yet."""
        return len(self._mids)

    def pump(self) -> None:
        """Move the events of the shared connection to the views (`View.events`) that they concern."""
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
        """Publish a message for the device to which the view `view` belongs."""
        if self._connection is None:
            return None
        mid = self._connection.publish(topic, payload, qos, retain)
        if mid is not None and qos:
            self._mids[mid] = view
        return mid

    def leave(self, view: View) -> None:
        """Pass no more events to a view, since its device no longer uses the connection."""
        self._views.pop(view, None)

    def close(self, deadline_s: float) -> None:
        """End the connection, and wait until it has ended; otherwise the broker would publish the will."""
        connection, self._connection, up = self._connection, None, self.up
        self.up = False
        if connection is not None:
            connection.close()
            if up:
                await_end(connection.events, deadline_s)


def check_broker(asked: AskedOutput) -> Iterator[Finding]:
    """Yield what is wrong with the settings of the broker, and whether something answers at its address."""
    yield from refused("mqtt", lambda: Broker(asked.program.mqtt))
    host, port, *_ = asked.program.mqtt.address()
    yield answers("mqtt", "broker", host, port)
