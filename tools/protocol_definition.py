"""Reads protocol/messages.toml into checked records, and makes the schema hash.

The tree of records is `Protocol` -> `Message` -> `Field`, and `Protocol` -> `Named` (an enum or a set of
flags) -> `Value`. Whatever is wrong with the file is a `DefinitionError` that names the place.
"""

from __future__ import annotations

import keyword
import re
import tomllib
import zlib
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

INTEGERS = {"u8": ("B", 1), "u16": ("H", 2), "u32": ("I", 4), "i16": ("h", 2)}
"""Type -> (code of Python's struct, bytes)."""
NUMBERS = {**INTEGERS, "f32": ("f", 4)}
"""The same, with the type that is no count: it takes no scale."""

HEADER_SIZE = 7
CRC_SIZE = 4
COBS_BLOCK = 254
MAX_NAME = 23
"""Keeps every generated line within the line length."""

# Every reader must be able to name a version that it refuses, so these never move.
FIXED_PREFIX = [("protocol_major", "u8"), ("protocol_minor", "u8"), ("schema_hash", "u32")]

# Names that one of the two languages, or the generated classes, use already.
RESERVED = set(
    f"""
    {" ".join(keyword.kwlist)}
    auto bool case catch char const default delete do double enum explicit extern float friend goto inline int
    long mutable namespace new operator private protected public register short signed sizeof static struct
    switch template this throw typedef typename union unsigned using virtual void volatile
    count index pack unpack size type visit_fields self visitor
    """.split()
)


class DefinitionError(ValueError):
    """The definition is wrong; the text names the place and what was expected."""


@dataclass(frozen=True)
class Field:
    """One field of a message."""

    name: str
    type: str
    doc: str
    unit: str
    scale: Decimal | None
    enum: str
    flags: str

    @property
    def size(self) -> int:
        """Bytes on the wire."""
        return NUMBERS[self.type][1] if self.type in NUMBERS else self.length

    @property
    def length(self) -> int:
        """N of bytesN or textN, 0 for a number."""
        return 0 if self.type in NUMBERS else int(re.sub(r"\D", "", self.type))

    @property
    def code(self) -> str:
        """Format code of Python's struct."""
        return NUMBERS[self.type][0] if self.type in NUMBERS else f"{self.length}s"

    @property
    def is_text(self) -> bool:
        """True for textN."""
        return self.type.startswith("text")


@dataclass(frozen=True)
class Message:
    """One message: its fields lie in the payload in this order, without padding."""

    name: str
    id: int
    doc: str
    fields: tuple[Field, ...]

    @property
    def size(self) -> int:
        """Bytes of payload."""
        return sum(field.size for field in self.fields)


@dataclass(frozen=True)
class Value:
    """One value of an enum, or one bit of a set of flags."""

    name: str
    value: int
    doc: str


@dataclass(frozen=True)
class Named:
    """An enum, or a set of flags."""

    name: str
    values: tuple[Value, ...]


@dataclass(frozen=True)
class Protocol:
    """The whole definition."""

    major: int
    minor: int
    max_payload: int
    baud: int
    messages: tuple[Message, ...]
    enums: tuple[Named, ...]
    flags: tuple[Named, ...]

    @property
    def max_frame(self) -> int:
        """Bytes of the longest frame before COBS."""
        return HEADER_SIZE + self.max_payload + CRC_SIZE

    @property
    def max_encoded(self) -> int:
        """Bytes of the longest frame after COBS, without the 0x00."""
        return self.max_frame + 1

    @property
    def canonical(self) -> str:
        """The text whose CRC-32 is the schema hash; protocol/README.md describes it."""
        lines = []
        for message in self.messages:
            lines.append(f"message {message.id} {message.name}")
            for field in message.fields:
                line = f"field {field.name} {field.type}"
                line += f" enum {field.enum}" if field.enum else ""
                line += f" flags {field.flags}" if field.flags else ""
                line += f" scale {field.scale.normalize():f}" if field.scale is not None else ""
                line += f" unit {field.unit}" if field.unit else ""
                lines.append(line)
        for kind, word, group in (("enum", "value", self.enums), ("flags", "bit", self.flags)):
            for named in group:
                lines.append(f"{kind} {named.name}")
                lines += [f"{word} {value.value} {value.name}" for value in named.values]
        return "".join(line + "\n" for line in lines)

    @property
    def schema_hash(self) -> int:
        """CRC-32 of the canonical text."""
        return zlib.crc32(self.canonical.encode())


