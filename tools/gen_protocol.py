"""Writes C++ header, Python module and the site's tables of bytes, all from protocol/messages.toml."""

import subprocess
import sys
from pathlib import Path

from tools.generated import rendered
from tools.protocol_definition import CRC_SIZE, HEADER_SIZE, Protocol, load

SOURCE = "protocol/messages.toml"
# Number of bytes that COBS adds to a frame: one code byte and the closing 0x00. Frames are too short for a
# second code byte.
OVERHEAD = HEADER_SIZE + CRC_SIZE + 2


def outputs(root: Path) -> dict[str, str]:
    """Return the path (below the root) and the text of each generated file."""
    protocol = load((root / SOURCE).read_text())
    return {"firmware/core/messages.h": header(protocol), "host/fltea/wire/layout.py": module(protocol)}


def tables(root: Path) -> str:
    """Return the site's tables: the bytes of each message's fields, and the values of enums and flags."""
    protocol = load((root / SOURCE).read_text())
    return rendered("protocol_tables.md", protocol=protocol, overhead=OVERHEAD)


def header(protocol: Protocol) -> str:
    """Return the text of the C++ header."""
    return rendered("messages.h", protocol=protocol)


def module(protocol: Protocol) -> str:
    """Return the text of the Python module, as ruff formats it."""
    ruff = [sys.executable, "-m", "ruff", "format", "--line-length=110", "-"]
    text = rendered("layout.py", protocol=protocol)
    return subprocess.run(ruff, input=text, capture_output=True, text=True, check=True).stdout
