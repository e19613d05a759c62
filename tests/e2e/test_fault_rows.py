"""The report of all faults: what does not add up is told, and ends with 1."""

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tools.fault_script.stage import Skip
from tools.faults import __main__ as command
from tools.faults.played import played
from tools.faults.row import Row

RIGHT = Row("ingest", "a fault", ["lost", "back"], "samples", 10, {"delivered": 7, "lost": 3}, "", [])


def test_a_row_that_adds_up() -> None:
    assert RIGHT.is_right
    assert RIGHT.cells[3:5] == ("10 samples = 7 delivered + 3 lost", "0")


@pytest.mark.parametrize("row", [RIGHT._replace(due=11), RIGHT._replace(due=9), RIGHT._replace(wrong=["x"])])
def test_a_row_that_does_not(row: Row) -> None:
    assert not row.is_right


def breaks(folder: Path) -> Row:
    raise ValueError("broke")


def test_what_breaks_is_a_wrong_row_and_the_others_are_played() -> None:
    bad, good = played("ingest", [breaks, lambda folder: RIGHT], [])
    assert "ValueError: broke" in bad.wrong[0]
    assert good == RIGHT
    assert list(played("ingest", [breaks], ["other"])) == []


def test_what_cannot_be_played_here_says_why_and_the_others_are_played() -> None:
    def lacks(folder: Path) -> Row:
        raise Skip("no nats-server")

    left_out, good = played("ingest", [lacks, lambda folder: RIGHT], [])
    assert (left_out.due, left_out.more, left_out.is_right) == (0, "not played: no nats-server", True)
    assert good == RIGHT


def test_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One part is right, one is not, one cannot be played here."""

    def nothing(words: list[str]) -> Iterator[Row]:
        raise Skip("no nats-server")
        yield

    parts: dict[str, Callable[[list[str]], Iterator[Row]]] = {
        "right": lambda words: iter([RIGHT]),
        "wrong": lambda words: iter([RIGHT._replace(due=12, fault="another")]),
        "ingest": nothing,
    }
    monkeypatch.setattr(command, "PARTS", parts)
    out = tmp_path / "new" / "faults.md"
    monkeypatch.setattr(sys, "argv", ["faults", "--json", "--out", str(out)])
    assert command.main() == 1
    assert [row["uncounted"] for row in json.loads(capsys.readouterr().out)] == [0, 2]
    text = out.read_text()
    assert "2 faults; 1 that are wrong or do not add up.\nLeft out: ingest: no nats-server" in text
    monkeypatch.setattr(sys, "argv", ["faults", "right", "--out", str(out)])
    assert command.main() == 0
    monkeypatch.setattr(sys, "argv", ["faults", "nonsense"])
    with pytest.raises(SystemExit) as ended:
        command.main()
    assert ended.value.code == 2
