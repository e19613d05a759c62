"""Tests of the tools that cause faults (tools/faults).

The tests are about three of these tools: the account of all samples, which finds losses that no counter
shows, the report on the faults, and the connection that can be cut.
"""

import asyncio
import contextlib
import re
import socket
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast, get_args

import pytest
from fltea.records.kinds import ERROR_KINDS
from fltea.records.records import EpochReason
from fltea.sources.wire_events import SILENCE_S
from nats.js import JetStreamContext

from tests.rig.host_support import ROOT
from tools.faults import __main__ as command
from tools.faults.case import Case, cells, play
from tools.faults.cut_line import CutLine
from tools.faults.daemon import check_totals, faults_of, samples_of
from tools.faults.expected import Expected, shown
from tools.faults.ingest_scene import samples_of as samples_of_many
from tools.faults.nats_server import NatsServer
from tools.faults.outcome import Outcome
from tools.faults.program import Program, Skip
from tools.faults.pty_board import LSB_PER_DPS, Board
from tools.faults.stage import Stage

USUAL = Expected(("lost", "back"), excused=3)
RIGHT = Outcome(["lost", "back"], 10, {"delivered": 7, "lost": 3})


# --- one board, and the programs that read its port one after the other ---


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Board]:
    one = Board(tmp_path / "board")
    one.boot(sequence=65_530)
    one.send(20)
    yield one
    one.close()


def test_a_silence_that_was_the_boards_own_is_no_fault_of_the_daemon(board: Board) -> None:
    program = cast(Program, SimpleNamespace(errors=lambda: ["silent", "gap"]))
    time.sleep(0.1)
    board.send(1)
    assert board.longest_silence_s > 0.1
    for silence_s, found in ((0.1, ["silent", "gap"]), (SILENCE_S, ["gap"])):
        board.longest_silence_s = silence_s
        assert faults_of([program], board) == found


def records(board: Board, *, without: tuple[int, ...] = ()) -> list[dict[str, Any]]:
    """Return the records and statistics that a daemon would write if it received all samples except those
    with the indexes `without`.
    """
    found: list[dict[str, Any]] = [{"class": "epoch", "epoch": 1, "boot_id": 1}]
    for k, counts in enumerate(board.boots[0].counts):
        rates = [count / LSB_PER_DPS for count in counts]
        if k not in without:
            found.append({"class": "sample", "epoch": 1, "seq": 65_530 + k, "gyro_dps": rates})
    stats = {"delivered": len(found) - 1, "lost": 0, "gaps": 0, "duplicates": 0}
    return [*found, {"class": "stats", "sample_counts": stats}]


def gap(k: int, missing: int) -> dict[str, Any]:
    return {"class": "gap", "epoch": 1, "seq": 65_530 + k, "missing": missing}


def test_all_samples_delivered(board: Board) -> None:
    assert samples_of(board, [records(board)]) == (20, {"delivered": 20, "counted as lost": 0}, [])
    assert check_totals(records(board)) == []


def test_a_sample_that_nobody_counted(board: Board) -> None:
    found = samples_of(board, [records(board, without=(7, 8))])
    assert found.where == {"delivered": 18, "counted as lost": 0}
    texts = ("whole on the line, but not delivered", "nobody knows of")
    assert found.wrong == [f"{text}: 2 of 0 from 7" for text in texts]


def test_a_sample_counted_as_lost_that_was_never_on_the_line(board: Board) -> None:
    board.lose(2)
    board.send(1)
    found = samples_of(board, [[*records(board, without=(20, 21)), gap(20, 2)]])
    assert found == (23, {"delivered": 21, "counted as lost": 2}, [])


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda found: [*found, found[5]], "delivered twice: 1 of 0 from 4"),
        (lambda found: [*found, gap(3, 1)], "counted as lost, but delivered: 1 of 0 from 3"),
        (lambda found: [*found, gap(20, 1)], "nobody sent: 1 of 0 from 20"),
        (
            lambda found: [*found[:-3], gap(18, 2)],
            "counted as lost, but nothing came after it: 2 of 0 from 18",
        ),
        (lambda found: [*found, gap(7, 1), gap(7, 1)], "counted as lost twice: 1 of 0 from 7"),
        (lambda found: [found[0], {**found[3], "gyro_dps": [9, 9, 9]}], "not what was sent: (0, 2)"),
    ],
)
def test_records_that_cannot_be(board: Board, change: Any, text: str) -> None:
    found = samples_of(board, [change(records(board))], excuse="the half frame")
    assert any(wrong.startswith(text) for wrong in found.wrong)


def test_a_sample_out_of_a_frame_that_was_not_whole(board: Board) -> None:
    board.send(1, lambda data: data[:-1] + b"x\0")
    assert samples_of(board, [records(board)]).wrong == [
        "delivered, but not whole on the line: 1 of 0 from 20"
    ]


