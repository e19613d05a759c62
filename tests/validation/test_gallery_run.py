"""The gallery from end to end: verdicts on a part of it, tables, pictures and the command."""

import functools
import json
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from fltea.identification.workers import Here
from validation_support import Backwards

from tools.validation.gallery import pictures, run, table
from tools.validation.gallery.noises import NOISES
from tools.validation.gallery.run import Cell, Gallery, Seen, cells, look, visit

Call = Callable[..., tuple[int, str, str]]

LOOKED_AT = (
    "white",
    "white, t4",
    "rounded, 0.3 LSB",
    "outliers",
    "1 relaxation",
    "2 relaxations",
    "3 relaxations",
    "4 relaxations",
    "AR(.99) + AR(.5)",
    "slow relaxation",
    "ARFIMA d .4",
    "ARFIMA d -.3",
    "ARFIMA(1, .4, 1)",
    "state 0.8, -1, 3",
    "1/f, 1 Hz",
    "1/f, 10 Hz",
    "random walk",
    "ramp",
    "1 pole, 20 Hz",
    "2 poles, 20 Hz",
    "mean of 4",
    "MPU-9250, 20 Hz",
    "2 poles, 20 Hz, 1/f",
    "resonance, Q 10",
    "line",
    "line at the end",
    "slow line",
    "hum",
    "differenced",
    "variance steps",
)


@pytest.mark.slow
def test_verdicts() -> None:
    """10 min at 100 Hz, one record each."""
    found = visit(cells(1, LOOKED_AT, (100.0,), (600.0,)), Here())
    wrong = {one.cell.noise: one.kind for one in found.seen if one.outcome == "wrong"}
    assert wrong == {}
    assert found.false_orders == 0
    assert found.close_claims == 0


def seen(name: str, kind: str, outcome: str, *, number: int = 0, ahead: float | None = 0.0) -> Seen:
    order = NOISES[name].truth in ("order", "filtered order")
    reason = "too short" if outcome == "cannot be told" else ""
    return Seen(Cell(name, 100.0, 600.0, number), kind, "Text.", outcome, ("white",), reason, order, ahead)


MADE = Gallery(
    (
        seen("white", "white", "right", ahead=None),
        seen("white", "undecided", "cannot be told", number=1),
        seen("1 relaxation", "fractional", "wrong", ahead=3.0),
        seen("1 relaxation", "relaxations", "right", number=1),
        seen("ARFIMA d .4", "fractional", "right", ahead=20.0),
    )
)


def test_figures_that_count() -> None:
    assert [MADE.count(o) for o in ("right", "cannot be told", "wrong")] == [3, 1, 1]
    assert (MADE.false_orders, len(MADE.without_order), MADE.close_claims) == (1, 4, 1)
    first, second, power, third = table.summary(MADE)
    assert power.startswith('Of 1 records of noises with an order 1 are called "fractional", 0 of the 0')
    assert "Of 5 records 3 verdicts are right (60.0%)" in first
    assert "Of 4 records of noises without an order 1 are" in second
    assert third.startswith('Of 2 claims of "fractional" 1')
    assert "none" in table.summary(Gallery(()))[1]


def test_tables() -> None:
    assert table.wrong_rows(MADE) == [("1 relaxation", "100 Hz, 10 min", "fractional 1 of 2", "white")]
    assert table.reasons(MADE) == [("white", "100 Hz, 10 min", "undecided 1 of 2", "too short")]
    lines = table.markdown(MADE).splitlines()
    assert lines[0] == "| noise | truth | 100 Hz, 10 min |"
    assert lines[2] == "| white | Gaussian white noise | white 1, undecided? 1 |"
    assert lines[4].endswith("| fractional |")
    assert msgspec.json.decode(table.to_json(MADE), type=Gallery) == MADE
    assert [table.duration(s) for s in (30, 600, 10_800)] == ["30 s", "10 min", "3 h"]


def test_nothing_depends_on_the_workers() -> None:
    wanted = cells(2, ("white", "1 relaxation"), (5.0,), (30.0, 60.0))
    here = visit(wanted, Here())
    kept: list[Seen] = []
    assert visit(wanted, Backwards(), keep=kept.append) == here
    assert sorted(kept, key=repr) == sorted(here.seen, key=repr)
    assert len(wanted) == 8


def test_known_records_are_not_drawn_again(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = cells(1, ("white",), (5.0,), (30.0, 60.0))
    first = look(wanted[0])
    looked: list[Cell] = []
    monkeypatch.setattr(run, "look", lambda cell: looked.append(cell) or look(cell))
    assert visit(wanted, Here(), known=[first]).seen[0] == first
    assert looked == wanted[1:]


def test_constant_record() -> None:
    constant = next(
        one
        for one in (look(Cell("rounded, 0.1 LSB", 5.0, 30.0, i)) for i in range(100))
        if one.kind == "constant"
    )
    assert constant.outcome == "cannot be told"


def test_pictures() -> None:
    drawn = pictures.draw_all(visit(cells(1, ("white", "rounded, 1 LSB"), (5.0,), (30.0,)), Here()))
    assert set(drawn) == {"cells", "spectra"}
    assert all(data.startswith(b"\x89PNG") for data in drawn.values())


@pytest.fixture
def gallery(validate: Call, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Call the command on short records of 5 Hz."""
    monkeypatch.setattr(run, "QUICK", (5.0, 30.0))
    return functools.partial(validate, "gallery", "--quick", "--jobs", "1")


def test_command(gallery: Call, tmp_path: Path) -> None:
    code, out, err = gallery("--only", "white", "--only", "outliers", "--no-figures")
    assert code == 0
    assert "verdicts are right" in out
    assert "2 files in build/validation" in err
    folder = tmp_path / "build/validation"
    assert sorted(file.name for file in folder.iterdir()) == ["gallery.json", "gallery.md", "gallery.ndjson"]
    assert len((folder / "gallery.ndjson").read_text().splitlines()) == 4


def test_command_as_json_and_resumed(gallery: Call, tmp_path: Path) -> None:
    """A last line that was cut off is done again; what is there is not."""
    first = gallery("--only", "white", "--no-figures", "--json")
    kept = tmp_path / "build/validation/gallery.ndjson"
    lines = kept.read_text().splitlines(keepends=True)
    kept.write_text(lines[0] + lines[1][:20])
    code, out, _ = gallery("--only", "white", "--no-figures", "--json", "--resume")
    assert (code, out) == (0, first[1])
    assert sorted(kept.read_text().splitlines(keepends=True)) == sorted(lines)
    assert len(json.loads(out)["seen"]) == 3


def test_wrong_arguments(gallery: Call, tmp_path: Path) -> None:
    code, _, err = gallery("--only", "pink elephants")
    assert code == 2
    assert "no noise has this in its name" in err
    (tmp_path / "build/validation").mkdir(parents=True)
    (tmp_path / "build/validation/gallery.ndjson").write_text("{}\n")
    code, _, err = gallery("--only", "white", "--no-figures", "--resume")
    assert code == 2
    assert "is not of this program" in err
