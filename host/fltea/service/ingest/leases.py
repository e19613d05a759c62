"""Decide which worker serves which partition, by leases in a key-value store.

Every worker writes its own key and those of its partitions every `RENEW_S`. A lease whose revision has not
changed for `LEASE_S` by an observer's own clock is free, so no clocks have to agree. A worker takes a lease
by writing it on the condition that its revision is still the one seen; if two try, the store lets one
succeed.
"""

from collections.abc import Iterable, Mapping
from typing import Annotated, NamedTuple

import msgspec

RENEW_S = 1.5
LEASE_S = 6.0
"""Time after which other workers take a lease over; its owner stops two renewals earlier (`STOP_S`) [s]."""

STOP_S = LEASE_S - 2 * RENEW_S


class Lease(msgspec.Struct, frozen=True):
    """A lease. `owner`: the worker, "" if it was given back. `done`: last message that was processed."""

    owner: str
    done: Annotated[int, msgspec.Meta(ge=0)] = 0


class Seen(NamedTuple):
    """An entry of the store. `changed_s`: when its revision was seen to change, on the observer's clock."""

    revision: int
    changed_s: float
    value: bytes


class Sightings:
    """Remembers when the entries of the store changed."""

    def __init__(self) -> None:
        self._seen: dict[str, Seen] = {}

    def check(self, entries: Mapping[str, tuple[int, bytes]], now_s: float) -> None:
        """Note all present entries: for each key its revision and value."""
        before, self._seen = self._seen, {}
        for key, (revision, value) in entries.items():
            known = before.get(key)
            same = known is not None and known.revision == revision
            self._seen[key] = Seen(revision, known.changed_s if same and known else now_s, value)

    def of(self, key: str) -> Seen | None:
        """Return the entry of a key as last seen."""
        return self._seen.get(key)

    def fresh(self, prefix: str, now_s: float) -> list[str]:
        """Return the keys that begin with `prefix` and changed within `LEASE_S`."""
        return [
            key
            for key, seen in self._seen.items()
            if key.startswith(prefix) and now_s - seen.changed_s < LEASE_S
        ]


def lease_of(data: bytes) -> Lease:
    """Return the lease in an entry; a lease without owner for other data."""
    try:
        return msgspec.json.decode(data, type=Lease)
    except msgspec.DecodeError:
        return Lease("")


def is_free(seen: Seen | None, now_s: float) -> bool:
    """Return whether no worker serves the partition of this entry."""
    return seen is None or not lease_of(seen.value).owner or now_s - seen.changed_s >= LEASE_S


def share(partitions: int, workers: int) -> int:
    """Return the most partitions that one worker takes."""
    return -(-partitions // max(1, workers))


def surplus(held: Iterable[int], partitions: int, workers: int) -> list[int]:
    """Return the partitions, those with the highest numbers, to give back since there are more workers."""
    mine = sorted(held)
    return mine[share(partitions, workers) :]
