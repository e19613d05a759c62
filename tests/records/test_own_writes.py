"""Tests of where the program's sources make temporary files."""

import ast
from collections.abc import Iterator

from tests.records.test_imports import PACKAGE

TEMPORARY = "records/temporary.py"


def imported(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the line and the name of each module that a file imports."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.lineno, node.module or ""


def test_temporary_files_are_made_in_one_place() -> None:
    """Other files would stay behind when the program is killed."""
    found = {
        f"{path.relative_to(PACKAGE)}:{line}"
        for path in PACKAGE.rglob("*.py")
        for line, name in imported(ast.parse(path.read_text(encoding="utf-8")))
        if name.split(".")[0] == "tempfile" and str(path.relative_to(PACKAGE)) != TEMPORARY
    }
    assert not found, f"use {TEMPORARY}"
    code = ast.parse("def f():\n    import tempfile as t\nfrom tempfile import mkdtemp")
    assert sorted(imported(code)) == [(2, "tempfile"), (3, "tempfile")]