def load(text: str) -> Protocol:
    """Parse and check the definition; raises DefinitionError."""
    try:
        document = tomllib.loads(text, parse_float=Decimal)
    except tomllib.TOMLDecodeError as error:
        raise DefinitionError(f"not TOML: {error}") from None
    _keys("top level", document, {"protocol", "message"}, {"enum", "flags"})
    head = document["protocol"]
    _keys("[protocol]", head, {"major", "minor", "max_payload", "baud"}, set())
    limits = {"major": 255, "minor": 255, "max_payload": COBS_BLOCK - 1 - HEADER_SIZE - CRC_SIZE}
    for key in ("major", "minor", "max_payload", "baud"):
        _integer(f"[protocol] {key}", head[key], 0, limits.get(key, 10_000_000))
    enums = tuple(_named("enum", name, body, "value", 255) for name, body in document.get("enum", {}).items())
    flags = tuple(_named("flags", name, body, "bit", 7) for name, body in document.get("flags", {}).items())
    names = {"enum": {e.name for e in enums}, "flags": {f.name for f in flags}}
    for name in sorted(names["enum"] & names["flags"]):
        raise DefinitionError(f"{name}: both an enum and a set of flags")
    bodies = _tables("message", document["message"])
    messages = tuple(_message(body, names, head["max_payload"]) for body in bodies)
    _unique("message", [message.name for message in messages], "name")
    _unique("message", [message.id for message in messages], "id")
    _check_hello(messages)
    _check_used(messages, names)
    return Protocol(head["major"], head["minor"], head["max_payload"], head["baud"], messages, enums, flags)


def _message(body: dict[str, Any], names: dict[str, set[str]], max_payload: int) -> Message:
    place = f"message {body.get('name', '?')}"
    _keys(place, body, {"name", "id", "doc", "field"}, set())
    _name(place, body["name"], r"[A-Z][A-Z0-9_]*")
    _integer(f"{place}: id", body["id"], 1, 255)
    _text(f"{place}: doc", body["doc"])
    fields = tuple(_field(place, field, names) for field in _tables(f"{place}: field", body["field"]))
    _unique(place, [field.name for field in fields], "field")
    message = Message(body["name"], body["id"], body["doc"], fields)
    if message.size > max_payload:
        raise DefinitionError(f"{place}: {message.size} bytes of payload; at most {max_payload} fit")
    return message


def _field(message: str, body: dict[str, Any], names: dict[str, set[str]]) -> Field:
    place = f"{message}, field {body.get('name', '?')}"
    _keys(place, body, {"name", "type", "doc"}, {"unit", "scale", "enum", "flags"})
    _name(place, body["name"], r"[a-z][a-z0-9_]*")
    for key in ("doc", "unit"):
        _text(f"{place}: {key}", body.get(key, "-"))
    kind = body["type"]
    if not isinstance(kind, str) or (
        kind not in NUMBERS and not re.fullmatch(r"(bytes|text)[1-9]\d{0,2}", kind)
    ):
        raise DefinitionError(f"{place}: unknown type {kind!r}; known: {', '.join(NUMBERS)}, bytesN, textN")
    scale = body.get("scale")
    if scale is not None:
        if kind not in INTEGERS:
            raise DefinitionError(f"{place}: a scale needs an integer type, not {kind}")
        if "unit" not in body:
            raise DefinitionError(f"{place}: a scale needs a unit")
        if isinstance(scale, bool) or not isinstance(scale, int | Decimal):
            raise DefinitionError(f"{place}: scale {scale!r} is not a number above 0")
        scale = Decimal(scale)
        if not scale.is_finite() or scale <= 0:
            raise DefinitionError(f"{place}: scale {scale} is not a number above 0")
    for key in ("enum", "flags"):
        if key in body and body[key] not in names[key]:
            raise DefinitionError(f"{place}: no [{key}.{body[key]}] in the file")
        if key in body and kind != "u8":
            raise DefinitionError(f"{place}: {key} needs type u8, not {kind}")
    if "enum" in body and "flags" in body:
        raise DefinitionError(f"{place}: either enum or flags")
    return Field(
        body["name"],
        kind,
        body["doc"],
        body.get("unit", ""),
        scale,
        body.get("enum", ""),
        body.get("flags", ""),
    )


