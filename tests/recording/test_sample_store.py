"""Tests the store in which the samples of tables and bags are gathered."""

import numpy as np
import pytest
from fltea.recording.columns import Chosen
from fltea.recording.files import AT_ONCE
from fltea.recording.sample_store import SampleStore
from fltea.recording.which_unit import Unit
from fltea.records.errors import UsageError
from fltea.settings.limits import Limits

CHOSEN = Chosen(["x", "y", "z"], (0, 1, 2), Unit("dps"))
NUMBERS = 7


def added(rows: int, *, accel: np.ndarray, limits: Limits | None = None) -> SampleStore:
    """Return a sample store to which rows were added 1,000 at a time. The angular rates are 0 except in row
    3.
    """
    store = SampleStore(CHOSEN, NUMBERS, limits or Limits())
    gyro = np.zeros((rows, 3))
    gyro[3] = 0.5
    for begin in range(0, rows, 1000):
        part = slice(begin, begin + 1000)
        row = np.arange(rows)[part]
        store.add(gyro[part], accel[part], {"row": row}, lambda k, row=row: f"row {row[k]}")
    return store


def test_more_samples_than_the_limit_allows_are_refused_where_they_begin() -> None:
    limits = Limits(max_mb=0.1)
    fits = limits.whole_bytes // (NUMBERS * 8)
    assert len(added(fits, accel=np.zeros((fits, 3)), limits=limits)) == fits
    with pytest.raises(UsageError, match=rf"^row {fits}: .*replay\.max_mb"):
        added(fits + 1, accel=np.zeros((fits + 1, 3)), limits=limits)


def test_what_never_changes_and_what_no_sensor_gives_is_known() -> None:
    accel = np.zeros((2500, 3))
    accel[[1200, 1300], 1] = np.nan, 1e9
    store = added(2500, accel=accel)
    assert (store.bad_accel.count, store.bad_accel.first) == (2, "row 1200")
    assert store.moving == {"gyro", "accel"}
    assert not store.is_whole
    assert added(2500, accel=np.zeros((2500, 3))).moving == {"gyro"}


def test_samples_that_are_not_kept_are_gone_from_all_columns() -> None:
    rows = AT_ONCE + 100
    store = added(rows, accel=np.ones((rows, 3)))
    kept = np.arange(rows) % 3 == 0
    store.keep(("gyro", "accel", "row"), (kept[at : at + AT_ONCE] for at in range(0, rows, AT_ONCE)))
    assert len(store) == store.spool.length("accel") == kept.sum()
    assert (store.spool.whole("row") == np.flatnonzero(kept)).all()
