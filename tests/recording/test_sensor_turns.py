"""Tests sensors whose rows alternate: how a table shows this, and which rows belong to one sensor."""

from typing import Any

import numpy as np
import pytest
from fltea.recording.one_sensor import tells_apart
from fltea.recording.table import Rows
from fltea.recording.turns import Turns
from hypothesis import example, given
from hypothesis import strategies as st

N = 200
RNG = np.random.default_rng(12)
ROW = np.arange(400)
NOISE = RNG.normal(size=400)


@pytest.mark.parametrize(
    "column",
    [
        ROW // 5 % 2,
        ROW // 100,
        np.repeat(["walk", "sit"], 200),
        RNG.integers(0, 2, 400),
        RNG.integers(1, 5, 400),
        np.round(25.15 + 0.03 * NOISE, 1),
        (NOISE > 0.5).astype(int),
        np.round(NOISE).astype(int),
        (ROW % 5 == 0).astype(int),
        ROW % 16,
        ROW % 5,
        9 + (NOISE > 1).cumsum() % 3,
        ROW,
        np.ones(400, int),
    ],
)
def test_what_is_no_sensor_is_not_asked_for(column: Any) -> None:
    """Columns with a status, an activity, a rounded temperature, flags, or counters do not distinguish
    sensors, although they hold few different values.
    """
    cells = [str(cell) for cell in column.tolist()]
    values = np.column_stack([ROW / 100, NOISE, RNG.normal(size=400)])
    assert not tells_apart(cells, values[:, 0], values)


@given(
    seed=st.integers(0, 1 << 20),
    values=st.integers(2, 16),
    rows=st.integers(25, 2000),
)
def test_chance_alone_is_no_sensor(seed: int, values: int, rows: int) -> None:
    rng = np.random.default_rng(seed)
    cells = [str(cell) for cell in rng.integers(0, values, rows).tolist()]
    assert not tells_apart(cells, np.arange(rows) / 100, rng.normal(size=(rows, 3)))


@given(
    seed=st.integers(0, 1 << 20),
    count=st.integers(2, 4),
    rows=st.integers(60, 1000),
    lost=st.floats(0, 0.01),
)
def test_sensors_in_turns_are_known_although_rows_are_lost(
    seed: int, count: int, rows: int, lost: float
) -> None:
    rng = np.random.default_rng(seed)
    kept = np.flatnonzero(rng.random(rows) >= lost)
    cells = [str(cell) for cell in (kept % count).tolist()]
    assert tells_apart(cells, None, rng.normal(size=(len(kept), 3)))


def test_sensors_in_packets_and_in_any_order_are_known_by_their_times() -> None:
    """Two sensors are told apart by their times in two cases: each sensor sends packets of rows, or the two
    rows of one time come in either order.
    """
    values = RNG.normal(size=(400, 3))
    packets, times = ROW // 10 % 2, (ROW // 20 * 10 + ROW % 10) / 100
    assert tells_apart([*map(str, packets.tolist())], times, values)
    either = np.column_stack([first := RNG.integers(0, 2, 200), 1 - first]).ravel()
    assert tells_apart([*map(str, either.tolist())], np.repeat(ROW[:200] / 100, 2), values)


def test_two_kinds_of_sensors_are_known_by_their_figures() -> None:
    """Two kinds of sensors, such as gyroscope and accelerometer, are recognised by the size of their values,
    in whatever order their rows come.
    """
    kinds = (RNG.random(400) < 0.2).astype(int)
    values = 0.01 * RNG.normal(size=(400, 3)) + kinds[:, None] * [0.1, 0.2, 9.8]
    assert tells_apart([*map(str, kinds.tolist())], None, values)


@given(
    gone=st.sets(st.integers(0, 2 * N - 1), max_size=20),
    cuts=st.lists(st.integers(0, 2 * N), max_size=6),
    later=st.sampled_from([0.0, 0.2, 0.5]),
    which=st.integers(0, 1),
)
# all rows come in one piece, and row 41 is missing: from there on, the two sensors have changed positions
@example(gone={41}, cuts=[], later=0.2, which=0)
def test_turns_are_kept_in_whatever_pieces_rows_come(
    gone: set[int], cuts: list[int], later: float, which: int
) -> None:
    """Rows of two sensors alternate, and some are missing.

    The rows chosen for one sensor include no row of the other sensor, and no row is repeated. A round is one
    row of each sensor; the first 20 rounds are complete.
    """
    keep = np.array([row for row in range(2 * N) if row < 40 or row not in gone])
    rows = np.column_stack([keep % 2, keep // 2 + later * (keep % 2)]).astype(float)
    turns = Turns(which, 2, 1)
    found = []
    for piece in np.split(np.arange(len(rows)), sorted(min(cut, len(rows)) for cut in cuts)):
        if len(piece):
            found += turns.take(Rows(keep[piece], rows[piece], piece))
    found += turns.finish()
    numbers = np.concatenate([one.numbers for one in found])
    whole = [row for row in keep if later or row ^ 1 in keep]
    assert numbers.tolist() == [row for row in whole if row % 2 == which]
