"""Tests of leases: a worker processes a partition (a share of the devices) while it holds the partition's
lease. When may a worker take a lease, and how many does each worker take?
"""

from fltea.service.ingest.leases import LEASE_S, Lease, Sightings, is_free, lease_of, share, surplus
from hypothesis import given
from hypothesis import strategies as st
from msgspec import json


def test_a_lease_is_free_once_nobody_has_renewed_it_by_the_lookers_clock() -> None:
    sightings, lease = Sightings(), json.encode(Lease("other", 5))
    assert is_free(sightings.of("lease.0"), 0)
    for now_s in (0.0, 2.0, 4.0):
        sightings.check({"lease.0": (int(now_s), lease), "worker.a": (1, b"")}, now_s)
    assert not is_free(sightings.of("lease.0"), 4 + LEASE_S - 0.1)
    assert is_free(sightings.of("lease.0"), 4 + LEASE_S)
    assert sightings.fresh("worker.", LEASE_S - 0.1) == ["worker.a"]
    assert not sightings.fresh("worker.", LEASE_S)
    sightings.check({"lease.0": (9, json.encode(Lease("", 5)))}, 5.0)
    assert is_free(sightings.of("lease.0"), 5.0), "it was given back"
    assert lease_of(b"rubbish") == Lease("")


@given(st.integers(1, 64), st.integers(1, 70))
def test_all_partitions_are_served_and_none_by_two(partitions: int, workers: int) -> None:
    free, held = set(range(partitions)), [set[int]() for _ in range(workers)]
    # The workers take their leases one after the other. In use, the store of leases ensures this.
    for mine in held:
        while free and len(mine) < share(partitions, workers):
            mine.add(free.pop())
    assert not free
    assert sum(map(len, held)) == partitions
    alone = set(range(partitions))
    back = surplus(alone, partitions, workers)
    assert len(alone) - len(back) == share(partitions, workers)
    assert not surplus(held[0], partitions, workers)
