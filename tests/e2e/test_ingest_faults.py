"""Faults of the ingest as `make faults` plays them: each sample is delivered, or counted as lost."""

import pytest
from toolchain import needed

from tools.faults.__main__ import PARTS
from tools.faults.case import play
from tools.faults.ingest_scene import FIRST_MESSAGE
from tools.faults.mqtt_boards import DEVICES

CASES = {case.name: case for case in PARTS["ingest"].cases}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("server", "name", "reported", "lost"),
    [
        ("nats-server", "NATS server away for 8 s", {"nats_lost", "nats_back", "partition_taken"}, 0),
        (
            "mosquitto",
            "MQTT broker killed (`kill -9`), started again at once",
            {"broker_lost", "broker_back"},
            None,  # what boards sent before the program was back: how much is chance
        ),
    ],
)
def test_each_sample_is_accounted_for(server: str, name: str, reported: set[str], lost: int | None) -> None:
    """Boards that keep what they could not send lose nothing; programs go on by themselves."""
    needed(server)
    outcome = play(CASES[name])
    assert (outcome.wrong, outcome.uncounted) == ([], 0)
    assert reported <= set(outcome.reported)
    assert lost in (None, outcome.where["counted as lost"])
    assert outcome.where[FIRST_MESSAGE] == 100 * DEVICES
