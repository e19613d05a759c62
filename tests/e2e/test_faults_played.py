"""Play faults as `make faults` does: the program survives all of them, and every sample is accounted for."""

import contextlib
from concurrent.futures import Future
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from host_support import ROOT
from toolchain import missing, needed

from tools.faults.__main__ import PARTS
from tools.faults.case import Case, Outcome, line, play, play_all
from tools.faults.program import Skip
from tools.faults.small_disk import SmallDisk

AT_ONCE = 5
CASES = PARTS["daemon"].cases


class Expected(NamedTuple):
    """What a fault leads to.

    `due`, `lost`, `excused`: None where they depend on the speed of the machine.
    """

    due: int | None = None
    lost: int | None = 0
    excused: int | None = 0
    reported: tuple[str, ...] = ()
    others: str | None = "unaffected"


UNPLUGGED = ("unplugged", "no_port", "restart")
EXPECTED = {
    "unplugged in mid-frame, back as another port": Expected(301, 0, 1, UNPLUGGED),
    "the same, found by its USB id": Expected(301, 0, 1, UNPLUGGED),
    "reset in mid-frame": Expected(301, 0, 1, ("restart",)),
    "another program writes `AT\\r` to the port": Expected(330),
    "`AT\\r` in the stream": Expected(321, 3),
    "another program reads the port too": Expected(380, None),
    "a bit flipped in 1 % of frames": Expected(600, 4),
    "a bit flipped in 1 % of bytes": Expected(600, 65),
    "line stalls 500 ms, then a burst": Expected(350),
    "daemon stopped for 500 ms": Expected(350),
    "daemon stopped until the line is full": Expected(500, None, 0, ("gap",)),
    "sequence and time wrap, 20 samples lost at each": Expected(370, 40),
    "firmware of another protocol version": Expected(420, 0, 120, ("version", "restart")),
    "a contradicting rate": Expected(None, 0, None, ("rate_differs", "restart", "restart")),
    "MQTT broker killed, back after a while": Expected(reported=("broker_lost", "broker_back")),
    "browser killed in mid-stream": Expected(),
    "three open pages that do not read": Expected(),
    "disk full, later room again": Expected(reported=("disk_full", "record_resumed")),
    "a recording's file deleted": Expected(reported=("record_deleted", "record_resumed")),
    "a recording's folder deleted": Expected(reported=("record_deleted", "record_resumed")),
    "`kill -9` while recording": Expected(excused=None, reported=("resumed",), others=None),
    "two daemons on one port": Expected(excused=None, reported=("port_busy", "start")),
    "clock set an hour forward, two back": Expected(500, reported=("restart",)),
}


@pytest.fixture(scope="module")
def playing(request: pytest.FixtureRequest) -> dict[str, "Future[Outcome]"]:
    """Play the requested faults, several at a time, since they mostly wait."""
    wanted = {
        item.callspec.params["case"].name
        for item in request.session.items
        if getattr(item, "callspec", None) and isinstance(item.callspec.params.get("case"), Case)
    }
    return play_all([case for case in CASES if case.name in wanted], short=True, at_once=AT_ONCE)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_it_is_survived_and_everything_is_counted(
    case: Case, playing: dict[str, "Future[Outcome]"], tmp_path: Path
) -> None:
    try:
        outcome = playing[case.name].result()
    except Skip as why:
        missing(str(why))
    expected, reported = EXPECTED[case.name], list(EXPECTED[case.name].reported)
    if "disk_full" in reported:  # where nothing may be mounted, the disk fails in another way
        with contextlib.closing(SmallDisk(tmp_path / "disk")) as disk:
            reported[0] = disk.kind
    assert outcome.wrong == []
    assert outcome.uncounted == 0
    assert outcome.reported == reported
    delivered, lost, *excused = outcome.where.values()
    assert expected.due in (None, outcome.due)
    assert expected.lost in (None, lost)
    assert expected.excused in (None, sum(excused))
    assert all(excused)  # a reason is given wherever a loss is excused
    assert delivered > 0
    if expected.others is not None:
        assert f"other outputs {expected.others}" in outcome.more
    WHAT_ELSE.get(case.name, lambda outcome: None)(outcome)