def _named(kind: str, name: str, body: dict[str, Any], key: str, limit: int) -> Named:
    place = f"{kind} {name}"
    _name(place, name, r"[a-z][a-z0-9_]*")
    if not isinstance(body, dict):
        raise DefinitionError(f"{place}: expected a table, not {body!r}")
    values = []
    for member, item in body.items():
        _name(f"{place}, {member}", member, r"[a-z][a-z0-9_]*")
        _keys(f"{place}, {member}", item, {key, "doc"}, set())
        _integer(f"{place}, {member}: {key}", item[key], 0, limit)
        _text(f"{place}, {member}: doc", item["doc"])
        values.append(Value(member, item[key], item["doc"]))
    if not values:
        raise DefinitionError(f"{place}: no {key}")
    _unique(place, [value.value for value in values], key)
    return Named(name, tuple(values))


def _check_hello(messages: tuple[Message, ...]) -> None:
    hello = next((message for message in messages if message.name == "HELLO"), None)
    if hello is None or hello.id != 1:
        raise DefinitionError("message HELLO with id 1 is missing: every version opens with it")
    if [(field.name, field.type) for field in hello.fields[:3]] != FIXED_PREFIX:
        wanted = ", ".join(f"{name} {kind}" for name, kind in FIXED_PREFIX)
        raise DefinitionError(f"message HELLO must begin with {wanted}: they never move in any version")


def _check_used(messages: tuple[Message, ...], names: dict[str, set[str]]) -> None:
    fields = [field for message in messages for field in message.fields]
    for key, used in (("enum", {f.enum for f in fields}), ("flags", {f.flags for f in fields})):
        for name in sorted(names[key] - used):
            raise DefinitionError(f"{key} {name}: no field uses it")


def _tables(place: str, value: Any) -> list[dict[str, Any]]:
    if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
        raise DefinitionError(f"{place}: expected [[tables]], not {value!r}")
    return value


def _keys(place: str, body: Any, required: set[str], optional: set[str]) -> None:
    if not isinstance(body, dict):
        raise DefinitionError(f"{place}: expected a table, not {body!r}")
    for key in sorted(required - body.keys()):
        raise DefinitionError(f"{place}: {key} is missing")
    for key in sorted(body.keys() - required - optional):
        raise DefinitionError(f"{place}: unknown key {key!r}")


def _name(place: str, name: Any, pattern: str) -> None:
    if not isinstance(name, str) or not re.fullmatch(pattern, name):
        raise DefinitionError(f"{place}: name {name!r} does not match {pattern}")
    if len(name) > MAX_NAME:
        raise DefinitionError(f"{place}: name {name!r} is longer than {MAX_NAME} characters")
    if name.lower() in RESERVED or "mpu" in name.lower().split("_"):
        raise DefinitionError(
            f"{place}: name {name!r} is reserved (a word of C++ or Python, or a vendor macro)"
        )


def _integer(place: str, value: Any, low: int, high: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise DefinitionError(f"{place}: {value!r} is not an integer from {low} to {high}")


def _text(place: str, value: Any) -> None:
    # Quotes and backslashes would need escaping in two languages; no text has needed one.
    if not isinstance(value, str) or not value or not re.fullmatch(r'[^"\\\n]+', value):
        raise DefinitionError(f"{place}: {value!r} is not one line of text without quotes and backslashes")


def _unique(place: str, values: list[Any], what: str) -> None:
    for value in values:
        if values.count(value) > 1:
            raise DefinitionError(f"{place}: {what} {value} is there twice")
