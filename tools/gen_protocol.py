"""Writes from protocol/messages.toml the C++ header, the Python module and the byte tables of the README.

What it emits is already in the style of `ruff format` and of `.clang-format`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import protocol_cpp
import protocol_python
from protocol_definition import CRC_SIZE, HEADER_SIZE, DefinitionError, Message, Named, Protocol, load
from protocol_python import camel, scaled_unit

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
    return {
        "firmware/core/messages.h": protocol_cpp.header(protocol),
        "host/fltea/wire/layout.py": protocol_python.module(protocol),
        "protocol/README.md": f"{before}{BEGIN}\n{tables(protocol)}{END}{after}",
    }


def tables(protocol: Protocol) -> str:
    """Return the byte tables of the README."""
    rows = [(m.name, str(m.id), str(m.size), str(m.size + OVERHEAD), m.doc) for m in protocol.messages]
    parts = [
        f"Protocol version **{protocol.major}.{protocol.minor}**, schema hash "
        f"**0x{protocol.schema_hash:08X}**, {protocol.baud} baud, "
        f"payload at most {protocol.max_payload} bytes, "
        f"whole frame at most {protocol.max_encoded + 1} bytes on the wire.\n",
        _table(("message", "type", "payload bytes", "bytes on the wire", "meaning"), rows),
        *map(_message, protocol.messages),
        *(_named(enum, "value") for enum in protocol.enums),
        *(_named(flags, "bit") for flags in protocol.flags),
    ]
    return "\n" + "\n".join(parts) + "\n"


def _message(message: Message) -> str:
    rows, offset = [], 0
    for field in message.fields:
        named = field.enum or field.flags
        meaning = field.doc + (f" ([{camel(named)}](#{camel(named).lower()}))" if named else "")
        rows.append((str(offset), str(field.size), field.type, field.name, scaled_unit(field), meaning))
        offset += field.size
    head = ("offset", "size", "type", "field", "unit of a count", "meaning")
    return f"### {message.name} (type {message.id}, {message.size} bytes)\n\n" + _table(head, rows)


def _named(named: Named, key: str) -> str:
    rows = [(str(value.value), value.name, value.doc) for value in named.values]
    return f"### {camel(named.name)}\n\n" + _table((key, "name", "meaning"), rows)


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)
