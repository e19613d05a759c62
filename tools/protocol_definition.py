"""Reads protocol/messages.toml into checked records, and computes the schema hash.

The tree of records is `Protocol` -> `Message` -> `Field`, and `Protocol` -> `Named` (an enum or a set of
flags) -> `Value`. A fault in the file raises a `DefinitionError` that names where the fault is.
"""

from __future__ import annotations

import keyword
import re
import tomllib
import zlib
from collections.abc import Iterable, Iterator, Sequence
from decimal import Decimal
from typing import Annotated, TypeVar

import msgspec
from msgspec import Meta, Struct

INTEGERS = {"u8": ("B", 1), "u16": ("H", 2), "u32": ("I", 4), "i16": ("h", 2)}
"""Integer types with (format character of Python's struct, number of bytes)."""
NUMBERS = {**INTEGERS, "f32": ("f", 4)}
"""All number types: INTEGERS, and f32, which cannot have a scale because it is not a count."""

HEADER_SIZE = 7
CRC_SIZE = 4
COBS_BLOCK = 254

# Fields of HELLO whose positions never change. So every reader can read a board's version, even if it does
# not know that version and has to refuse the board.
FIXED_PREFIX = [("protocol_major", "u8"), ("protocol_minor", "u8"), ("schema_hash", "u32")]

# Names that a field must not have, because C++, Python or the generated classes already use them.
RESERVED = set(
    f"""
    {" ".join(keyword.kwlist)}
    auto bool case catch char const default delete do double enum explicit extern float friend goto inline int
    long mutable namespace new operator private protected public register short signed sizeof static struct
    switch template this throw typedef typename union unsigned using virtual void volatile
    count index pack unpack size type visit_fields self visitor
    """.split()
)

# If a name has at most 23 characters, no generated line is too long.
Name = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]*\Z", max_length=23)]
# Quotes and backslashes would need escaping in two languages. No text has needed them so far.
Text = Annotated[str, Meta(pattern=r'^[^"\\\n]+\Z')]
Byte = Annotated[int, Meta(ge=0, le=255)]


class DefinitionError(ValueError):
    """Raised when the definition has a fault. Its text says where the fault is, and what was expected."""


class Field(Struct, frozen=True, forbid_unknown_fields=True):
    """One field of a message."""

    name: Name
    type: Annotated[str, Meta(pattern=rf"^({'|'.join(NUMBERS)}|(bytes|text)[1-9]\d{{0,2}})\Z")]
    doc: Text
    unit: Text = ""
    scale: Decimal | None = None
    enum: str = ""
    flags: str = ""
    since: int = 0

    def __post_init__(self) -> None:
        if self.scale is not None:
            if self.type not in INTEGERS:
                raise ValueError(f"a scale needs an integer type, not {self.type}")
            if not self.unit:
                raise ValueError("a scale needs a unit")
            if not self.scale.is_finite() or self.scale <= 0:
                raise ValueError(f"scale {self.scale} is not a number above 0")
        if self.enum and self.flags:
            raise ValueError("either enum or flags")
        if (self.enum or self.flags) and self.type != "u8":
            raise ValueError(f"enum and flags need type u8, not {self.type}")

    @property
    def size(self) -> int:
        """Number of bytes on the wire."""
        return NUMBERS[self.type][1] if self.type in NUMBERS else self.length

    @property
    def length(self) -> int:
        """Length N of a type bytesN or textN; 0 for a number."""
        return 0 if self.type in NUMBERS else int(re.sub(r"\D", "", self.type))

    @property
    def code(self) -> str:
        """Format character of Python's struct."""
        return NUMBERS[self.type][0] if self.type in NUMBERS else f"{self.length}s"

    @property
    def scaled_unit(self) -> str:
        """Value of one count with its unit, such as "0.001 Hz"; empty if the field has no unit."""
        scale = "" if self.scale is None or self.scale == 1 else f"{self.scale.normalize():f} "
        return scale + self.unit

    @property
    def is_text(self) -> bool:
        """Whether the type is textN."""
        return self.type.startswith("text")


