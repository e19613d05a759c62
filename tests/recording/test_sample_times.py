"""Tests times that begin again: fractions of a second at each second, counters that wrap, and boards that
restart.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from fltea.recording.sample_times import SECONDS, Elapsed
from fltea.settings.how import TimeUnit
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.text_files import refusal, stored

UNITS: st.SearchStrategy[TimeUnit] = st.sampled_from(["ms", "us", "ns"])
RATES = st.sampled_from([10.0, 50.0, 104.0, 200.0, 1000.0])


def elapsed_of(times: np.ndarray, unit: TimeUnit, cuts: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Convert times that arrive in pieces, cut at `cuts`, to elapsed times. Return these, and the indices at
    which a new run of the device begins.
    """
    elapsed = Elapsed(unit)
    places = [0, *sorted({cut for cut in cuts if 0 < cut < len(times)}), len(times)]
    found = [
        elapsed.add(times[a:b], np.arange(a, b, dtype=float)[:, np.newaxis]) for a, b in pairwise(places)
    ]
    return np.concatenate([one for one, _ in found]), np.concatenate([marks for _, marks in found])


@given(UNITS, RATES, st.floats(0, 1), st.integers(1, 40), st.lists(st.integers(0, 2000), max_size=5))
def test_parts_of_a_second_go_on_at_each_second(
    unit: TimeUnit, rate_hz: float, begin_s: float, lost: int, cuts: list[int]
) -> None:
    """A column that holds only the fraction of a second becomes continuous time, correct as long as less than
    half a second is missing.
    """
    k = np.arange(600)
    k[300:] += min(lost, int(0.4 * rate_hz))
    true = np.floor((begin_s + k / rate_hz) / SECONDS[unit])
    times = true % round(1 / SECONDS[unit])
    elapsed, begins = elapsed_of(times, unit, cuts)
    assert elapsed == pytest.approx(true - true[0], rel=1e-12)
    assert not begins.any()


@given(UNITS, RATES, st.lists(st.integers(0, 2000), max_size=5), st.integers(3, 30))
def test_a_board_that_restarts_after_seconds_begins_a_new_run(
    unit: TimeUnit, rate_hz: float, cuts: list[int], seconds: int
) -> None:
    first = np.floor((5 + np.arange(round(seconds * rate_hz)) / rate_hz) / SECONDS[unit])
    second = np.floor((0.1 + np.arange(200) / rate_hz) / SECONDS[unit])
    elapsed, begins = elapsed_of(np.concatenate([first, second]), unit, cuts)
    assert np.flatnonzero(begins).tolist() == [len(first)]
    assert (np.diff(elapsed) >= 0).all()


@pytest.mark.parametrize("name", ["nsecs", "header.stamp.nanosec", "time [ns]"])
def test_a_file_with_parts_of_seconds_alone_is_one_run(name: str, tmp_path: Path) -> None:
    lost = {250, 251, 400}
    k = np.array([one for one in range(1000) if one not in lost])
    rows = "".join(f"{t},{v}\n" for t, v in zip(k * 10_000_000 % 10**9, np.sin(k), strict=True))
    text, how = f"{name},gyro_x_dps\n{rows}", {}
    # a column named as nanoseconds holds the fraction of a second, so the seconds should be in another column
    if "nanosec" in name:
        assert "nothing says the rate" in refusal(tmp_path, text)
        how = {"time_column": name, "time_unit": "ns"}
    found = stored(tmp_path, text, **how)
    whole = found.whole()
    assert found.rate_hz == pytest.approx(100)
    assert whole.seq is not None
    assert whole.seq.tolist() == k.tolist()
    assert whole.epoch is None or not np.any(whole.epoch)


@pytest.mark.parametrize("lost", [100, 300, 1000])
@pytest.mark.parametrize("form", ["%.2f", "%.3f"])
def test_samples_that_are_lost_evenly_are_lost(tmp_path: Path, lost: int, form: str) -> None:
    """Times in hundredths of a second, of which every hundredth is missing, could also be those of a sensor
    at 99 Hz.

    The times are read as 100 Hz with lost rows, since 99 Hz is an unusual rate.
    """
    rows = [f"{form % (k / 100)},{k % 3},{k % 5}\n" for k in range(4000) if k % lost != lost - 1]
    found = stored(tmp_path, "time_s,gx_dps,gy_dps\n" + "".join(rows))
    assert found.rate_hz == pytest.approx(100.0, rel=1e-6)
    assert found.samples == len(rows)
