"""Faults of a fleet as `tools.fleet_faults` plays them: nothing is lost without being counted."""

from collections.abc import Callable
from pathlib import Path

import pytest
from mosquitto_support import tool
from support import ROOT

from tools import fleet_faults
from tools.faults.fleet_stage import Outcome
from tools.fleet_faults import line


def table() -> list[str]:
    """First cells of the rows in the documentation."""
    text = (ROOT / "host/docs/guide/fleet.md").read_text(encoding="utf-8").partition("## Every fault\n")[2]
    rows = [line for line in text.partition("\n## ")[0].splitlines() if line.startswith("| ")]
    return [row.split(" | ")[0] for row in rows[1:]]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "told"),
    [
        (fleet_faults.broker_killed, ["broker_lost"]),
        (fleet_faults.split, []),
        (fleet_faults.disk_full, ["disk_full", "history_back"]),
        (fleet_faults.fleet_killed, []),
        (fleet_faults.clock_jumps, []),
        (fleet_faults.twins, []),
        (fleet_faults.flood, []),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_everything_is_accounted_for(
    case: Callable[[Path], Outcome], told: list[str], tmp_path: Path
) -> None:
    tool("mosquitto")
    outcome = case(tmp_path)
    assert (outcome.wrong, outcome.told) == ([], told)
    assert outcome.due == sum(outcome.where.values())
    assert line(outcome).split(" | ")[0] in table()


def test_every_fault_stands_in_the_documentation() -> None:
    """Those too that last too long to be played here."""
    assert len(table()) == len(fleet_faults.CASES)
