"""Faults of a fleet as `tools.fleet_faults` plays them: nothing is lost without being counted."""

from collections.abc import Callable
from pathlib import Path

import pytest
from mosquitto_support import tool
from support import ROOT

from tools import fleet_faults
from tools.fleet_faults import Outcome, line


@pytest.mark.parametrize(
    ("case", "told"),
    [
        (fleet_faults.disk_full, ["disk_full"]),
        (fleet_faults.fleet_killed, []),
        (fleet_faults.clock_jumps, []),
        (fleet_faults.twins, []),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_everything_is_accounted_for(
    case: Callable[[Path], Outcome], told: list[str], tmp_path: Path
) -> None:
    tool("mosquitto")
    outcome = case(tmp_path)
    assert (outcome.wrong, outcome.told) == ([], told)
    text = (ROOT / "host/fleet.md").read_text(encoding="utf-8")
    assert line(outcome).rpartition(" | ")[0].split(" | ")[0] in text
