"""Finds messages that a bag holds twice, since its files overlap or one is a copy of another."""

import numpy as np
from numpy.typing import NDArray

from fltea.recording.files import AT_ONCE
from fltea.recording.sample_times import Marks
from fltea.recording.spool import Spool

FACTORS = np.random.default_rng(1).integers(1 << 62, 1 << 63, 6, dtype=np.uint64) | np.uint64(1)
"""Random odd factors for a hash of a message's six numbers (three rates, three accelerations)."""


def held_twice(spool: Spool) -> Marks | None:
    """Mark the messages (n,) that repeat an earlier message of the bag.

    If a bag holds a part twice, the times step backwards where the copy begins. So return None if the times
    never step backwards. Each step backwards begins a new run of messages. A message is marked if an equal
    message is in an earlier run; `bag_gather` finds equal neighbours within a run. Messages are equal if all
    their numbers and their times are equal. The time is the stamp, or without a stamp the arrival time.

    `spool`: columns `gyro`, `accel`, `stamp` [ns] and `arrival` [ns].
    """
    if not spool.length("stamp"):
        return None
    stamp_ns, arrival_ns = spool.whole("stamp"), spool.whole("arrival")
    when_ns = np.where(stamp_ns != 0, stamp_ns, arrival_ns)
    run = np.cumsum(np.diff(when_ns, prepend=when_ns[:1]) < 0)
    if not run[-1]:
        return None
    numbers = np.concatenate(
        [_as_one(gyro, accel) for gyro, accel in spool.blocks(("gyro", "accel"), AT_ONCE)]
    )
    order = np.lexsort((numbers, when_ns))
    when_ns, numbers = when_ns[order], numbers[order]
    begins = np.ones(len(order), np.bool_)
    begins[1:] = (np.diff(when_ns) != 0) | (numbers[1:] != numbers[:-1]) | (when_ns[1:] <= 0)
    first = order[begins][np.cumsum(begins) - 1]
    twice = np.zeros(len(order), np.bool_)
    twice[order] = run[order] != run[first]
    return twice


def _as_one(gyro: NDArray[np.float64], accel: NDArray[np.float64]) -> NDArray[np.uint64]:
    bits = np.ascontiguousarray(np.column_stack([gyro, accel])).view(np.uint64)
    with np.errstate(over="ignore"):
        return np.asarray((bits * FACTORS).sum(axis=1, dtype=np.uint64))
