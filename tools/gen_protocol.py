"""Writes from protocol/messages.toml the C++ header, the Python module and the byte tables of the README."""

import subprocess
import sys
from pathlib import Path

from generated import rendered
from protocol_definition import CRC_SIZE, HEADER_SIZE, DefinitionError, Protocol, load

SOURCE = "protocol/messages.toml"
BEGIN = "<!-- generated: tables -->"
END = "<!-- end of generated -->"
# One COBS code byte and the closing 0x00; frames are too short for a second code byte.
OVERHEAD = HEADER_SIZE + CRC_SIZE + 2


def outputs(root: Path) -> dict[str, str]:
    """Path below the root -> the contents that belong there."""
    protocol = load((root / SOURCE).read_text())
    readme = (root / "protocol/README.md").read_text()
    before, begin, rest = readme.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise DefinitionError(f"protocol/README.md: the lines {BEGIN} and {END} are missing")
    tables = rendered("protocol_tables.md", protocol=protocol, overhead=OVERHEAD)
    return {
        "firmware/core/messages.h": header(protocol),
        "host/fltea/wire/layout.py": module(protocol),
        "protocol/README.md": f"{before}{BEGIN}\n{tables}{END}{after}",
    }


def header(protocol: Protocol) -> str:
    """Return the text of the C++ header."""
    return rendered("messages.h", protocol=protocol)


def module(protocol: Protocol) -> str:
    """Return the text of the Python module, as ruff formats it."""
    ruff = [sys.executable, "-m", "ruff", "format", "--line-length=110", "-"]
    text = rendered("layout.py", protocol=protocol)
    return subprocess.run(ruff, input=text, capture_output=True, text=True, check=True).stdout
