"""Selects the lines of one sensor from a text that holds the lines of several sensors.

A column that names the sensor shows which sensor a line is from. If there is no such column, and the sensors
alternate regularly, the order of the lines shows this.
"""

import math
from collections.abc import Callable

import numpy as np

from fltea.recording.columns import Chosen, check_sensors
from fltea.recording.dialects import Facts
from fltea.recording.one_sensor import OneSensor, as_word
from fltea.recording.reading import given_options
from fltea.recording.row_layout import Layout
from fltea.recording.table import Rows
from fltea.recording.text_numbers import decoded
from fltea.recording.turns import Turns
from fltea.records.errors import UsageError
from fltea.settings.how import How

FEWEST_LINES, GROWTH, MOST_LINES = 64, 4, 2000
"""It is checked whether live text comes from several sensors. The first check is made after FEWEST_LINES
lines, and a further check each time that the number of lines has grown by the factor GROWTH. After MOST_LINES
lines, no more checks are made.
"""


class SensorLines:
    """Leaves out all lines but those of the chosen sensor.

    `where`: file, for messages. `how`: the user's options.
    """

    def __init__(self, where: str, how: How) -> None:
        self._where, self._how = where, how
        self._sensor: OneSensor | None = None
        self._turns: Turns | None = None
        self._chosen: Chosen | None = None
        self._next_check: float = 0.0

    @property
    def is_known(self) -> bool:
        """Whether a column that distinguishes sensors is known."""
        return self._sensor is not None

    def begin(self, chosen: Chosen, looked_at: int) -> None:
        """Use the columns `chosen`. `looked_at`: number of lines that were known when they were chosen."""
        if self._chosen is None:
            self._chosen = chosen
            more = max(FEWEST_LINES, GROWTH * looked_at)
            self._next_check = math.inf if looked_at >= MOST_LINES else more
            if chosen.turn[1] > 1:
                self._turns = Turns(*chosen.turn, chosen.time_at)
        if self._sensor is None and chosen.sensor is not None:
            place, value = chosen.sensor
            self._sensor = OneSensor(self._where, chosen.names[place], value, given_options(self._how))

    def look_again(self, lines: int, facts: Callable[[list[str]], Facts]) -> None:
        """Check again whether the lines so far are from several sensors, since more lines have come.

        Raises:
            NotStated: there are several sensors, and the user named none.
        """
        chosen = self._chosen
        if (
            chosen is None
            or lines < self._next_check
            or self._how.topic is not None
            or chosen.sensor is not None
        ):
            return
        self._next_check = math.inf if lines >= MOST_LINES else GROWTH * lines
        check_sensors(self._where, chosen, self._how, facts(chosen.names))

    def why_none(self) -> UsageError | None:
        """Return an error if lines were read, but none was from the chosen sensor; else None."""
        return None if self._sensor is None else self._sensor.why_none()

    def only(self, layout: Layout, data: bytes) -> bytes:
        """Return all lines. Lines of other sensors are made empty, so that line numbers stay the same.

        Raises:
            NotStated: there are several sensors, and the user named none.
        """
        if self._sensor is None or layout.chosen.sensor is None:
            return data
        lines = data.split(b"\n")
        values = [_value(layout, layout.chosen.sensor[0], line) for line in lines]
        has = [k for k, value in enumerate(values) if value is not None]
        keep = self._sensor.keep([str(values[k]) for k in has])
        for k in np.asarray(has)[~keep].tolist():
            lines[k] = b""
        return b"\n".join(lines)

    def in_turn(self, rows: list[Rows]) -> list[Rows]:
        """Return the rows of the sensor to read.

        If the rows of several sensors alternate, they are selected from `rows`; otherwise all `rows` are
        returned.
        """
        turns = self._turns
        return rows if turns is None else [one for some in rows for one in turns.take(some)]

    def finish(self) -> list[Rows]:
        """Return the rows that were held back until more rows come. Call this at the end of the text."""
        return [] if self._turns is None else self._turns.finish()


def _value(layout: Layout, place: int, line: bytes) -> str | None:
    """Return the name of the sensor in a line; None if the line has too few fields."""
    if layout.parse is not None:
        try:
            value = layout.parse(decoded(line)).get(layout.chosen.names[place])
        except (ValueError, RecursionError):
            return None
        return as_word(value) if isinstance(value, float) else None if value is None else str(value)
    separator = None if layout.separator is None else layout.separator.encode()
    fields = line.split(separator, place + 1)
    if len(fields) <= place or line[:1] in b"#%":
        return None
    return decoded(fields[place]).strip().strip('"')
