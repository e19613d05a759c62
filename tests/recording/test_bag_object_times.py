"""Tests times of objects in bags (JSON): their unit, and when they tell no rate."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea.recording.reading import NotStated
from fltea.recording.ros_bag import open_bag
from fltea.recording.sample_times import SECONDS
from fltea.records.errors import UsageError
from fltea.settings.how import How, TimeUnit

from tests.rig.bag_at_rest import RATE_HZ, STAMPS, N, at_rest
from tests.rig.bag_support import START_NS, told, write_objects


def stamped(times: Sequence[Any], name: str = "timestamp") -> list[dict[str, Any]]:
    return [{name: t, "gyro_dps": row} for t, row in zip(times, at_rest().tolist(), strict=True)]


def two_numbers(form: str) -> list[dict[str, Any]]:
    """Return messages whose time is in two fields; two seconds of them are missing."""
    kept = [k for k in range(N) if not 400 <= k < 800]
    rows = at_rest().tolist()
    found = []
    for k in kept:
        ns = STAMPS[k] - STAMPS[0] // 10**9 * 10**9
        s, ms, us = ns // 10**9, ns // 10**6, ns // 1000
        times: dict[str, dict[str, Any]] = {
            "sec, msec": {"sec": s, "msec": ms % 1000},
            "stamp": {"stamp": {"secs": s, "usecs": us % 10**6}},
            "both": {"time_s": ns / 1e9, "time_us": us},
            "both ms": {"time_s": ns / 1e9, "time_ms": ms},
            "coarse": {"time_s": s, "time_us": us},
        }
        found.append({**times[form], "gyro_dps": rows[k]})
    return found


@pytest.mark.parametrize("form", ["sec, msec", "stamp", "both", "both ms"])
def test_the_second_number_of_a_time_is_a_part_of_the_first_or_a_whole_time(
    form: str, tmp_path: Path
) -> None:
    """If it is a whole time in another unit, it is not added to the first."""
    arrivals = [stamp for k, stamp in enumerate(STAMPS) if not 400 <= k < 800]
    stored = open_bag(write_objects(tmp_path / "a.mcap", two_numbers(form), arrivals))
    assert stored.rate_hz == pytest.approx(RATE_HZ)
    seq = stored.whole().seq
    assert seq is not None
    assert seq[-1] == N - 1


def test_stamps_of_whole_seconds_are_no_clock(tmp_path: Path) -> None:
    arrivals = [stamp for k, stamp in enumerate(STAMPS) if not 400 <= k < 800]
    stored = open_bag(write_objects(tmp_path / "a.mcap", two_numbers("coarse"), arrivals))
    assert stored.rate_hz == pytest.approx(RATE_HZ)
    assert "stamps in a row are the same, so the times of arrival are used" in told(stored)["bag_stamps"]


@pytest.mark.parametrize("more", [{}, {"sec": 1_700_000_000}])
def test_messages_without_a_field_of_times_are_not_said_to_have_stamps(
    more: dict[str, int], tmp_path: Path
) -> None:
    some = [{**more, "gyro_dps": row} for row in at_rest().tolist()]
    stored = open_bag(write_objects(tmp_path / "a.mcap", some, STAMPS))
    said = "no field of the messages is known as their time, so the times of arrival are used"
    assert said in told(stored)["bag_stamps"]
    zero = open_bag(write_objects(tmp_path / "b.mcap", stamped([0] * N, "timestamp_ns"), STAMPS))
    assert "the stamps of all message headers are 0" in told(zero)["bag_stamps"]


@pytest.mark.parametrize("unit_s", [1.0, 1e-3, 1e-6, 1e-9])
def test_arrivals_tell_the_unit_of_times(tmp_path: Path, unit_s: float) -> None:
    """The board counts the time from power-up in an unknown unit. Some stamps are missing."""
    kept = np.delete(np.arange(N), [100, 101])
    times = (3.0 + kept / RATE_HZ) / unit_s
    some = [
        one for k, one in enumerate(stamped(((3.0 + np.arange(N) / RATE_HZ) / unit_s).tolist())) if k in kept
    ]
    arrivals = [STAMPS[k] + 1_000_000 for k in kept]
    stored = open_bag(write_objects(tmp_path / "a.mcap", some, arrivals))
    assert len(times) == stored.samples
    assert stored.rate_hz == pytest.approx(RATE_HZ, rel=1e-6)
    assert stored.notes == ()


def test_a_unit_of_times_that_nothing_tells(tmp_path: Path) -> None:
    some = stamped((np.arange(N) * 7.0).tolist())  # the times grow by 7 per message, in no known unit
    stored = open_bag(write_objects(tmp_path / "a.mcap", some, STAMPS))
    assert stored.rate_hz == pytest.approx(RATE_HZ)
    assert (
        "nothing says the unit of timestamp (--time-unit ?), so the times of arrival are used"
        in told(stored)["bag_stamps"]
    )
    given_ms = open_bag(write_objects(tmp_path / "b.mcap", some, STAMPS), How(time_unit="ms"))
    assert given_ms.rate_hz == pytest.approx(1000 / 7)
    named = stamped((np.arange(N) * 5000).tolist(), "timestamp_us")
    path = write_objects(tmp_path / "c.mcap", named, STAMPS)
    with pytest.raises(
        UsageError, match=r"timestamp_us is 1e-06 s by its name.*--time-unit ms says otherwise"
    ):
        open_bag(path, How(time_unit="ms"))
    assert open_bag(path, How(time_unit="ms", overrule=True)).rate_hz == pytest.approx(0.2)


@pytest.mark.parametrize(("unit", "period"), [("us", 5.0), ("s", 5.0), ("ms", 5000.0), ("ms", 0.005)])
def test_a_unit_of_times_against_the_arrivals(tmp_path: Path, unit: TimeUnit, period: float) -> None:
    path = write_objects(tmp_path / "a.mcap", stamped((np.arange(N) * period).tolist()), STAMPS)
    with pytest.raises(UsageError, match=r"by the times of arrival it is 200 Hz\. Leave --time-unit out"):
        open_bag(path, How(time_unit=unit))
    assert open_bag(path).rate_hz == pytest.approx(RATE_HZ)
    overruled = open_bag(path, How(time_unit=unit, overrule=True))
    assert overruled.rate_hz == pytest.approx(1 / (period * SECONDS[unit]))


def test_a_stated_unit_of_times_against_the_arrivals(tmp_path: Path) -> None:
    path = write_objects(tmp_path / "a.mcap", stamped((np.arange(N) * 5.0).tolist(), "timestamp_us"), STAMPS)
    with pytest.raises(UsageError, match=r"is 200000 Hz, and by .* 200 Hz\. .*: --time-unit \? --overrule"):
        open_bag(path)
    assert open_bag(path, How(time_unit="ms", overrule=True)).rate_hz == pytest.approx(RATE_HZ)
    in_minutes = stamped((np.arange(N) / RATE_HZ / 60).tolist(), "time [min]")
    assert open_bag(write_objects(tmp_path / "b.mcap", in_minutes, STAMPS)).rate_hz == pytest.approx(RATE_HZ)


def test_times_that_no_gyroscope_has_tell_no_rate(tmp_path: Path) -> None:
    """A converter that writes all messages at once stamps them with the time of writing, so the user is asked
    for the rate.
    """
    at_once = [START_NS + 40 * k for k in range(N)]
    bare = [{"gyro_dps": row} for row in at_rest().tolist()]
    path = write_objects(tmp_path / "a.mcap", bare, at_once)
    with pytest.raises(NotStated, match=r"nothing says the rate: .* 4e-08 s apart.*: --rate \?"):
        open_bag(path)
    assert open_bag(path, How(rate_hz=50.0)).rate_hz == 50.0
    bare = [{"gyro": row} for row in at_rest().tolist()]
    with pytest.raises(NotStated, match=r"the unit of gyro_x.*; and the rate.*: --units \? --rate \?\n"):
        open_bag(write_objects(tmp_path / "b.mcap", bare, at_once))
    fast = stamped((np.arange(N) * 10.0).tolist(), "timestamp_us")
    with pytest.raises(UsageError, match="is 100000 Hz, and no gyroscope has that"):
        open_bag(write_objects(tmp_path / "c.mcap", fast, at_once))


def test_dates_are_times(tmp_path: Path) -> None:
    dates = [f"2023-11-14T22:13:{k / RATE_HZ:07.4f}Z" for k in range(N)]
    stored = open_bag(write_objects(tmp_path / "a.mcap", stamped(dates), STAMPS))
    assert stored.rate_hz == pytest.approx(RATE_HZ, rel=1e-6)
    assert stored.notes == ()
