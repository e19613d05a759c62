"""Tests that surplus rows between two samples of an even clock are found. Such rows come from another sensor
or from a second clock.
"""

from pathlib import Path

import numpy as np
import pytest
from fltea.recording.sample_times import EVENNESS, Floats, between
from fltea.recording.table import FEWEST_BETWEEN
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.rig.text_files import refusal, stored

N = 400
SEEDS = st.integers(0, 1 << 20)
PERIODS = st.sampled_from([1.0, 0.01, 1 / 333, 5000.0, 1e7])
"""Sampling periods in the unit of some column of times: seconds, microseconds or nanoseconds."""

NOWHERE = st.sets(st.integers(1, N - 2), max_size=40)


def jitter(seed: int, most: float) -> np.ndarray:
    """Return a random shift for each of the N times, in sampling periods.

    `most`: the shifts change the step between two times by at most this many periods.
    """
    return np.random.default_rng(seed).uniform(-most / 2, most / 2, N)


def even(period: float) -> Floats:
    return np.arange(N, dtype=np.float64) * period


def with_rows(times: np.ndarray, places: set[int], seed: int, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Insert the time of a surplus row after each sample in `places`, before the following sample. Return all
    times, and a mark for each surplus one.
    """
    phases = np.random.default_rng(seed).uniform(0.22, 0.78, len(places))
    extra = times[sorted(places)] + phases * period
    both = np.concatenate([times, extra])
    order = np.argsort(both)
    return both[order], order >= len(times)


@given(SEEDS, PERIODS, NOWHERE, st.floats(0, 1e12))
def test_extra_rows_are_found_and_only_these(
    seed: int, period: float, places: set[int], begin: float
) -> None:
    assume(begin < 1e6 * period)
    times, extra = with_rows(begin + even(period), places, seed, period)
    assert between(times, period).tolist() == extra.tolist()


@given(SEEDS, PERIODS, NOWHERE)
def test_they_are_found_where_the_clock_is_not_quite_even(seed: int, period: float, places: set[int]) -> None:
    """Surplus rows are also found if the steps of the clock differ by 4 %. With such steps, times still count
    as those of a sensor's clock.
    """
    alone = {place for place in places if not {place - 1, place - 2} & places}
    times, extra = with_rows((np.arange(N) + jitter(seed, 0.04)) * period, alone, seed, period)
    assert between(times, period).tolist() == extra.tolist()


@given(SEEDS, PERIODS, st.floats(0, EVENNESS / 2 - 1e-3), st.sets(st.integers(1, N - 2), max_size=N // 2))
def test_jitter_and_missing_rows_are_not_touched(
    seed: int, period: float, most: float, missing: set[int]
) -> None:
    times = np.delete((np.arange(N) + jitter(seed, 2 * most)) * period, [*missing])
    assert not between(times, period).any()


@given(PERIODS, st.integers(1, N - 2), st.floats(0.21, 0.79))
def test_a_row_that_comes_late_is_a_sample(period: float, place: int, late: float) -> None:
    """A late row is a sample and not surplus, since its two neighbours are two periods apart."""
    times = even(period)
    times[place] += late * period
    assert not between(times, period).any()


@given(PERIODS, st.integers(1, N - 2), st.integers(2, 30))
def test_rows_behind_a_pause_are_samples(period: float, place: int, lost: int) -> None:
    times = even(period)
    times[place:] += lost * period
    assert not between(times, period).any()


@given(PERIODS, st.integers(2, N - 2))
def test_repeated_times_are_left_to_what_looks_for_them(period: float, place: int) -> None:
    times = even(period)
    times = np.sort(np.r_[times, times[place]])
    assert between(times, period).sum() <= 1
    kept = times[~between(times, period)]
    assert np.unique(kept).tolist() == even(period).tolist()


@pytest.mark.parametrize("count", [0, 1, 2])
def test_a_few_rows_tell_nothing(count: int) -> None:
    assert between(even(0.3)[:count], 1.0).tolist() == [False] * count


# --- in files ---


def text(times: np.ndarray, values: np.ndarray) -> str:
    rows = (f"{time:.7f},{value:.4f}\n" for time, value in zip(times, values, strict=True))
    return "time_s,gyro_x_dps\n" + "".join(rows)


@pytest.mark.parametrize("share", [0.01, 0.03, 0.05])
@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 416.0])
def test_a_file_has_the_rate_and_the_samples_of_its_sensor(
    share: float, rate_hz: float, tmp_path: Path
) -> None:
    """Rows that a logger interpolated between two samples are left out. If they counted, the samples would
    look filtered, and the sampling rate would be too high.
    """
    n = 3000
    random = np.random.default_rng(5)
    truth = np.round(random.normal(size=n), 4)
    places = set(random.choice(np.arange(1, n - 2), int(share * n), replace=False).tolist())
    times, extra = with_rows(np.arange(n) / rate_hz, places, 9, 1 / rate_hz)
    values = np.empty(len(times))
    values[~extra] = truth
    values[extra] = np.interp(times[extra], times[~extra], truth)
    found = stored(tmp_path, text(times, values))
    whole = found.whole()
    assert whole.gyro.ravel().tolist() == truth.tolist()
    assert whole.seq is not None
    assert whole.seq.tolist() == [*range(n)]
    assert found.samples == n
    assert found.rate_hz == pytest.approx(rate_hz, rel=1e-3)
    (note,) = found.notes
    assert f"{len(places)} rows stand between two samples of an even clock, and are left out" in note.text


def test_a_clock_with_many_rows_between_is_none(tmp_path: Path) -> None:
    """If every tenth step between samples contains a surplus row, the times have no recognisable period, and
    are refused as uneven.
    """
    times, _ = with_rows(np.arange(3000) / 100, {*range(2, 2998, 10)}, 3, 0.01)
    assert "the steps of 'time_s' are too uneven for a sensor's clock" in refusal(
        tmp_path, text(times, np.sin(times))
    )


def test_fewer_than_a_few_are_jitter(tmp_path: Path) -> None:
    n = 2000
    for count in (FEWEST_BETWEEN - 1, FEWEST_BETWEEN):
        times, _ = with_rows(np.arange(n) / 100, {*range(5, 5 + 50 * count, 50)}, 1, 0.01)
        found = stored(tmp_path, text(times, np.random.default_rng(1).normal(size=len(times))))
        is_told = any("stand between two samples" in note.text for note in found.notes)
        assert is_told == (count == FEWEST_BETWEEN)
        assert len(found.whole().gyro) == (n if is_told else n + count)