def test_two_programs_and_what_came_in_between(board: Board) -> None:
    found = records(board)
    programs = [found[:6], [found[0], *found[11:]]]
    between = samples_of(board, programs, excuse="in between")
    assert between == (20, {"delivered": 15, "counted as lost": 0, "in between": 5}, [])
    assert samples_of(board, programs).wrong == ["nobody knows of: 5 of 0 from 5"]
    assert samples_of(board, [found, found]).wrong == ["delivered twice: 20 of 0 from 0"]


def test_sums_that_are_no_sums(board: Board) -> None:
    found = [gap(0, 2), *records(board)]
    assert check_totals(found) == [
        "stats.sample_counts.lost is 0, not 2",
        "stats.sample_counts.gaps is 0, not 1",
    ]


# --- many boards and the workers that share them ---


class Worker:
    """A stand-in for a program: the records that it has written, and how it ended."""

    code, stderr = 0, ""

    def __init__(self, *records: dict[str, Any]) -> None:
        self.records = records

    def errors(self) -> list[str]:
        return [record["kind"] for record in self.records if record["class"] == "error"]


def walked(*numbers: int) -> list[dict[str, Any]]:
    return [{"class": "sample", "device": "a", "seq": seq} for seq in numbers]


def missed(seq: int, missing: int) -> dict[str, Any]:
    return {"class": "gap", "device": "a", "seq": seq, "missing": missing}


def shared(*workers: Worker) -> Outcome:
    return samples_of_many(["a"], 300, [cast(Program, worker) for worker in workers])


def test_every_sample_is_delivered_or_lost() -> None:
    outcome = shared(
        Worker(*walked(*range(200)), {"class": "error", "kind": "nats_lost"}),
        Worker(*walked(*range(150, 210)), missed(210, 5), *walked(*range(215, 300))),
    )
    assert outcome.is_right
    assert list(outcome.where.values()) == [295, 5]
    assert outcome.reported == ["nats_lost"]
    assert "50 delivered twice" in outcome.more


@pytest.mark.parametrize(
    ("records", "text"),
    [
        ([*walked(*range(290))], "nobody knows of: 10 of a from 290"),
        ([*walked(*range(301))], "nobody sent: 1 of a from 300"),
        ([*walked(*range(300)), missed(120, 3)], "counted as lost, but delivered: 3 of a from 120"),
    ],
)
def test_what_is_wrong_is_named(records: list[dict[str, Any]], text: str) -> None:
    outcome = shared(Worker(*records))
    assert outcome.wrong == [text]
    assert not outcome.is_right


def counts(stdout: tuple[int, int, int], mqtt: tuple[int, int, int]) -> dict[str, Any]:
    """Return a program's last statistics, and what each output has written, dropped and still queues."""
    names = "written", "dropped", "queued"
    outputs = {"stdout": stdout, "mqtt": mqtt}
    return {
        "class": "stats",
        "outputs": {one: dict(zip(names, of, strict=True)) for one, of in outputs.items()},
    }


@pytest.mark.parametrize(
    ("stdout", "mqtt", "wrong"),
    [
        ((280, 20, 10), (300, 5, 5), []),
        ((280, 20, 10), (300, 5, 4), ["mqtt accounts for 309 of 310 records"]),
        ((279, 20, 10), (305, 5, 0), ["stdout accounts for 309 of 310 records"]),
        ((281, 9, 9), (299, 0, 0), ["nobody knows of: 10 of a from 290"]),
    ],
)
def test_what_outputs_dropped_is_part_of_the_account(
    stdout: tuple[int, int, int], mqtt: tuple[int, int, int], wrong: list[str]
) -> None:
    outcome = shared(Worker(*walked(*range(290)), counts(stdout, mqtt)))
    assert outcome.wrong == wrong
    assert outcome.uncounted == (10 if "nobody" in "".join(wrong) else 0)


# --- causing faults and reporting them ---


def test_an_outcome_that_adds_up() -> None:
    assert RIGHT.is_right
    assert cells("a fault", RIGHT)[1:4] == ("lost, back", "10 samples = 7 delivered + 3 lost", "0")


@pytest.mark.parametrize("change", [{"due": 11}, {"due": 9}, {"wrong": ["x"]}])
def test_an_outcome_that_does_not(change: dict[str, Any]) -> None:
    assert not replace(RIGHT, **change).is_right


def lacks(stage: Stage) -> Outcome:
    raise Skip("no nats-server")


def test_what_breaks_is_a_wrong_outcome_and_what_it_started_ends() -> None:
    ended = []

    def breaks(stage: Stage) -> Outcome:
        stage.callback(lambda: ended.append(stage.folder))
        raise ValueError("broke")

    assert "ValueError: broke" in play(Case("a fault", breaks, Expected())).wrong[0]
    assert len(ended) == 1
    assert not ended[0].exists()


