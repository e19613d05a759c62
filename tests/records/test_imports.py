"""Tests of imports.

Packages import only packages that host/README.md lists above them, and no modules import each other in a
cycle.
"""

import ast
import functools
import re
from pathlib import Path

from tests.rig.host_support import ROOT

PACKAGE = ROOT / "host/fltea"
FILES = {
    ".".join(("fltea", *file.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__"): file
    for file in sorted(PACKAGE.rglob("*.py"))
}

MODULES = FILES.keys() | {"fltea._native"}


def imports(file: Path) -> set[str]:
    """Return the modules of fltea that a file imports, at its beginning or anywhere else."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            whole = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= whole if whole & MODULES else {node.module}
    return names & FILES.keys()


@functools.cache
def all_imports() -> dict[str, set[str]]:
    return {name: imports(file) - {name} for name, file in FILES.items()}


def room_of(name: str) -> str:
    return [*name.split("."), ""][1]


def circles(arrows: dict[str, set[str]]) -> set[str]:
    """Return the modules that are in import cycles or lead into one.

    To find them, modules that import none of the remaining modules are removed repeatedly.
    """
    left = dict(arrows)
    while free := [name for name, imported in left.items() if not imported & left.keys()]:
        for name in free:
            del left[name]
    return set(left)


def test_no_files_import_each_other_in_a_circle() -> None:
    assert circles(all_imports()) == set()
    assert circles({"a": {"b"}, "b": {"a"}, "c": {"a"}, "d": set()}) == {"a", "b", "c"}


def test_rooms_import_only_rooms_above_them() -> None:
    text = (ROOT / "host/README.md").read_text(encoding="utf-8")
    order = re.findall(r"^\| `(\w+)/` \|", text, re.MULTILINE)
    rooms = {folder.name for folder in PACKAGE.iterdir() if (folder / "__init__.py").exists()}
    assert sorted(order) == sorted(rooms), "host/README.md, The rooms"
    upwards = {
        f"{name} imports {one}"
        for name, found in all_imports().items()
        for one in found
        if room_of(name) in rooms and room_of(one) not in order[: order.index(room_of(name)) + 1]
    }
    assert upwards == set()
