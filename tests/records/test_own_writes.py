"""Tests of where the program's sources make temporary files, and where they open files for writing."""

import ast
import functools
import re
from collections.abc import Iterator

from tests.records.test_imports import PACKAGE

TEMPORARY = "records/temporary.py"
WRITES = {
    "records/whole_file.py": "results, which are whole or absent; no link is followed",
    "records/own_file.py": "locks, journals and databases; no link is followed, and no pipe is waited for",
    "recording/append_only.py": "recordings, which are always new files (O_EXCL)",
    "records/small_file.py": "opens a pipe for writing, so that a thread that waits for a writer ends",
    "recording/reader_process.py": "descriptors of a pipe between two processes",
    "recording/by_library.py": "the same pipe, at its other end",
    "recording/spool.py": "members of a zip archive, which is in a file that the caller has opened",
    "cli/standard_output.py": "/dev/null in place of a closed output",
    "sinks/ndjson.py": "the standard output",
    "sources/iio/buffer.py": "attributes of a device in /sys",
    "fleet/databases.py": "SQLite, after open_own has checked the file",
    "recording/bag_ros2.py": "SQLite, for reading only",
}
"""Source files that may open files for writing by themselves, with the reason.

All other source files call `whole_file` or `open_own`.
"""

MODE = re.compile(r"[rwaxbtU+]*[wax+][rwaxbtU+]*")
FLAGS = {"O_WRONLY", "O_RDWR", "O_CREAT", "O_APPEND", "O_TRUNC"}
CALLS = re.compile(r"(?!model_file\b).+\.(write_text|write_bytes|mkfifo|mknod)|sqlite3\.connect")
OPENS = {"open", "fdopen", "FileIO"}
NAMES = OPENS | {"write_text", "write_bytes", "mkfifo", "mknod", "connect", "touch"}


@functools.cache
def trees() -> dict[str, ast.AST]:
    """Return the parsed sources of the program, by path."""
    files = {str(path.relative_to(PACKAGE)): path for path in PACKAGE.rglob("*.py")}
    return {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in files.items()}


def imported(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the line and the name of each module that a file imports."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.lineno, node.module or ""


def test_temporary_files_are_made_in_one_place() -> None:
    """Temporary files that other code makes would stay behind when the program is killed."""
    found = {
        f"{path}:{line}"
        for path, tree in trees().items()
        for line, name in imported(tree)
        if name.split(".")[0] == "tempfile" and path != TEMPORARY
    }
    assert not found, f"use {TEMPORARY}"
    code = ast.parse("def f():\n    import tempfile as t\nfrom tempfile import mkdtemp")
    assert sorted(imported(code)) == [(2, "tempfile"), (3, "tempfile")]


def writes(tree: ast.AST) -> Iterator[int]:
    """Yield the lines in which a file may be opened for writing, without `whole_file` or `open_own`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and node.attr in FLAGS:
            yield node.lineno
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Name | ast.Attribute):
            continue
        name = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
        if name not in NAMES:
            continue
        called, given = ast.unparse(node.func), [*node.args, *(one.value for one in node.keywords)]
        words = [one.value for value in given for one in ast.walk(value) if isinstance(one, ast.Constant)]
        is_open = name in OPENS and any(MODE.fullmatch(str(word)) for word in words)
        if is_open or CALLS.fullmatch(called) or (name == "touch" and not node.args):
            yield node.lineno


def test_files_are_opened_for_writing_in_few_places() -> None:
    """A plain `open` would follow a link to somebody else's file, wait for a pipe, or leave half a file."""
    found: dict[str, list[int]] = {}
    for name, tree in trees().items():
        if lines := [*writes(tree)]:
            found[name] = lines
    assert sorted(found) == sorted(WRITES), found
    code = "path.open('rb'); open(path, 'a' if x else 'w'); p.write_text(''); sqlite3.connect(x); p.touch()"
    assert len(list(writes(ast.parse(code)))) == 4
