"""Blocks of samples cut into periods, or put together where nobody sees more than the end (pure).

A wire says how its device is between the samples of one second and those of the next. What comes out at the
end does not depend on where such a message stands, as long as all samples follow on; and a large block costs
hardly more than a small one.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import msgspec
import numpy as np

from fltea.records.events import Event, RawBlock, Tick
from fltea.records.records import Hello
from fltea.records.stats import DeviceStatus
from fltea.stream.place import Place

MOST = 8192
"""Samples that are waited for."""


class Taken(NamedTuple):
    """An event, and the source's offset to Unix time when it came."""

    event: Event
    offset_ns: int


class Gathering:
    """Holds events back until there are many samples. place: where these go."""

    def __init__(self, place: Place) -> None:
        self._place = place
        self._held: list[Taken] = []
        self._samples = 0
        self._goes_on = False  # an epoch may begin with the next samples

    def take(self, event: Event, offset_ns: int) -> Iterator[Taken]:
        """Yield what is to go on now."""
        self._held.append(Taken(event, offset_ns))
        goes_on = True
        if isinstance(event, RawBlock):
            goes_on, self._goes_on = self._goes_on, True
            self._samples += len(event.sequence)
        elif not self._says_nothing_new(event):
            goes_on = self._goes_on = False
        if self._samples >= MOST or not goes_on:
            yield from self.rest()

    def rest(self) -> Iterator[Taken]:
        """Yield what is held back: what came between samples, and these as one block, or all as it came."""
        held, self._held, self._samples = self._held, [], 0
        blocks = [one.event for one in held if isinstance(one.event, RawBlock)]
        if len(blocks) > 1 and _are_alike(blocks):
            whole = RawBlock._make(
                None if columns[0] is None else np.concatenate(columns)
                for columns in zip(*blocks, strict=True)
            )
            if self._place.follow_on(whole):
                others = [one for one in held if not isinstance(one.event, RawBlock)]
                behind = next(k for k, one in enumerate(reversed(held)) if one.event is blocks[-1])
                offset_ns = held[-1 - behind].offset_ns
                others.insert(len(others) - behind, Taken(whole, offset_ns))
                held = others
        yield from held

    def _says_nothing_new(self, event: Event) -> bool:
        known = self._place.hello
        if isinstance(event, Hello) and known is not None:
            return msgspec.structs.replace(event, host_ns=known.host_ns) == known
        return isinstance(event, Tick | DeviceStatus)


def _are_alike(blocks: list[RawBlock]) -> bool:
    """Return whether they have the same columns."""
    kinds = {tuple(None if column is None else column.shape[1:] for column in one) for one in blocks}
    return len(kinds) == 1


def by_period(event: Event, period_ns: int, offset_ns: int) -> Iterator[Any]:
    """Yield the event; samples cut where a period ends, offset_ns after a multiple of it."""
    if not isinstance(event, RawBlock):
        yield event
        return
    first, last = (int(at) - offset_ns for at in (event.host_ns[0], event.host_ns[-1]))
    if len(event.host_ns) <= 2 and first // period_ns == last // period_ns:
        yield event  # as almost always live
        return
    ends = (np.flatnonzero(np.diff((event.host_ns - offset_ns) // period_ns)) + 1).tolist()
    if not ends:
        yield event
        return
    for begin, end in zip([0, *ends], [*ends, len(event.host_ns)], strict=True):
        yield event.rows(begin, end)
