"""Decide which worker serves which partition of the devices, by leases in a key-value store.

Every `RENEW_S`, a worker writes its own entry and the entries of its leases, so that the revision numbers of
these entries grow. If another worker sees the same revision of a lease for `LEASE_S`, by its own clock, the
lease is free for that worker. So the clocks of the workers need not agree. A worker takes a free lease by
writing it on the condition that the revision is still the same. If two workers try this, the store lets only
one succeed.
"""

from collections.abc import Iterable, Mapping
from typing import Annotated, NamedTuple

import msgspec

RENEW_S = 1.5
LEASE_S = 6.0
"""Time after which other workers may take over a lease that was not renewed [s].

A worker that cannot renew its lease stops serving the partition after `STOP_S`. `STOP_S` is shorter than
`LEASE_S` by two periods `RENEW_S`, so the worker has stopped before another one takes over.
"""

STOP_S = LEASE_S - 2 * RENEW_S


class Lease(msgspec.Struct, frozen=True):
    """The lease of a partition, by which one worker serves the partition.

    `owner`: name of the worker that holds the lease; empty if the lease was given back. `done`: number of the
    partition's last message that was processed.
    """

    owner: str
    done: Annotated[int, msgspec.Meta(ge=0)] = 0


class Seen(NamedTuple):
    """An entry of the key-value store, as this worker last saw it.

    `changed_s`: time, by this worker's clock, at which it saw the revision change [s].
    """

    revision: int
    changed_s: float
    value: bytes


class Sightings:
    """Remembers for each entry of the key-value store when this worker saw it change."""

    def __init__(self) -> None:
        self._seen: dict[str, Seen] = {}

    def check(self, entries: Mapping[str, tuple[int, bytes]], now_s: float) -> None:
        """Compare the store's entries with those of the last call, and remember them.

        `entries`: all entries that the store has now: for each key, the revision and the value.
        """
        before, self._seen = self._seen, {}
        for key, (revision, value) in entries.items():
            known = before.get(key)
            same = known is not None and known.revision == revision
            self._seen[key] = Seen(revision, known.changed_s if same and known else now_s, value)

    def of(self, key: str) -> Seen | None:
        """Return the entry of a key as this worker last saw it; None if there is no such entry."""
        return self._seen.get(key)

    def fresh(self, prefix: str, now_s: float) -> list[str]:
        """Return the keys that begin with `prefix` and whose entries changed in the last `LEASE_S`."""
        return [
            key
            for key, seen in self._seen.items()
            if key.startswith(prefix) and now_s - seen.changed_s < LEASE_S
        ]


def lease_of(data: bytes) -> Lease:
    """Return the lease that an entry's value holds.

    If the value holds no lease, return a lease without owner.
    """
    try:
        return msgspec.json.decode(data, type=Lease)
    except msgspec.DecodeError:
        return Lease("")


def is_free(seen: Seen | None, now_s: float) -> bool:
    """Return whether no worker holds the lease in this entry."""
    return seen is None or not lease_of(seen.value).owner or now_s - seen.changed_s >= LEASE_S


def share(partitions: int, workers: int) -> int:
    """Return the number of partitions that one worker takes at most."""
    return -(-partitions // max(1, workers))


def surplus(held: Iterable[int], partitions: int, workers: int) -> list[int]:
    """Return the partitions that a worker has to give back.

    These are the partitions with the highest numbers, beyond the number that one worker may serve. `held`:
    partitions that the worker serves.
    """
    mine = sorted(held)
    return mine[share(partitions, workers) :]
