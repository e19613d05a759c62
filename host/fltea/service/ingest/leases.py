"""Who serves which partition (pure): leases in a key-value store, and when they may be taken.

Every worker writes its own key and those of its partitions every `RENEW_S`. A lease whose revision has not
changed for `LEASE_S` by the looker's own clock is free: so no clocks have to agree. It is taken by writing it
on the condition that its revision is still the one that was seen; of two that try, the store lets one.
"""

from collections.abc import Iterable, Mapping
from typing import Annotated, NamedTuple

import msgspec

RENEW_S = 1.5
LEASE_S = 6.0
"""A worker that could not renew for so long less two renewals serves no more; others take over after it."""

STOP_S = LEASE_S - 2 * RENEW_S


class Lease(msgspec.Struct, frozen=True):
    """owner: worker, "" if it was given back. done: the last message of the stream that it has walked."""

    owner: str
    done: Annotated[int, msgspec.Meta(ge=0)] = 0


class Seen(NamedTuple):
    """An entry of the store. changed_s: when its revision was seen to change, on the looker's clock."""

    revision: int
    changed_s: float
    value: bytes


class Sightings:
    """Remembers when entries changed."""

    def __init__(self) -> None:
        self._seen: dict[str, Seen] = {}

    def look(self, entries: Mapping[str, tuple[int, bytes]], now_s: float) -> None:
        """Take note of all entries that there are, by key: revision and value."""
        before, self._seen = self._seen, {}
        for key, (revision, value) in entries.items():
            known = before.get(key)
            same = known is not None and known.revision == revision
            self._seen[key] = Seen(revision, known.changed_s if same and known else now_s, value)

    def of(self, key: str) -> Seen | None:
        """Return the newest sighting of an entry."""
        return self._seen.get(key)

    def fresh(self, prefix: str, now_s: float) -> list[str]:
        """Keys below `prefix` that changed within `LEASE_S`."""
        return [
            key
            for key, one in self._seen.items()
            if key.startswith(prefix) and now_s - one.changed_s < LEASE_S
        ]


def lease_of(data: bytes) -> Lease:
    """The lease in an entry; one of nobody for anything else."""
    try:
        return msgspec.json.decode(data, type=Lease)
    except msgspec.DecodeError:
        return Lease("")


def is_free(seen: Seen | None, now_s: float) -> bool:
    """Whether nobody serves the partition of this entry."""
    return seen is None or not lease_of(seen.value).owner or now_s - seen.changed_s >= LEASE_S


def share(partitions: int, workers: int) -> int:
    """How many partitions a worker takes at most."""
    return -(-partitions // max(1, workers))


def surplus(held: Iterable[int], partitions: int, workers: int) -> list[int]:
    """Partitions to give back since there are more workers now: those of the highest numbers."""
    mine = sorted(held)
    return mine[share(partitions, workers) :]
