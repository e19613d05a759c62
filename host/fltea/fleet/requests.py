"""Decides for which sensors the broker is asked to send its retained messages again."""

from collections.abc import Container, Iterable

from fltea.fleet.roll import Sensor

ASK_AT_ONCE, ASK_TIMES, ASK_EVERY_S = 200, 3, 30.0
"""Limits for requests to the broker to send retained messages again.

One call of `due` returns at most ASK_AT_ONCE sensors. A sensor whose messages do not come is requested at
most ASK_TIMES times. Two requests for one sensor are at least ASK_EVERY_S apart [s].
"""


class Requests:
    """For which sensors the broker was asked, on the newest connection to it, to send messages again."""

    def __init__(self) -> None:
        self._asked: dict[str, tuple[int, float]] = {}
        self._connection = 0

    def __len__(self) -> int:
        return len(self._asked)

    def due(self, sensors: Iterable[Sensor], connection: int, now: float) -> list[str]:
        """Return the sensors whose retained messages are to be requested now.

        These sensors were not yet requested on this connection, or their fit or HELLO did not arrive.

        `connection`: number of the connection to the broker.
        """
        if self._connection != connection:
            self._connection = connection
            self._asked.clear()
        lacking: list[str] = []
        for sensor in sensors:
            name, is_whole = sensor.device_id, bool(sensor.axes) and sensor.hello is not None
            times, due = self._asked.get(name, (0, 0.0))
            if times < (1 if is_whole else ASK_TIMES) and now >= due:
                self._asked[name] = times + 1, now + ASK_EVERY_S
                lacking.append(name)
                if len(lacking) == ASK_AT_ONCE:
                    break
        return lacking

    def has_all(self, sensors: Iterable[Sensor]) -> bool:
        """Return whether each of these sensors was requested."""
        return all(one.device_id in self._asked for one in sensors)

    def keep_only(self, known: Container[str]) -> None:
        """Forget the requests for sensors that are not in `known`."""
        self._asked = {name: asked for name, asked in self._asked.items() if name in known}