class Message(Struct, frozen=True, forbid_unknown_fields=True, rename={"fields": "field"}):
    """One message. The payload contains its fields in this order, without padding."""

    name: Annotated[str, Meta(pattern=r"^[A-Z][A-Z0-9_]*\Z", max_length=23)]
    id: Annotated[int, Meta(ge=1, le=255)]
    doc: Text
    fields: tuple[Field, ...]
    since: int = 0

    @property
    def size(self) -> int:
        """Number of payload bytes."""
        return sum(field.size for field in self.fields)

    @property
    def least(self) -> int:
        """Number of payload bytes in the oldest version that has this message."""
        return sum(field.size for field in self.fields if field.since <= self.since)


class Value(Struct, frozen=True):
    """One value of an enum, or one bit of a set of flags."""

    name: str
    value: int
    doc: str
    since: int


class Named(Struct, frozen=True):
    """An enum, or a set of flags."""

    name: str
    values: tuple[Value, ...]


class _Constants(Struct, frozen=True, forbid_unknown_fields=True):
    major: Byte
    minor: Byte
    oldest: Byte
    max_payload: Annotated[int, Meta(ge=0, le=COBS_BLOCK - 1 - HEADER_SIZE - CRC_SIZE)]
    baud: Annotated[int, Meta(ge=0, le=10_000_000)]


class Protocol(_Constants, frozen=True):
    """The whole definition."""

    messages: tuple[Message, ...]
    enums: tuple[Named, ...]
    flags: tuple[Named, ...]

    @property
    def max_frame(self) -> int:
        """Number of bytes of the longest frame before the encoding by COBS."""
        return HEADER_SIZE + self.max_payload + CRC_SIZE

    @property
    def max_encoded(self) -> int:
        """Number of bytes of the longest frame after the encoding by COBS, without the closing 0x00."""
        return self.max_frame + 1

    def canonical(self, minor: int) -> str:
        """Return the text whose CRC-32 is the schema hash of a minor version (protocol/README.md)."""
        lines = []
        for message in _until(minor, self.messages):
            lines.append(f"message {message.id} {message.name}")
            for field in _until(minor, message.fields):
                line = f"field {field.name} {field.type}"
                line += f" enum {field.enum}" if field.enum else ""
                line += f" flags {field.flags}" if field.flags else ""
                line += f" scale {field.scale.normalize():f}" if field.scale is not None else ""
                line += f" unit {field.unit}" if field.unit else ""
                lines.append(line)
        for kind, word, group in (("enum", "value", self.enums), ("flags", "bit", self.flags)):
            for named in group:
                if values := _until(minor, named.values):
                    lines.append(f"{kind} {named.name}")
                    lines += [f"{word} {value.value} {value.name}" for value in values]
        return "".join(line + "\n" for line in lines)

    @property
    def schema_hash(self) -> int:
        """Schema hash of the present minor version."""
        return self.schema_hashes[-1]

    @property
    def schema_hashes(self) -> list[int]:
        """Schema hash (CRC-32 of the text of `canonical`) of each minor version from `oldest` to `minor`."""
        return [zlib.crc32(self.canonical(minor).encode()) for minor in range(self.oldest, self.minor + 1)]


Dated = TypeVar("Dated", Message, Field, Value)


def _until(minor: int, members: Sequence[Dated]) -> list[Dated]:
    return [one for one in members if one.since <= minor]


class _Value(Struct, forbid_unknown_fields=True):
    value: Byte
    doc: Text
    since: int = 0


class _Bit(Struct, forbid_unknown_fields=True, rename={"value": "bit"}):
    value: Annotated[int, Meta(ge=0, le=7)]
    doc: Text
    since: int = 0


class _File(Struct, forbid_unknown_fields=True):
    protocol: _Constants
    message: tuple[Message, ...]
    enum: dict[Name, Annotated[dict[Name, _Value], Meta(min_length=1)]] = {}
    flags: dict[Name, Annotated[dict[Name, _Bit], Meta(min_length=1)]] = {}


