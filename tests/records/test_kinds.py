"""Tests of the list of error kinds.

Every kind that the code reports is in the list, and some code reports every kind in the list.
"""

import ast
import functools
import re
from collections.abc import Iterator
from pathlib import Path

from fltea.records.kinds import ERROR_KINDS

from tests.rig.host_support import ROOT

LISTED = ERROR_KINDS.keys()
MAKERS = {"Unusable", "Trouble", "Failed", "Error", "Notice", "Down", "Note"}
"""Classes whose first field, or whose field `kind`, is the kind of an error."""
TELLERS = {"_report", "_report_once", "_of_server", "_error", "_tell", "report"}
"""Functions whose first argument is the kind of an error."""
OF_ANY_PORT = {"no_port", "no_permission", "port_busy", "open_failed"}
"""Kinds of errors for a port that cannot be opened.

The guide about the Raspberry Pi may leave them out, since they mean the same for its I²C bus.
"""

Function = ast.FunctionDef


@functools.cache
def all_told() -> list[tuple[str, str]]:
    """Return every error kind that the code of fltea reports, and where. The function `told` finds them."""
    files = sorted((ROOT / "host/fltea").rglob("*.py"))
    return list(
        told(
            {
                file: ast.parse(file.read_text(encoding="utf-8"), str(file))
                for file in files
                if file.name != "kinds.py"
            }
        )
    )


def functions(code: dict[Path, ast.Module]) -> dict[str, list[Function]]:
    found: dict[str, list[Function]] = {}
    for tree in code.values():
        for node in ast.walk(tree):
            if isinstance(node, Function):
                found.setdefault(node.name, []).append(node)
    return found


def name_of(called: ast.expr) -> str:
    """Return the last part of the name of what is called. For `hub.report()("kind", …)` it is "report"."""
    match called:
        case ast.Name(name) | ast.Attribute(attr=name):
            return name
        case ast.Call(func=func):
            return name_of(func)
    return ""


def told(code: dict[Path, ast.Module]) -> Iterator[tuple[str, str]]:
    """Yield every kind of error that the code reports, and the place (file and line).

    Some functions return the kind and the text of an error. If the code calls such a function, every kind
    that the function can return is included.
    """
    defined = functions(code)
    for file, tree in code.items():
        for node in ast.walk(tree):
            match node:
                case ast.Call(func=func, args=args, keywords=keywords):
                    given = [k.value for k in keywords if k.arg == "kind"] + args[:1]
                    if name_of(func) in MAKERS | TELLERS and given:
                        place = f"{file}:{node.lineno}"
                        yield from ((kind, place) for kind in kinds_in(given[0], defined, place))
                case ast.Assign(targets=[ast.Tuple([ast.Name("kind"), *_])], value=ast.Call(func=func)):
                    place = f"{file}:{node.lineno}"
                    # if fltea does not define the called function, `kind` is not the kind of an error
                    makers = defined.get(name_of(func), [])
                    yield from ((kind, place) for maker in makers for kind in returned(maker))


def kinds_in(value: ast.expr, defined: dict[str, list[Function]], place: str) -> set[str]:
    match value:
        case ast.Constant(str(kind)):
            return {kind}
        case ast.IfExp(body=body, orelse=orelse):
            return kinds_in(body, defined, place) | kinds_in(orelse, defined, place)
        case ast.Starred(ast.Call(func=func)):
            makers = defined.get(name_of(func), [])
            assert makers, f"{place}: nobody defines {name_of(func)}, which gives kind and text"
            return {kind for maker in makers for kind in returned(maker)}
    # `value` is a variable or an attribute that holds a kind. The search finds that kind where the error is
    # made.
    return set()


def returned(function: Function) -> set[str]:
    found = set()
    for node in ast.walk(function):
        match node:
            case ast.Return(ast.Tuple([ast.Constant(str(kind)), *_])):
                found.add(kind)
    return found


def test_every_kind_that_is_told_is_listed() -> None:
    found = all_told()
    assert {"no_port", "no_permission", "unplugged", "version", "constant_axis", "axis_runaway"} | {
        "broker_lost",
        "disk_full",
        "fifo_overflow",
        "state_failed",
        "output_lost",
    } <= {kind for kind, _ in found}, "the scan has lost sight of the code"
    unknown = [(kind, place) for kind, place in found if kind not in LISTED]
    assert not unknown, f"records/kinds.py: ERROR_KINDS has no {unknown}"


def test_every_listed_kind_is_told() -> None:
    unused = LISTED - {kind for kind, _ in all_told()}
    assert not unused, f"records/kinds.py: no code reports {unused}"


def test_every_kind_is_named_by_a_test() -> None:
    """Every kind of error stands in some test. Such a test makes the error happen, or at least expects it
    among the records.
    """
    files = [file for file in (ROOT / "tests").rglob("test_*.py") if file != Path(__file__)]
    words = {word for file in files for word in re.findall(r"\w+", file.read_text(encoding="utf-8"))}
    untested = LISTED - words
    assert not untested, f"records/kinds.py: no test names {untested}"


def test_the_page_of_the_pi_says_when_a_kind_of_its_bus_is_reported() -> None:
    page = (ROOT / "host/docs/guide/raspberry_pi.md").read_text(encoding="utf-8")
    of_bus = {kind for kind, place in all_told() if "/sources/i2c/" in place} - OF_ANY_PORT
    missing = {kind for kind in of_bus if f"`{kind}`" not in page}
    assert not missing, f"guide/raspberry_pi.md: the table of losses has no {missing}"


def test_each_says_meaning_and_remedy_in_a_sentence() -> None:
    for name, kind in ERROR_KINDS.items():
        assert re.fullmatch(r"[a-z]+(_[a-z]+)*", name)
        for text in kind:
            assert re.fullmatch(r"[A-Z`][^|\n]*[^.]\.", text), name
