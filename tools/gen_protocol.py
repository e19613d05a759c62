"""Writes from protocol/messages.toml the C++ header, the Python module and the byte tables of the README.

What it emits is already in the style of `ruff format` and of `.clang-format`.
"""

from __future__ import annotations

from pathlib import Path

import protocol_cpp
import protocol_markdown
import protocol_python
from protocol_definition import DefinitionError, load

SOURCE = "protocol/messages.toml"
BEGIN = "<!-- generated: tables -->"
END = "<!-- end of generated -->"


def outputs(root: Path) -> dict[str, str]:
    """Path below the root -> the contents that belong there."""
    protocol = load((root / SOURCE).read_text())
    readme = (root / "protocol/README.md").read_text()
    before, begin, rest = readme.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise DefinitionError(f"protocol/README.md: the lines {BEGIN} and {END} are missing")
    tables = protocol_markdown.tables(protocol)
    return {
        "firmware/core/messages.h": protocol_cpp.header(protocol),
        "host/fltea/wire/layout.py": protocol_python.module(protocol),
        "protocol/README.md": f"{before}{BEGIN}\n{tables}{END}{after}",
    }
