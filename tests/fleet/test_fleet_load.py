"""Tests of the simulated fleet for load tests: its fits are those of a daemon, and only its bad sensors are
outliers.
"""

import msgspec
import numpy as np
import pytest
from fltea.fleet.alerts import CHECKS, Alerts
from fltea.fleet.roll import Roll
from fltea.fleet.summary import Comparison, compare, counts, rows, table
from fltea.records.fit import AxisFit

from tools import fleet_fits, fleet_load
from tools.fleet_fits import NOISES, fits


def numbers(one: object) -> list[float]:
    """Return all numbers of a record, in order."""
    if isinstance(one, dict | list):
        return [
            number for part in (one.values() if isinstance(one, dict) else one) for number in numbers(part)
        ]
    return [one] if isinstance(one, float) else []


@pytest.mark.parametrize("kind", ["white, flicker, random walk", "fractional"])
def test_a_scaled_fit_is_the_fit_of_scaled_samples(kind: str) -> None:
    record = NOISES[kind].draw(50_000, np.random.default_rng(5))
    one, other = (next(fits(factor * record, [len(record)])) for factor in (1.0, 4.0))
    scaled = fleet_fits.scaled(one, 4.0)
    assert scaled.verdict == other.verdict
    assert numbers(msgspec.to_builtins(scaled)) == pytest.approx(
        numbers(msgspec.to_builtins(other)), rel=1e-6
    )


def fleet(sensors: int, bad: int) -> tuple[Roll, list[fleet_load.Bad]]:
    """Return the load generator's fleet, without a broker."""
    roll, ones = Roll(), fleet_load.bad_ones(sensors, bad)
    for place in range(sensors):
        one = fleet_load.sensor(place, ones)
        for kind, payload in (("hello", one.hello), ("status", one.status), ("fit", b"1000".join(one.fit))):
            roll.take(f"fltea/{one.device_id}/{kind}", payload, 0.0)
    return roll, ones


@pytest.mark.parametrize(("sensors", "bad"), [(100, 3), (200, 3), (300, 6), (150, 0)])
def test_the_bad_ones_are_exactly_those_that_stand_out(sensors: int, bad: int) -> None:
    roll, ones = fleet(sensors, bad)
    seen = compare(roll, 1.0)
    found = {(int(odd.device_id, 16), odd.axis) for odd in seen.odd}
    assert found == {(one.place, one.axis) for one in ones}
    assert len(counts(roll, 1.0)["axes"]) >= 9  # the sensors have at least nine different verdicts
    assert not roll.bad
    assert compare(roll, 1000.0).odd == []  # after 1,000 s all sensors are silent, so they are not compared
    if (sensors, bad) == (200, 3):
        assert {one.quantity for one in seen.odd} >= {"N", "density", "B", "K"}
        total, first = table(rows(roll, seen, 1.0), "K", "down", "odd", 0, 50)
        assert (total, first[0]["device"]) == (3, f"{57:032x}")
        _, fourth = table(rows(roll, seen, 1.0), "device", "up", "", 3, 1)
        assert [row["device"] for row in fourth] == [f"{1:032x}"]


def test_an_alert_needs_three_looks_and_ends_after_three() -> None:
    roll, _ = fleet(60, 1)
    alerts, seen, nothing = Alerts(), compare(roll, 1.0), Comparison([], {})
    told = [alerts.update(roll, seen, 1.0, float(number)) for number in range(CHECKS)]
    # the third comparison that finds the outlier raises two alerts: for its N and for its density of white
    # noise
    assert [len(one) for one in told] == [0, 0, 2]
    assert {alert.state for alert in told[-1]} == {"raised"}
    assert len(alerts.raised()) == 2
    told = [alerts.update(roll, nothing, 1.0, float(number)) for number in range(CHECKS)]
    assert [len(one) for one in told] == [0, 0, 2]
    assert alerts.raised() == []
    alerts.update(roll, seen, 1.0, 9.0)
    alerts.update(roll, nothing, 1.0, 9.0)
    # the difference did not last long enough for an alert
    assert not [alerts.update(roll, seen, 1.0, 9.0) for _ in range(CHECKS - 1)][-1]


def test_a_fleet_of_any_size_shares_a_few_fits() -> None:
    made: set[str] = set()
    for place in range(400):
        parts = fleet_load.sensor(place, []).fit
        for axis in msgspec.json.decode(b"1".join(parts))["axes"].values():
            made.add(msgspec.convert(axis, AxisFit).text)
    assert len(made) <= fleet_fits.USUAL_FITS + fleet_fits.RELAXING_FITS + 2 * len(fleet_fits.OTHER)
