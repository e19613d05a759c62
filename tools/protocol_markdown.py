"""Emits the byte tables of protocol/README.md."""

from __future__ import annotations

from collections.abc import Sequence

from protocol_definition import CRC_SIZE, HEADER_SIZE, Message, Named, Protocol
from protocol_python import camel, scaled_unit

# One COBS code byte and the closing 0x00; frames are too short for a second code byte.
OVERHEAD = HEADER_SIZE + CRC_SIZE + 2


def tables(protocol: Protocol) -> str:
    """Return the text between the markers."""
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
