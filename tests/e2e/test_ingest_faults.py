"""Faults of the ingest as `tools.faults` plays them: each sample is delivered, or counted as lost."""

from pathlib import Path

import pytest
from mosquitto_support import tool
from support import ROOT

from tools.faults import ingest, ingest_mqtt, ingest_server
from tools.faults.boards import DEVICES


@pytest.mark.slow
def test_the_server_away_for_longer_than_a_lease(tmp_path: Path) -> None:
    """Boards that keep what they could not send lose nothing; workers go on by themselves."""
    tool("nats-server")
    row = ingest_server.server_away(tmp_path)
    assert row.wrong == []
    assert row.uncounted == 0
    assert {"nats_lost", "nats_back", "partition_taken"} <= set(row.told)
    assert row.where["counted as lost"] == 0
    assert row.where["before a sensor's second message"] == 100 * DEVICES


@pytest.mark.slow
def test_an_mqtt_broker_that_is_killed_and_started_again(tmp_path: Path) -> None:
    """What boards sent before the program was back is counted as lost: how much is chance."""
    tool("mosquitto")
    row = ingest_mqtt.broker_restarted(tmp_path)
    assert row.wrong == []
    assert row.uncounted == 0
    assert {"broker_lost", "broker_back"} <= set(row.told)
    assert row.where["before a sensor's second message"] == 100 * DEVICES


@pytest.mark.parametrize("case", ingest.CASES)
def test_every_fault_stands_in_the_documentation(case: object) -> None:
    assert f"`{case.__name__}`" in (ROOT / "host/docs/guide/ingest.md").read_text(encoding="utf-8")  # type: ignore[attr-defined]