def bytes_were_taken(outcome: Outcome) -> None:
    assert outcome.figures["bytes taken"] > 0
    assert outcome.where["counted as lost"] > 0


def the_board_dropped_as_many(outcome: Outcome) -> None:
    """Allow for HELLO and STATUS, four of them in two seconds, which can be dropped too."""
    assert 0 <= outcome.figures["frames dropped by the board"] - outcome.where["counted as lost"] <= 6


def messages_were_lost(outcome: Outcome) -> None:
    assert outcome.figures["counted lost"] > 0


def bytes_were_not_recorded(outcome: Outcome) -> None:
    assert outcome.figures["counted as missing"] > 0


def pages_were_open(outcome: Outcome) -> None:
    assert outcome.figures["pages"] == 3
    assert outcome.figures["memory grew by [MB]"] < 20


WHAT_ELSE: dict[str, Any] = {
    "another program reads the port too": bytes_were_taken,
    "daemon stopped until the line is full": the_board_dropped_as_many,
    "MQTT broker killed, back after a while": messages_were_lost,
    "disk full, later room again": bytes_were_not_recorded,
    "a recording's file deleted": bytes_were_not_recorded,
    "a recording's folder deleted": bytes_were_not_recorded,
    "three open pages that do not read": pages_were_open,
}


def test_every_fault_is_expected_and_stands_in_the_documentation() -> None:
    """The documentation also lists the errors that the daemon reports.

    Its other columns are figures of one run.
    """
    assert set(EXPECTED) == {case.name for case in CASES}
    assert set(WHAT_ELSE) <= set(EXPECTED)
    text = (ROOT / "host/docs/guide/running.md").read_text(encoding="utf-8")
    for name, expected in EXPECTED.items():
        begin = line((name, ", ".join(expected.reported) or "–"))
        rows = [row for row in text.splitlines() if row.startswith(begin)]
        assert len(rows) == 1, f"{begin}: make it true again by `make faults ARGS='daemon --long'`"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "reported"),
    [
        ("broker killed (`kill -9`) and started again", ["broker_lost"]),
        ("network split for 2 s", []),
        ("history's disk full, later room again", ["disk_full", "history_back"]),
        ("the fleet's program killed (`kill -9`) and started again", []),
        ("clock set two days forward, and back", []),
        ("two devices with one id", []),
        ("10,000 messages, a new device each", []),
    ],
)
def test_of_a_fleet_everything_is_accounted_for(name: str, reported: list[str]) -> None:
    """The other faults of a fleet take too long to be played here."""
    needed("mosquitto")
    outcome = play(next(case for case in PARTS["fleet"].cases if case.name == name))
    assert (outcome.wrong, outcome.uncounted, outcome.reported) == ([], 0, reported)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("server", "name", "reported", "lost"),
    [
        ("nats-server", "NATS server away for 8 s", {"nats_lost", "nats_back", "partition_taken"}, 0),
        (
            "mosquitto",
            "MQTT broker killed (`kill -9`), started again at once",
            {"broker_lost", "broker_back"},
            None,  # samples sent before the program was back are lost; how many depends on chance
        ),
    ],
)
def test_of_ingest_each_sample_is_accounted_for(
    server: str, name: str, reported: set[str], lost: int | None
) -> None:
    """Boards that keep what they could not send lose nothing; the programs resume without help."""
    needed(server)
    outcome = play(next(case for case in PARTS["ingest"].cases if case.name == name))
    assert (outcome.wrong, outcome.uncounted) == ([], 0)
    assert reported <= set(outcome.reported)
    assert lost in (None, outcome.where["counted as lost"])
