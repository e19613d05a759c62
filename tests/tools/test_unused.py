"""Every function and class of the host and of the tools is used by a program, not only by tests.

A name counts as used if it occurs outside its definition, in code or in a text that a program reads.
"""

import ast
import re
from collections import Counter
from pathlib import Path

import pytest

from tests.rig.host_support import ROOT

CALLED_BY_LIBRARIES = {
    **dict.fromkeys(("on_files", "on_page_markdown", "on_page_content", "on_post_page"), "MkDocs"),
    **dict.fromkeys(("set_default_headers", "write_error"), "Tornado"),
    "on_broken_pipe": "Rich",
    "handle_error": "socketserver",
    "emit": "logging",
}
"""Functions that only a library calls, each with the name of the library."""

SUFFIXES = {".py", ".j2", ".toml", ".cpp", ".hpp", ".md", ".ipynb", ".html", ".sh"}


def programs() -> dict[Path, str]:
    """Return the texts of the host and the tools, and of the files that call them."""
    files = [file for folder in ("host", "tools") for file in (ROOT / folder).rglob("*.*")]
    files = [file for file in files if file.suffix in SUFFIXES]
    files += [ROOT / name for name in ("Makefile", "pyproject.toml")]
    return {file: file.read_text(encoding="utf-8") for file in files}


def is_registered(definition: ast.FunctionDef | ast.ClassDef) -> bool:
    """Return whether a decorator gives the definition to Typer, which calls it."""
    return any(re.search(r"\.(command|callback)\b", ast.unparse(one)) for one in definition.decorator_list)


@pytest.mark.parametrize("folder", ["host/fltea", "tools"])
def test_every_function_and_class_is_used(folder: str) -> None:
    texts = programs()
    words = Counter(word for text in texts.values() for word in re.findall(r"\w+", text))
    # Only tests use some functions of the tools, such as faults of the emulated board. So for the tools, the
    # words of the tests count as well.
    if folder == "tools":
        tests = (file.read_text(encoding="utf-8") for file in (ROOT / "tests").rglob("*.py"))
        words.update(word for text in tests for word in re.findall(r"\w+", text))
    unused = []
    for file, text in texts.items():
        if file.suffix != ".py" or not file.is_relative_to(ROOT / folder):
            continue
        for node in ast.walk(ast.parse(text)):
            if not isinstance(node, ast.FunctionDef | ast.ClassDef) or words[node.name] > 1:
                continue
            if (
                node.name not in CALLED_BY_LIBRARIES
                and not node.name.startswith("__")
                and not is_registered(node)
            ):
                unused.append(f"{file.relative_to(ROOT)}:{node.lineno}: {node.name}")
    assert not unused
