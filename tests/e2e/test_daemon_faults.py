"""The fault script in its short form: every fault is survived, and every sample accounted for."""

import contextlib
import sys
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from support import ROOT
from toolchain import missing

from tools.fault_script import __main__ as command
from tools.fault_script.account import account, check_totals
from tools.fault_script.board import LSB_PER_DPS, Board
from tools.fault_script.cases import CASES, Case, play_all
from tools.fault_script.report import HEADS, line, steady_cells
from tools.fault_script.small_disk import SmallDisk
from tools.fault_script.stage import Outcome, Skip

AT_ONCE = 5


class Expected(NamedTuple):
    """due, lost: None where they depend on how fast the machine is."""

    due: int | None = None
    lost: int | None = 0
    unheard: int | None = 0
    errors: tuple[str, ...] = ()
    epochs: tuple[str, ...] = ()
    others: str | None = "unaffected"


UNPLUGGED = ("unplugged", "no_port")
EXPECTED = {
    "unplugged in mid-frame, back as another port": Expected(301, 0, 1, UNPLUGGED, ("restart",)),
    "the same, found by its USB id": Expected(301, 0, 1, UNPLUGGED, ("restart",)),
    "reset in mid-frame": Expected(301, 0, 1, (), ("restart",)),
    "another program writes `AT\\r` to the port": Expected(330),
    "`AT\\r` in the stream": Expected(321, 3),
    "another program reads the port too": Expected(380, None),
    "a bit flipped in 1 % of frames": Expected(600, 4),
    "a bit flipped in 1 % of bytes": Expected(600, 65),
    "line stalls 500 ms, then a burst": Expected(350),
    "daemon stopped for 500 ms": Expected(350),
    "daemon stopped until the line is full": Expected(500, None, 0, (), ("gap",)),
    "sequence and time wrap, 20 samples lost at each": Expected(370, 40),
    "firmware of another protocol version": Expected(420, 0, 120, ("version",), ("restart",)),
    "MQTT broker killed, back after a while": Expected(errors=("broker_lost", "broker_back")),
    "browser killed in mid-stream": Expected(),
    "three open pages that do not read": Expected(),
    "disk full, later room again": Expected(errors=("disk_full", "record_resumed")),
    "`kill -9` while recording": Expected(unheard=None, epochs=("resumed",), others=None),
    "two daemons on one port": Expected(unheard=None, errors=("port_busy",), epochs=("start",)),
    "clock set an hour forward, two back": Expected(500, epochs=("restart",)),
}


@pytest.fixture(scope="module")
def playing(request: pytest.FixtureRequest) -> dict[str, "Future[Outcome]"]:
    """Those faults that were asked for, some at a time: they mostly wait."""
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
    expected, books = EXPECTED[case.name], outcome.account
    errors = list(expected.errors)
    if "disk_full" in errors:  # where nothing may be mounted, the disk fails in another way
        with contextlib.closing(SmallDisk(tmp_path / "disk")) as disk:
            errors[0] = disk.kind
    assert outcome.wrong == []
    assert books.uncounted == 0
    assert books.due == books.delivered + books.lost + books.unheard
    assert outcome.errors == errors
    assert outcome.epochs == list(expected.epochs)
    for name in ("due", "lost", "unheard"):
        if getattr(expected, name) is not None:
            assert getattr(books, name) == getattr(expected, name), name
    if expected.others is not None:
        assert outcome.others == expected.others
    assert bool(books.unheard) == bool(case.rest)
    WHAT_ELSE.get(case.name, lambda outcome: None)(outcome)


def bytes_were_taken(outcome: Outcome) -> None:
    assert outcome.figures["bytes taken"] > 0
    assert outcome.account.lost > 0


def the_board_dropped_as_many(outcome: Outcome) -> None:
    """HELLO and STATUS, four of them in two seconds, can be dropped too."""
    assert 0 <= outcome.figures["frames dropped by the board"] - outcome.account.lost <= 6


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
    "three open pages that do not read": pages_were_open,
}


def test_every_fault_is_expected_and_stands_in_the_documentation() -> None:
    """What a fault makes the daemon tell is there too; the other columns are figures of one run."""
    assert set(EXPECTED) == {case.name for case in CASES}
    assert set(WHAT_ELSE) <= set(EXPECTED)
    text = (ROOT / "host/docs/guide/running.md").read_text(encoding="utf-8")
    assert line(HEADS) in text
    for case in CASES:
        expected = EXPECTED[case.name]
        told = Outcome(None, list(expected.errors), list(expected.epochs), 0, 0, 0, "", {}, [])  # type: ignore[arg-type]
        begin = f"| {' | '.join(steady_cells(case, told))} |"
        rows = [row for row in text.splitlines() if row.startswith(begin)]
        assert len(rows) == 1, f"{begin}: make it true again by `python -m tools.fault_script --markdown`"
        assert " | 0 | " in rows[0]


