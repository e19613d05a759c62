"""Selects the messages of one sensor in a topic, by the fields that distinguish several sensors."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fltea.recording.files import listed
from fltea.recording.one_sensor import OneSensor, tells_apart
from fltea.recording.reading import Missing, NotStated
from fltea.recording.sample_times import Floats, Ints, Marks

ALL_ARE_ONE = "1/1"
"""Value of the option --sensor by which the user states that all messages are from one sensor."""

FEWEST = 10
"""A field with another value in each message is taken as a counter if there are at least this many messages.
"""

MOST_LOOKED_AT = 500
"""Only this number of messages at the beginning is searched for fields whose values alternate between
sensors.
"""

PUBLISHER = "publisher"
"""The publisher of a message is treated as one of the message's fields, and this is the name of that field.
"""


def are_at_once(publishers: NDArray[np.str_], arrival_ns: Ints) -> bool:
    """Return whether several publishers send at the same time.

    If they do not, one publisher follows another, as after a restart.
    """
    names, places = np.unique(publishers, return_inverse=True)
    arrivals = [arrival_ns[places == k] for k in range(len(names))]
    spans = sorted((int(one.min()), int(one.max())) for one in arrivals)
    return any(begin < end for (_, end), (begin, _) in pairwise(spans))


class Sensors:
    """Selects the messages of one of the sensors that send on a topic.

    `names`: fields that distinguish sensors. `others`: further fields, which are used only if their values
    alternate as those of several sensors do.
    `value`: sensor that the user names, in the form `FIELD=VALUE` or `VALUE`.
    `which`: question for the user if there are several sensors and the user named none; else None. In this
    case the messages of the first sensor are read.
    """

    def __init__(
        self, where: str, names: Sequence[str], value: str | None, others: Sequence[str] = ()
    ) -> None:
        self._where, self._names, self._value = where, [*names, *others], value
        self._named = len(names)
        self._of: dict[int, OneSensor] | None = {} if value == ALL_ARE_ONE else None
        self._are_publishers: bool | None = None
        self.which: Missing | None = None

    def publishers(self, by: NDArray[np.str_], arrival_ns: Ints) -> NDArray[np.str_]:
        """Return `by`, the publisher of each message, if several publishers send at the same time.

        Otherwise, return an empty text for each message, since publishers do not distinguish sensors then.
        """
        if self._are_publishers is None:
            self._are_publishers = are_at_once(by, arrival_ns)
        return by if self._are_publishers else np.full(len(by), "")

    def keep(self, values: Sequence[NDArray[np.str_]], figures: Floats | None = None) -> Marks:
        """Mark the messages to read, which are the messages of one sensor.

        `values`: for each field in `names` and `others`, its value in each message (n,). `figures`: numbers
        in the same messages (n, columns), by which sensors may differ.
        """
        kept = np.ones(len(values[0]) if values else 0, np.bool_)
        if self._of is None and len(kept):
            self._of = self._choose_fields(values, np.zeros((len(kept), 1)) if figures is None else figures)
        for place, sensor in (self._of or {}).items():
            words = values[place][kept].tolist()
            try:
                ours = sensor.keep(words)
            except NotStated as error:
                self.which = self.which or error.missing[0]
                assert self._of is not None
                self._of[place] = OneSensor(self._where, self._names[place], sensor.value)
                ours = self._of[place].keep(words)
            kept[kept] = ours
        return kept

    def _choose_fields(self, values: Sequence[NDArray[np.str_]], figures: Floats) -> dict[int, OneSensor]:
        """Choose the fields that distinguish sensors, or the field with the value that the user names."""
        column, mark, value = (self._value or "").rpartition("=")
        words = {place: {*one.tolist()} for place, one in enumerate(values)}
        fields = [k for k in range(self._named) if len(words[k]) < max(FEWEST, len(values[k]))]
        first = slice(MOST_LOOKED_AT)
        fields += [
            place
            for place in range(self._named, len(values))
            if tells_apart(values[place][first].tolist(), None, figures[first])
            or (mark and self._names[place] == column)
        ]
        if mark and column in self._names:
            meant: int | None = self._names.index(column)
        else:
            value = self._value or ""
            order = sorted(fields, key=lambda place: (value not in words[place], len(words[place]) == 1))
            meant = next(iter(order), None)
        named = {meant: value} if self._value is not None and meant is not None else {}
        fields.sort(key=lambda place: place not in named)
        return {place: OneSensor(self._where, self._names[place], named.get(place)) for place in fields}

    def lacks(self) -> str:
        """Return a text on the sensors that the topic has, if the sensor that the user names is missing.

        Return "" if the sensor is present, or if the user names none.
        """
        has = [
            f"{self._names[place]} has {listed(sorted(one.others))}"
            for place, one in (self._of or {}).items()
            if one.why_none() is not None
        ]
        is_there = self._value in (None, ALL_ARE_ONE) or (self._of and not has)
        return "" if is_there else "; ".join(has) or "nothing in its messages tells sensors apart"
