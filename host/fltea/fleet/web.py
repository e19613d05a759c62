"""The fleet's page, and the JSON that it asks for.

Tornado serves it: bokeh brings it already, and a table of 15,000 rows and some curves need no more than a
page of our own. All that sensors send reaches the page as JSON and is put there as text, never as HTML.
"""

import asyncio
import base64
import hmac
import time
from collections.abc import Callable, Collection
from concurrent.futures import Future
from importlib import resources
from typing import Any

import msgspec
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler

from fltea.fleet.figures import SHOWN
from fltea.fleet.metrics import text_of
from fltea.fleet.program import TURN_S, Fleet
from fltea.fleet.summary import COLUMNS, distribution, groups, rows, table
from fltea.sinks.listening import cannot_listen, is_from_here, is_own, own_names

ASSETS = {"": "page.html", "page.css": "page.css", "page.js": "page.js"}
TYPES = {"html": "text/html", "css": "text/css", "js": "text/javascript"}
MOST_ROWS = 500
WRONG_PASSWORD_S = 0.5
"""How long a wrong password waits for its answer."""

HISTORY_S = 2.0
"""A page waits so long for the history."""

ROWS_S = 2.0
"""The rows of the table are gathered this often at most, however many look at them."""

HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; form-action 'none'; frame-ancestors 'none'; base-uri 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


class Shown:
    """What all requests share. password: USER:PASSWORD, or None. names: under which the page may be asked."""

    def __init__(self, fleet: Fleet, names: Collection[str], password: str | None) -> None:
        self.fleet, self.names = fleet, names
        self.password = None if password is None else password.encode()
        self._rows: tuple[float, list[dict[str, Any]]] = (-ROWS_S, [])

    def rows(self) -> list[dict[str, Any]]:
        """The table as of the last seconds."""
        now = time.monotonic()
        if now - self._rows[0] >= ROWS_S:
            fleet = self.fleet
            with fleet.lock:
                found = rows(fleet.roll, fleet.seen, fleet.clock.hearing(), fleet.plan.silent_s)
            self._rows = now, found
        return self._rows[1]


class _Handler(RequestHandler):
    def initialize(self, shown: Shown) -> None:
        self.shown = shown

    def set_default_headers(self) -> None:
        for name, value in HEADERS.items():
            self.set_header(name, value)
        self.clear_header("Server")

    async def prepare(self) -> None:
        if not is_own(self.request.host, self.shown.names):
            raise HTTPError(421)
        if not is_from_here(self.request.host, self.request.headers.get("Origin")):
            raise HTTPError(403)
        if self.shown.password is not None and not self._knows_password(self.shown.password):
            await asyncio.sleep(WRONG_PASSWORD_S)
            self.set_header("WWW-Authenticate", 'Basic realm="fltea fleet", charset="UTF-8"')
            raise HTTPError(401)

    def _knows_password(self, password: bytes) -> bool:
        scheme, _, given = self.request.headers.get("Authorization", "").partition(" ")
        try:
            found = base64.b64decode(given, validate=True)
        except ValueError:  # no base64, or no ASCII
            return False
        return scheme.lower() == "basic" and hmac.compare_digest(found, password)

    def write_error(self, status_code: int, **kwargs: Any) -> None:
        self.set_header("Content-Type", "text/plain")
        self.finish(f"{status_code} {self._reason}\n")

    def answer(self, found: Any) -> None:
        self.set_header("Content-Type", "application/json")
        self.write(msgspec.json.encode(found))

    async def rows_of(self, asked: "Future[list[dict[str, Any]]]") -> list[dict[str, Any]]:
        """What the history answers; nothing if it takes too long, as while its server is away."""
        try:
            return await asyncio.wait_for(asyncio.wrap_future(asked), HISTORY_S)
        except TimeoutError:
            return []

    def number(self, name: str, usual: int, most: int) -> int:
        text = self.get_argument(name, str(usual))
        if not (text.isascii() and text.isdigit()) or len(text) > 9:
            raise HTTPError(400)
        return min(int(text), most)


class _Asset(_Handler):
    def get(self, name: str) -> None:
        file = ASSETS[name]
        self.set_header("Content-Type", f"{TYPES[file.rpartition('.')[2]]}; charset=utf-8")
        self.write(resources.files(__package__).joinpath(file).read_bytes())