# --- the books themselves ---


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Board]:
    one = Board(tmp_path / "board")
    one.boot(sequence=65_530)
    one.send(20)
    yield one
    one.close()


def records(board: Board, *, without: tuple[int, ...] = ()) -> list[dict[str, Any]]:
    """What a daemon that hears all but a few samples writes, and how it sums them up."""
    found: list[dict[str, Any]] = [{"class": "epoch", "epoch": 1, "boot_id": 1}]
    for k, counts in enumerate(board.boots[0].counts):
        rates = [count / LSB_PER_DPS for count in counts]
        if k not in without:
            found.append({"class": "sample", "epoch": 1, "seq": 65_530 + k, "gyro_dps": rates})
    stats = {"delivered": len(found) - 1, "lost": 0, "gaps": 0, "duplicates": 0}
    return [*found, {"class": "stats", "samples": stats}]


def gap(k: int, missing: int) -> dict[str, Any]:
    return {"class": "gap", "epoch": 1, "seq": 65_530 + k, "missing": missing}


def test_books_that_agree(board: Board) -> None:
    assert account(board, [records(board)]) == (20, 20, 0, 0, 0, [])
    assert check_totals(records(board)) == []


def test_a_sample_that_nobody_counted(board: Board) -> None:
    books = account(board, [records(board, without=(7, 8))])
    assert (books.delivered, books.lost, books.unheard, books.uncounted) == (18, 0, 0, 2)
    assert books.wrong[0].startswith("whole on the line, but not delivered")


def test_a_sample_counted_as_lost_that_was_never_on_the_line(board: Board) -> None:
    board.lose(2)
    board.send(1)
    books = account(board, [[*records(board, without=(20, 21)), gap(20, 2)]])
    assert books == (23, 21, 2, 0, 0, [])


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda found: [*found, found[5]], "delivered twice: (0, 4)"),
        (lambda found: [*found, gap(3, 1)], "delivered and lost: [(0, 3)]"),
        (lambda found: [*found, gap(20, 1)], "lost, but nothing after it: [(0, 20)]"),
        (lambda found: [*found, gap(7, 1), gap(7, 1)], "lost twice: [(0, 7)]"),
        (lambda found: [found[0], {**found[3], "gyro_dps": [9, 9, 9]}], "not what was sent: (0, 2)"),
    ],
)
def test_records_that_cannot_be(board: Board, change: Any, text: str) -> None:
    assert any(wrong.startswith(text) for wrong in account(board, [change(records(board))]).wrong)


def test_a_sample_out_of_a_frame_that_was_not_whole(board: Board) -> None:
    board.send(1, lambda data: data[:-1] + b"x\0")
    wrong = account(board, [records(board)]).wrong
    assert wrong == ["delivered, but not whole on the line: [(0, 20)]"]


def test_two_programs_and_what_came_in_between(board: Board) -> None:
    found = records(board)
    books = account(board, [found[:6], [found[0], *found[11:]]])
    assert (books.delivered, books.unheard, books.uncounted, books.wrong) == (15, 5, 0, [])
    assert account(board, [found, found]).wrong == ["two programs used the same sample"]


def test_sums_that_are_no_sums(board: Board) -> None:
    found = [gap(0, 2), *records(board)]
    assert check_totals(found) == [
        "stats.samples.lost is 0, not 2",
        "stats.samples.gaps is 0, not 1",
    ]


def test_the_command_plays_what_it_is_told(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["fault_script", "--short", "--markdown", "in mid-frame"])
    monkeypatch.setattr(command, "CASES", [case for case in CASES if case.name == "reset in mid-frame"])
    assert command.main() == 0
    row = capsys.readouterr().out.splitlines()[-1]
    assert row.startswith("| reset in mid-frame | – | restart | 301 = 300 + 0 + 1 (the half frame) | 0 |")
    monkeypatch.setattr(sys, "argv", ["fault_script", "nonsense"])
    with pytest.raises(SystemExit) as ended:
        command.main()
    assert ended.value.code == 2
    assert "there are: reset in mid-frame" in capsys.readouterr().err
