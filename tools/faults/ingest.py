"""Faults of the ingest: of a worker, of the NATS server, of an MQTT broker."""

from collections.abc import Iterator

from tools.faults import ingest_mqtt, ingest_server, ingest_worker
from tools.faults.played import played
from tools.faults.row import Row
from tools.faults.sample_books import PART

CASES = (*ingest_worker.CASES, *ingest_server.CASES, *ingest_mqtt.CASES)


def rows(words: list[str]) -> Iterator[Row]:
    """One of each case."""
    return played(PART, CASES, words, at_once=2)
