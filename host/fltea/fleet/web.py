"""The web server for the fleet's page, and for the JSON data that the page requests.

All texts from sensors are sent to the page as JSON and shown as plain text, never as HTML.
"""

import asyncio
import time
from collections.abc import Callable, Collection
from concurrent.futures import Future
from http import HTTPStatus
from typing import Any

import msgspec
from tornado.ioloop import IOLoop
from tornado.web import HTTPError

from fltea.fleet.figures import SHOWN
from fltea.fleet.metrics import metrics_text
from fltea.fleet.program import TURN_S, Fleet
from fltea.fleet.summary import COLUMNS, distribution, groups, rows, table
from fltea.sinks.listening import own_names
from fltea.sinks.web.door import Door, LibraryErrors, bind
from fltea.sinks.web.handler import Handler, Site

MOST_ROWS = 500

REQUESTS_A_SECOND = 50.0
"""Largest number of requests per second; an open page sends five requests every five seconds."""

FULL = "More requests than the fleet's page answers: 50 a second. It is tried again in a moment."

HISTORY_S = 2.0
"""Longest wait of a request for the history [s]."""

ROWS_S = 2.0
"""Least time between two computations of the table's rows [s], for any number of open pages."""


class FleetSite(Site):
    """The data that all requests for the fleet's page share."""

    def __init__(self, fleet: Fleet, names: Collection[str], password: str | None) -> None:
        super().__init__(__package__, names, fleet.report, REQUESTS_A_SECOND, FULL, password)
        self.fleet = fleet
        self._rows: tuple[float, list[dict[str, Any]]] = (-ROWS_S, [])

    def rows(self) -> list[dict[str, Any]]:
        """Return the rows of the table, computed at most `ROWS_S` ago."""
        now = time.monotonic()
        if now - self._rows[0] >= ROWS_S:
            fleet = self.fleet
            with fleet.lock:
                found = rows(fleet.roll, fleet.seen, fleet.clock.hearing(), fleet.plan.silent_s)
            self._rows = now, found
        return self._rows[1]


class _Handler(Handler):
    site: FleetSite

    @property
    def fleet(self) -> Fleet:
        return self.site.fleet

    async def rows_of(self, asked: "Future[list[dict[str, Any]]]") -> list[dict[str, Any]]:
        """Return rows of the history; an empty list if they take too long, for instance during an outage."""
        try:
            return await asyncio.wait_for(asyncio.wrap_future(asked), HISTORY_S)
        except TimeoutError:
            return []


class _Summary(_Handler):
    def get(self) -> None:
        found = self.fleet.summary()
        with self.fleet.lock:
            found["groups"] = groups(self.fleet.seen)
        found["quantities"] = [quantity._asdict() for quantity in SHOWN]
        found["columns"] = COLUMNS
        self.answer(found)


class _Table(_Handler):
    def get(self) -> None:
        sort, order = self.get_argument("sort", "device"), self.get_argument("order", "up")
        if sort not in COLUMNS or order not in ("up", "down"):
            raise HTTPError(HTTPStatus.BAD_REQUEST)
        begin, count = self.number("begin", 0, 10**9), self.number("count", 50, MOST_ROWS)
        words = self.get_argument("words", "")[:200]
        total, found = table(self.site.rows(), sort, "up" if order == "up" else "down", words, begin, count)
        self.answer({"total": total, "rows": found})


class _Distribution(_Handler):
    def get(self) -> None:
        group = (
            self.get_argument("kind", strip=False),
            self.get_argument("axis"),
            self.get_argument("quantity"),
        )
        fleet = self.fleet
        with fleet.lock:
            self.answer(distribution(fleet.roll, fleet.seen, group))


class _Sensor(_Handler):
    async def get(self) -> None:
        found = self._found()
        found["history"] = await self.rows_of(self.fleet.history.of_device(found["device"]))
        self.answer(found)

    def _found(self) -> dict[str, Any]:
        fleet, name = self.fleet, self.get_argument("device", strip=False)
        with fleet.lock:
            sensor = fleet.roll.sensors.get(name)
            if sensor is None:
                raise HTTPError(HTTPStatus.NOT_FOUND)
            now = fleet.clock.hearing()
            found: dict[str, Any] = msgspec.to_builtins(
                {
                    "device": name,
                    "kind": sensor.kind,
                    "state": sensor.state(now, fleet.plan.silent_s),
                    "status": sensor.status,
                    "hello": sensor.hello,
                    "heard_s": round(now - sensor.heard, 1),
                    "messages": sensor.rate.messages,
                    "delivered": sensor.delivered,
                    "lost": sensor.lost,
                    "flooding": sensor.rate.flooding,
                    "twins": sensor.fits.has_twin(now),
                    "errors": [(round(now - at, 1), kind, text) for at, kind, text in sensor.errors],
                    "axes": {
                        axis: {
                            "verdict": one.verdict,
                            "text": one.text,
                            "unit": one.unit,
                            "figures": one.shown | one.figures,
                        }
                        for axis, one in sensor.axes.items()
                    },
                    "odd": [one for one in fleet.seen.odd if one.device_id == name],
                }
            )
        return found


class _Alerts(_Handler):
    async def get(self) -> None:
        self.answer(await self.rows_of(self.fleet.history.alerts()))


class _Metrics(_Handler):
    def get(self) -> None:
        self.set_header("Content-Type", "text/plain; version=0.0.4; charset=utf-8")
        self.write(metrics_text(self.fleet))


ROUTES = [
    ("/api/summary", _Summary),
    ("/api/table", _Table),
    ("/api/distribution", _Distribution),
    ("/api/sensor", _Sensor),
    ("/api/alerts", _Alerts),
    ("/metrics", _Metrics),
]


def serve(
    fleet: Fleet,
    host: str,
    port: int,
    names: Collection[str],
    password: str | None,
    ready: Callable[[int], None],
    stop: Callable[[IOLoop], None],
) -> None:
    """Serve the page and call `fleet.turn` regularly, until the event loop is stopped.

    `ready`: function that is called with the port once the server listens.
    `stop`: function that is called with the event loop; it installs the signal handlers that stop the loop.

    Raises:
        FlteaError: the server cannot listen at the address.
    """
    sockets = bind("--listen", host, port)
    LibraryErrors(fleet.report)
    site = FleetSite(fleet, own_names(host, names), password)
    door = Door(sockets, site.application(ROUTES), fleet.report)
    loop = IOLoop.current()

    def turn() -> None:
        # A PeriodicCallback would stop working when the wall clock is set back.
        loop.call_later(TURN_S, turn)
        fleet.turn()

    turn()
    stop(loop)
    ready(sockets[0].getsockname()[1])
    try:
        loop.start()
    finally:
        door.close()