class _Summary(_Handler):
    def get(self) -> None:
        found = self.shown.fleet.summary()
        with self.shown.fleet.lock:
            found["groups"] = groups(self.shown.fleet.seen)
        found["quantities"] = [quantity._asdict() for quantity in SHOWN]
        found["columns"] = COLUMNS
        self.answer(found)


class _Table(_Handler):
    def get(self) -> None:
        sort, order = self.get_argument("sort", "device"), self.get_argument("order", "up")
        if sort not in COLUMNS or order not in ("up", "down"):
            raise HTTPError(400)
        begin, count = self.number("begin", 0, 10**9), self.number("count", 50, MOST_ROWS)
        words = self.get_argument("words", "")[:200]
        total, found = table(self.shown.rows(), sort, "up" if order == "up" else "down", words, begin, count)
        self.answer({"total": total, "rows": found})


class _Distribution(_Handler):
    def get(self) -> None:
        group = (
            self.get_argument("kind", strip=False),
            self.get_argument("axis"),
            self.get_argument("quantity"),
        )
        fleet = self.shown.fleet
        with fleet.lock:
            self.answer(distribution(fleet.roll, fleet.seen, group))


class _Sensor(_Handler):
    async def get(self) -> None:
        found = self._found()
        found["history"] = await self.rows_of(self.shown.fleet.history.of_device(found["device"]))
        self.answer(found)

    def _found(self) -> dict[str, Any]:
        fleet, name = self.shown.fleet, self.get_argument("device", strip=False)
        with fleet.lock:
            sensor = fleet.roll.sensors.get(name)
            if sensor is None:
                raise HTTPError(404)
            now = fleet.clock.hearing()
            found: dict[str, Any] = msgspec.to_builtins(
                {
                    "device": name,
                    "kind": sensor.kind,
                    "state": sensor.state(now, fleet.plan.silent_s),
                    "status": sensor.status,
                    "hello": sensor.hello,
                    "heard_s": round(now - sensor.heard, 1),
                    "messages": sensor.messages,
                    "delivered": sensor.delivered,
                    "lost": sensor.lost,
                    "flooding": sensor.flooding,
                    "twins": sensor.has_twin(now),
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
        self.answer(await self.rows_of(self.shown.fleet.history.alerts()))


class _Metrics(_Handler):
    def get(self) -> None:
        self.set_header("Content-Type", "text/plain; version=0.0.4; charset=utf-8")
        self.write(text_of(self.shown.fleet))


def application(shown: Shown) -> Application:
    """Return the application that answers the page's requests."""
    given = {"shown": shown}
    return Application(
        [
            (r"/(|page\.css|page\.js)", _Asset, given),
            (r"/api/summary", _Summary, given),
            (r"/api/table", _Table, given),
            (r"/api/distribution", _Distribution, given),
            (r"/api/sensor", _Sensor, given),
            (r"/api/alerts", _Alerts, given),
            (r"/metrics", _Metrics, given),
        ],
        log_function=lambda handler: None,
        compress_response=True,
        default_handler_class=_NotFound,
        default_handler_args=given,
    )


class _NotFound(_Handler):
    async def prepare(self) -> None:
        await super().prepare()
        raise HTTPError(404)


def serve(
    fleet: Fleet,
    host: str,
    port: int,
    names: Collection[str],
    password: str | None,
    ready: Callable[[int], None],
    stop: Callable[[IOLoop], None],
) -> None:
    """Serve the page and let the fleet take its turns, until the loop is stopped.

    ready: is given the port. stop: is given the loop, for a signal handler.

    Raises:
        FlteaError: the address cannot be listened at.
    """
    try:
        sockets = bind_sockets(port, host)
    except (OSError, UnicodeError) as error:
        raise cannot_listen("--listen", host, port, error) from error
    server = HTTPServer(application(Shown(fleet, own_names(host, names), password)), max_body_size=0)
    server.add_sockets(sockets)
    loop = IOLoop.current()

    def turn() -> None:
        # Not a PeriodicCallback, which stands still when the wall clock is set back.
        loop.call_later(TURN_S, turn)
        fleet.turn()

    turn()
    stop(loop)
    ready(sockets[0].getsockname()[1])
    try:
        loop.start()
    finally:
        server.stop()