def load(text: str) -> Protocol:
    """Parse and check the definition. If it has a fault, DefinitionError is raised."""
    try:
        document = tomllib.loads(text, parse_float=Decimal)
        file = msgspec.convert(document, _File)
    except tomllib.TOMLDecodeError as error:
        raise DefinitionError(f"not TOML: {error}") from None
    except msgspec.ValidationError as error:
        raise DefinitionError(_with_names(str(error), document)) from None
    protocol = Protocol(
        **msgspec.structs.asdict(file.protocol),
        messages=file.message,
        enums=tuple(_named(file.enum)),
        flags=tuple(_named(file.flags)),
    )
    for problem in _problems(protocol):
        raise DefinitionError(problem)
    return protocol


def _with_names(error: str, document: dict[str, object]) -> str:
    """Return an error text with the names of message and field instead of their indices."""
    found: object = document
    for key, place in re.findall(r"(message|field)\[(\d+)\]", error):
        found = found[key][int(place)] if isinstance(found, dict) else {}
        name = found.get("name") if isinstance(found, dict) else None
        error = error.replace(f"{key}[{place}]", f"{key}[{name}]")
    return error


def _named(tables: dict[str, dict[str, _Value]] | dict[str, dict[str, _Bit]]) -> Iterator[Named]:
    for name, members in tables.items():
        yield Named(name, tuple(Value(key, one.value, one.doc, one.since) for key, one in members.items()))


def _problems(protocol: Protocol) -> Iterator[str]:
    """Yield the faults that show only in the whole definition, such as two messages with the same name."""
    messages, fields = protocol.messages, [field for one in protocol.messages for field in one.fields]
    if protocol.oldest > protocol.minor:
        yield f"oldest {protocol.oldest} is later than minor {protocol.minor}"
        return
    yield from _twice("message: name", (one.name for one in messages))
    yield from _twice("message: id", (one.id for one in messages))
    for one in messages:
        yield from _twice(f"message {one.name}: field", (field.name for field in one.fields))
        if one.size > protocol.max_payload:
            yield f"message {one.name}: {one.size} bytes of payload; at most {protocol.max_payload} fit"
        since = [max(one.since, field.since) for field in one.fields]
        if since != sorted(since):
            yield f"message {one.name}: a field is added at the end, behind those of older versions"
    named = [*protocol.enums, *protocol.flags]
    yield from _twice("enum and flags:", (one.name for one in named))
    for table in named:
        yield from _twice(f"{table.name}: value", (value.value for value in table.values))
    for kind, group in (("enum", protocol.enums), ("flags", protocol.flags)):
        known, used = {one.name for one in group}, {getattr(field, kind) for field in fields} - {""}
        yield from (f"no [{kind}.{name}] in the file" for name in sorted(used - known))
        yield from (f"{kind} {name}: no field uses it" for name in sorted(known - used))
    names = [one.name for one in messages] + [field.name for field in fields]
    names += [name for table in named for name in (table.name, *(value.name for value in table.values))]
    dated: list[Message | Field | Value] = [
        *messages,
        *fields,
        *(value for table in named for value in table.values),
    ]
    for late in {one.since for one in dated} - {0, *range(protocol.oldest + 1, protocol.minor + 1)}:
        yield f"since {late}: additions are of versions after {protocol.oldest}, up to {protocol.minor}"
    for name in names:
        if name.lower() in RESERVED or "mpu" in name.lower().split("_"):
            yield f"name '{name}' is reserved (a word of C++ or Python, or a vendor macro)"
    if [(one.name, one.id) for one in messages[:1]] != [("HELLO", 1)]:
        yield "message HELLO with id 1 is missing: every version opens with it"
    elif [(field.name, field.type) for field in messages[0].fields[:3]] != FIXED_PREFIX:
        wanted = ", ".join(f"{name} {kind}" for name, kind in FIXED_PREFIX)
        yield f"message HELLO must begin with {wanted}: they never move in any version"


def _twice(what: str, values: Iterable[object]) -> Iterator[str]:
    seen = list(values)
    yield from (f"{what} {value} is there twice" for value in dict.fromkeys(seen) if seen.count(value) > 1)
