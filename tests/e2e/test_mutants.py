"""Tests of `make mutants`, which inserts bugs into the sources: all its listed bugs can be inserted, and its
verdicts are right.

The bugs that it inserts into the host's code are found by tests, too.
"""

import ast
from pathlib import Path

import msgspec
import pytest

from tests.rig.host_support import ROOT
from tools.mutants.host_changes import HOST, changes, choose
from tools.mutants.host_trial import HostCopy
from tools.mutants.workshop import Invalid, read_mutants

MUTANTS = read_mutants()


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_each_bug_has_its_place_in_the_present_sources(mutant) -> None:
    text = (ROOT / "firmware" / mutant.file).read_text()
    assert mutant.applied_to(text) != text
    with pytest.raises(ValueError, match="stands 0 times"):
        msgspec.structs.replace(mutant, old="no such text").applied_to(text)


def test_the_list_is_long_enough_and_names_each_bug_once() -> None:
    assert len({mutant.name for mutant in MUTANTS}) == len(MUTANTS) >= 30


CHANGED = {
    "x = a < b": ["x = (a <= b)", "x = (not a < b)"],
    "x = a in b": ["x = (not a in b)"],
    "x = a and b": ["x = (a or b)"],
    "x = not a": ["x = a"],
    "x = {'ä': a +\n b}": ["x = {'ä': (a - b)}"],
    "x += 2": ["x -= 2", "pass", "x += 3", "x += 1"],
    "x = True": ["x = False"],
    "x = np.minimum(a, min(b))": ["x = np.maximum(a, min(b))", "x = np.minimum(a, max(b))"],
    "x = a if b else c": ["x = (c if b else a)"],
    "a.x = b": ["pass"],
    "begin(b)": ["pass"],
    "def one():\n return a": ["def one():\n return None"],
    "for a in b:\n continue": ["for a in b:\n pass"],
    "raise ValueError(a + b)": ["pass"],
}
KEPT = [
    '"""1 + 1"""',
    "x: Literal[1] = a",
    "def one(x: int | None) -> Array[2]: ...",
    "@tried(3)\nclass One: ...",
    "x = f'{1 + a}'",
    "x = 'one' + a",
    "self._report('one', 1)",
    "if TYPE_CHECKING:\n begin()",
]


@pytest.mark.parametrize("text", CHANGED)
def test_each_change_is_one_thing_that_the_program_does(text: str) -> None:
    assert [change.applied_to(text) for change in changes("x.py", text)] == CHANGED[text]


@pytest.mark.parametrize("text", KEPT)
def test_texts_and_types_stay(text: str) -> None:
    assert list(changes("x.py", text)) == []


def test_a_seed_draws_the_same_changes_of_different_lines_and_all_are_python() -> None:
    drawn = choose(ROOT, 100, 1, "st")
    assert drawn == choose(ROOT, 100, 1, "st")
    assert len({(change.file, change.line) for change in drawn}) == 100
    assert drawn[:40] != choose(ROOT, 40, 2, "st")
    for change in drawn:
        text = (ROOT / change.file).read_text(encoding="utf-8")
        assert change.file.startswith(f"{HOST}/stream/")
        assert text[change.start : change.end] == change.old != change.new
        ast.parse(change.applied_to(text))


@pytest.mark.long
def test_a_change_that_breaks_pytest_is_taken_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copy, (change,) = HostCopy(tmp_path), choose(ROOT, 1, seed=1)

    def fail(*_: object) -> None:
        assert (copy.root / change.file).read_text() != (ROOT / change.file).read_text()
        raise Invalid("broken")

    monkeypatch.setattr(copy, "_first_failure", fail)
    with pytest.raises(Invalid):
        copy.noticed_by(change)
    assert (copy.root / change.file).read_text() == (ROOT / change.file).read_text()
