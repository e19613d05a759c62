"""Tests of the rows that the live page keeps for its diagrams, in tiers of several time windows.

No recent row is lost, the memory does not grow, and each row summarises exactly the samples of its time.
"""

import numpy as np
import pytest
from fltea.sinks.page.tiers import MOST_ROWS, WINDOWS, Cursor, Tiers
from hypothesis import example, given
from hypothesis import strategies as st

KINDS = ("mean", "max", "min", "mean", "max")


def fill(tiers: Tiers, values: list[float], begin_ms: float = 1e12, step_ms: float = 10.0) -> np.ndarray:
    """Append rows to the tiers, and return them. A row has a time, a number, and three columns with the same
    value, since the tiers merge each of the three in another way.
    """
    rows = np.array([[begin_ms + k * step_ms, k, v, v, v] for k, v in enumerate(values)])
    for row in rows:
        tiers.append(row)
    return rows


@given(st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), min_size=1, max_size=900))
@example([float("nan")] * 300)  # rows of NaN must merge to NaN, since the page would draw a 0 as an estimate
def test_buckets_are_what_their_samples_say(values: list[float]) -> None:
    tiers = Tiers(KINDS)
    rows = fill(tiers, values)
    for window in (0, 1):
        width_ms = WINDOWS[window].bucket_ms
        buckets = rows[:, 0] // width_ms
        found = tiers.read(window, Cursor()).values
        complete = np.unique(buckets)[:-1]
        assert len(found) == len(complete)
        for row, bucket in zip(found, complete, strict=True):
            inside = rows[buckets == bucket]
            good = inside[np.isfinite(inside[:, 2]), 2]
            assert row[1] == inside[-1, 1]
            assert np.isfinite(row[0])
            if not good.size:
                assert np.isnan(row[2:]).all()
                continue
            assert (row[2], row[4]) == (good.min(), good.max())
            # a row of a longer window averages the means of shorter rows, which may differ from the mean of
            # all samples
            if window == 0:
                assert row[0] == pytest.approx(inside[:, 0].mean())
                assert row[3] == pytest.approx(good.mean(), rel=1e-9, abs=1e-6)


@given(st.lists(st.integers(0, 500), min_size=1, max_size=6), st.integers(0, 2))
def test_a_reader_gets_every_row_once(bursts: list[int], window: int) -> None:
    tiers = Tiers(KINDS)
    cursor, read, k = Cursor(), [], 0
    for number, burst in enumerate(bursts):
        for _ in range(burst):
            tiers.append(np.array([1e12 + 10.0 * k, k, 0.0, 0.0, 0.0]))
            k += 1
        new = tiers.read(window, cursor)
        assert new.fresh == (number == 0)
        cursor = new.cursor
        read += new.values[:, 1].tolist()
    assert read == tiers.read(window, Cursor()).values[:, 1].tolist()


def test_long_past_is_bounded_and_reaches_back_as_far_as_it_says() -> None:
    tiers = Tiers(KINDS)
    fill(tiers, [0.0] * 5_000, step_ms=25_000.0)  # the rows span 35 hours
    for number in range(len(WINDOWS)):
        new = tiers.read(number, Cursor())
        assert len(new.values) <= MOST_ROWS
    day = tiers.read(4, Cursor()).values[:, 0]
    assert day[-1] - day[0] == pytest.approx(WINDOWS[4].length_s * 1e3, rel=0.01)


def test_cut_separates_what_was_from_what_comes_at_every_resolution() -> None:
    tiers = Tiers(KINDS)
    rows = fill(tiers, [1.0] * 1000)
    tiers.cut(rows[-1, 0] + 5)
    fill(tiers, [2.0] * 1000, begin_ms=rows[-1, 0] + 60_000)
    for window in range(3):
        values = tiers.read(window, Cursor()).values[:, 3]
        gaps = np.flatnonzero(np.isnan(values))
        assert gaps.size == 1
        assert set(values[: gaps[0]]) == {1.0}
        assert set(values[gaps[0] + 1 :]) == {2.0}


def test_after_clearing_readers_begin_anew() -> None:
    tiers, other = Tiers(KINDS), Tiers(KINDS)
    fill(tiers, [1.0] * 10)
    cursor = tiers.read(0, Cursor()).cursor
    assert not tiers.read(0, cursor).fresh
    assert other.read(0, cursor).fresh, "a cursor of another table is no cursor of this one"
    tiers.clear()
    assert tiers.read(0, cursor).fresh
    assert tiers.read(0, cursor).values.size == 0
