"""Tests that each data check is called, has a remedy, is planted by a test and stands in the guide.

The data checks are found in the sources, by the calls of `DataCheck`. A failure names the file and what it
lacks.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from fltea.identification import data_checks, judges

from tests.rig.host_support import ROOT

FOLDER = Path(data_checks.__file__ or "").parent
GUIDE = ROOT / "host/docs/guide"
IN_A_VARIABLE = {"peak.kind": ("line", "resonance", "comb")}
"""Kinds of data checks, by the expression in the code that has one of them as its value."""
OF_A_RECORD = {"source_data_check"}
"""Functions whose data checks have the kinds and the remedies of `error` records (`records/kinds.py`)."""
ALL_AXES = {"_gravity", "_like_mems"}
"""Functions of `judges.py` that need all axes of a recording, so that `judge_one` cannot call them."""


class Made(NamedTuple):
    """A call of `DataCheck`: where it stands, the names of its kinds, and what its other arguments are."""

    where: str
    function: str
    kinds: tuple[str, ...]
    severity: str
    remedy: ast.expr


def texts(expression: ast.expr, names: dict[str, ast.expr]) -> tuple[str, ...]:
    """Return the strings that an expression may be. `names`: what is assigned to each name."""
    match expression:
        case ast.Constant(value=str(text)):
            return (text,)
        case ast.IfExp(body=one, orelse=other):
            return texts(one, names) + texts(other, names)
        case ast.Name(id=name) if name in names:
            return texts(names[name], names)
    return IN_A_VARIABLE.get(ast.unparse(expression), ())


def assigned(tree: ast.AST) -> dict[str, ast.expr]:
    """Return what is assigned to each name. Two values of one name are the two sides of an `if`."""
    found: dict[str, ast.expr] = {}
    for node in ast.walk(tree):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
            pairs = [(target, node.value)]
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = list(zip(target.elts, node.value.elts, strict=True))
            for one, value in pairs:
                if isinstance(one, ast.Name):
                    before = found.get(one.id)
                    found[one.id] = (
                        value if before is None else ast.IfExp(test=value, body=before, orelse=value)
                    )
    return found


TREES = {file: ast.parse(file.read_text(encoding="utf-8")) for file in sorted(FOLDER.glob("*.py"))}
CONSTANTS = {
    name: value for tree in TREES.values() for name, value in assigned(tree).items() if name.isupper()
}


def made() -> Iterator[Made]:
    for file, tree in TREES.items():
        for function in tree.body:
            if not isinstance(function, ast.FunctionDef) or function.name in OF_A_RECORD:
                continue
            names = CONSTANTS | assigned(function)
            for node in ast.walk(function):
                if isinstance(node, ast.Call) and ast.unparse(node.func) == "DataCheck":
                    kind, severity, _, remedy = node.args[:4]
                    yield Made(
                        f"host/fltea/identification/{file.name}:{node.lineno}",
                        function.name,
                        texts(kind, names),
                        "bad" if "bad" in texts(severity, names) else "",
                        names.get(remedy.id, remedy) if isinstance(remedy, ast.Name) else remedy,
                    )


MADE = tuple(made())
KINDS = sorted({kind for one in MADE for kind in one.kinds})


def table(page: str) -> str:
    """Return the rows of the tables of a page of the guide."""
    return "".join(re.findall(r"^\|.*\n", (GUIDE / page).read_text(encoding="utf-8"), re.MULTILINE))


def test_each_is_found() -> None:
    unknown = [one.where for one in MADE if not one.kinds]
    assert not unknown, f"{unknown}: no text says the kind of this data check (see IN_A_VARIABLE here)"
    assert len(KINDS) > 20


def test_each_says_what_to_do() -> None:
    silent = [one.where for one in MADE if isinstance(one.remedy, ast.Constant) and not one.remedy.value]
    assert not silent, f"{silent}: the data check has no remedy"


@pytest.mark.parametrize("kind", KINDS)
def test_each_is_planted_by_a_test(kind: str) -> None:
    files = [file for file in Path(__file__).parent.glob("test_*.py") if file != Path(__file__)]
    tests = "".join(file.read_text(encoding="utf-8") for file in files)
    assert f'"{kind}"' in tests, f'tests/identification: no test expects "{kind}"'


@pytest.mark.parametrize("kind", KINDS)
def test_each_is_in_the_table_of_the_guide(kind: str) -> None:
    cells = re.findall(r"^\| (`.*?) \|", table("verdict.md"), re.MULTILINE)
    told = re.findall(r"`([a-z ]+)`", "".join(cells))
    assert kind in told, f"host/docs/guide/verdict.md: the table of data checks has no `{kind}`"


@pytest.mark.parametrize("kind", sorted({kind for one in MADE if one.severity for kind in one.kinds}))
def test_what_may_be_bad_is_in_the_page_on_recording(kind: str) -> None:
    rows = table("record.md")
    assert f'"{kind}"' in rows, f'host/docs/guide/record.md: no row of "What spoils a recording" has "{kind}"'


def calls(name: str, functions: dict[str, ast.FunctionDef]) -> set[str]:
    """Return the functions that a function of a module calls, directly or by others."""
    found, left = set[str](), [name]
    while left:
        names = {node.id for node in ast.walk(functions[left.pop()]) if isinstance(node, ast.Name)}
        left += sorted(names & functions.keys() - found)
        found |= names & functions.keys()
    return found


@pytest.mark.parametrize(("judging", "not_called"), [("judge", set()), ("judge_one", ALL_AXES)])
def test_each_of_all_axes_is_called(judging: str, not_called: set[str]) -> None:
    """What one of the two functions leaves out is not found in a recording, or not in arrays."""
    tree = ast.parse(Path(judges.__file__ or "").read_text(encoding="utf-8"))
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    checks = {one.function for one in MADE if "/judges.py:" in one.where} - {"judge", "judge_one"}
    forgotten = checks - calls(judging, functions) - not_called
    assert not forgotten, f"identification/judges.py: {judging} does not call {forgotten}"
