"""Faults of a fleet as `make faults` plays them: nothing is lost without being counted."""

import pytest
from toolchain import needed

from tools.faults.case import play
from tools.faults.fleet import CASES

REPORTED = {
    "broker killed (`kill -9`) and started again": ["broker_lost"],
    "network split for 2 s": [],
    "history's disk full, later room again": ["disk_full", "history_back"],
    "the fleet's program killed (`kill -9`) and started again": [],
    "clock set two days forward, and back": [],
    "two devices with one id": [],
    "10,000 messages, a new device each": [],
}
"""What a fault makes the fleet report; the others last too long to be played here."""


@pytest.mark.slow
@pytest.mark.parametrize("name", REPORTED)
def test_everything_is_accounted_for(name: str) -> None:
    needed("mosquitto")
    outcome = play(next(case for case in CASES if case.name == name))
    assert (outcome.wrong, outcome.uncounted, outcome.reported) == ([], 0, REPORTED[name])