def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the command that plays faults. It plays five faults, with all kinds of outcomes.

    Two faults have the expected outcome. In one, two samples are in no count. One cannot be played on this
    machine. One is reported with other words than expected.
    """
    parts = {
        "right": command.Part(
            (Case("a fault", lambda stage: RIGHT, USUAL), Case("disk full", lambda stage: RIGHT, USUAL))
        ),
        "wrong": command.Part((Case("another", lambda stage: replace(RIGHT, due=12), USUAL),)),
        "ingest": command.Part((Case("server away", lacks, USUAL),)),
        "else": command.Part((Case("clock set", lambda stage: replace(RIGHT, reported=["lost"]), USUAL),)),
    }
    monkeypatch.setattr(command, "PARTS", parts)
    out = tmp_path / "new" / "faults.md"
    monkeypatch.setattr(sys, "argv", ["faults", "--out", str(out)])
    assert command.main() == 1
    text = out.read_text()
    rows = [line.split(" | ") for line in text.splitlines()[2:7]]
    assert [row[0] for row in rows] == ["| right", "| right", "| wrong", "| ingest", "| else"]
    assert [row[4] for row in rows] == ["0", "0", "2", "0", "0"]
    assert "| – **reported lost, expected lost, back** |" in text
    assert "| ingest | server away | – | 0 samples = 0 | 0 | not played: no nats-server |" in text
    assert "5 faults; 2 that are wrong or do not add up; 1 not played." in text
    monkeypatch.setattr(sys, "argv", ["faults", "right", "--only", "disk", "--out", str(out)])
    assert command.main() == 0
    assert out.read_text().endswith("\n1 faults; 0 that are wrong or do not add up; 0 not played.\n")
    for words in (["nonsense"], ["--only", "nonsense"]):
        monkeypatch.setattr(sys, "argv", ["faults", *words])
        with pytest.raises(SystemExit) as ended:
            command.main()
        assert ended.value.code == 2


def test_a_line_that_is_cut_holds_back_what_is_sent_and_its_end() -> None:
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        line = stack.enter_context(contextlib.closing(CutLine(server.getsockname()[1])))
        client = stack.enter_context(socket.create_connection(("127.0.0.1", line.port), timeout=10))
        there, _ = server.accept()
        stack.enter_context(there)
        there.settimeout(10)
        client.sendall(b"before")
        assert there.recv(10) == b"before"
        line.cut()
        client.sendall(b"meanwhile")
        client.shutdown(socket.SHUT_WR)
        there.settimeout(0.1)
        with pytest.raises(TimeoutError):
            there.recv(10)
        there.settimeout(10)
        line.heal()
        assert (there.recv(10), there.recv(10)) == (b"meanwhile", b"")


# --- servers ---


@pytest.mark.slow
def test_a_nats_server_whose_disk_holds_it_up_is_waited_for(stage: Stage, tmp_path: Path) -> None:
    server = NatsServer(tmp_path, 1)
    stage.callback(server.kill)

    async def asked_of_one_that_stands_still(stream: JetStreamContext) -> int:
        server.pause()
        # The server goes on after 6 s, later than the client library's time limit of 5 s.
        asyncio.get_running_loop().call_later(6.0, server.go_on)
        return (await stream.account_info()).streams

    assert server._ask(asked_of_one_that_stands_still) >= 0


# --- the documentation of the faults ---


@pytest.mark.parametrize(("page", "part"), [("running", "daemon"), ("fleet", "fleet"), ("ingest", "ingest")])
def test_the_guides_tables_are_of_the_faults_that_are_played(page: str, part: str) -> None:
    """The table in the guide has one row for each fault.

    The row shows the expected outcome, and the counts of samples in one run, which have to add up.
    """
    text = (ROOT / f"host/docs/guide/{page}.md").read_text("utf-8")
    found = {
        name: (reported, due, where)
        for name, reported, due, where in re.findall(
            r"^\| (.+) \| (.+) \| (\d+) [^|=]+ = (.+) \|$", text, re.MULTILINE
        )
    }
    cases = command.PARTS[part].cases
    assert sorted(found) == sorted(case.name for case in cases)
    for case in cases:
        reported, due, where = found[case.name]
        again = f"{case.name}: make it true again by `make faults ARGS='{part} --long'`"
        assert set(reported.split(", ")) - {"–"} <= ERROR_KINDS.keys() | set(get_args(EpochReason)), again
        assert sum(int(count) for count in re.findall(r"(?:^|\+ )(\d+)", where)) == int(due), again
        if isinstance(case.expected.reported, tuple):
            assert reported == shown(case.expected.reported), again
        else:
            assert case.expected.allows(reported.split(", ")), again
