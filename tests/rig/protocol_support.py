"""Helpers for the tests of the protocol.

The helpers read the protocol's vector files and its definition, and make hypothesis try the same examples in
each run.
"""

import math
from pathlib import Path

from fltea.wire import layout as wire
from hypothesis import settings
from hypothesis import strategies as st

from tools import protocol_definition

ROOT = Path(__file__).resolve().parents[2]
VECTORS = ROOT / "protocol/vectors"


DEFINITION = (ROOT / "protocol/messages.toml").read_text()
PROTOCOL = protocol_definition.load(DEFINITION)

HELLO = wire.Hello(
    1, 0, wire.SCHEMA_HASH, 7, bytes(16), "fltea 0.1.0", 0x71, 1, 100_000, 2000, 164, 2, 16384, 184, 3
)


def fixed(max_examples: int = 150) -> settings:
    """Return hypothesis settings without randomness: every run tries the same examples."""
    return settings(derandomize=True, database=None, deadline=None, max_examples=max_examples)


def table(name: str) -> list[tuple[str, str]]:
    """Return the rows of a vector file (test data of the protocol). Each row is `left | right`, such as
    decoded and encoded bytes.
    """
    lines = [line for line in (VECTORS / name).read_text().splitlines() if line and line[0] != "#"]
    return [tuple(part.strip() for part in line.split("|")) for line in lines]


def run(text: str) -> bytes:
    """Return the bytes that a hexadecimal text stands for.

    `XX..YY` stands for all bytes from XX up to YY, `-` for no bytes.
    """
    out = b""
    for word in text.replace("-", "").split():
        first, _, last = word.partition("..")
        out += bytes(range(int(first, 16), int(last or first, 16) + 1))
    return out


def records(name: str) -> list[list[tuple[str, str]]]:
    """Return the records of a vector file as lists of (key, value).

    In the file, blank lines separate records; each other line is `key value`.
    """
    lines = [line for line in (VECTORS / name).read_text().splitlines() if not line.startswith("#")]
    blocks = "\n".join(lines).strip("\n").split("\n\n")
    return [
        [(key, value) for key, _, value in (line.partition(" ") for line in b.split("\n"))] for b in blocks
    ]


def names(found: list[list[tuple[str, str]]]) -> list[str]:
    return [dict(record)["name"] for record in found]


_F32 = [3.4028234663852886e38, 2.0**-126, 2.0**-149, 0.0, math.inf, math.nan, 1.25]
"""Special values of an f32: the largest, the smallest normal, the smallest denormal, zero, and others. Tests
use them with both signs.
"""


def floats() -> st.SearchStrategy[float]:
    """Draw every kind of f32.

    Compare results with such floats by `repr`, in which a NaN equals itself and -0.0 differs from 0.0.
    """
    return st.one_of(st.floats(width=32), st.sampled_from([*_F32, *(-number for number in _F32)]))


_RANGES = {"u8": (0, 255), "u16": (0, 65535), "u32": (0, 2**32 - 1), "i16": (-32768, 32767)}


def _values(field: protocol_definition.Field) -> st.SearchStrategy:
    if field.is_text:
        letters = st.characters(codec="ascii")
        return st.text(letters, max_size=field.length).filter(lambda text: not text.endswith("\0"))
    if field.length:
        return st.binary(min_size=field.length, max_size=field.length)
    if field.type == "f32":
        return floats()
    low, high = _RANGES[field.type]
    return st.one_of(st.integers(low, high), st.sampled_from([low, high, 0]))


def _messages(message: protocol_definition.Message) -> st.SearchStrategy[wire.Message]:
    fields = {field.name: _values(field) for field in message.fields}
    # The version in HELLO is not drawn: a receiver refuses a HELLO of another protocol version before it
    # reads the other fields.
    if message.name == "HELLO":
        fields["protocol_major"] = st.just(wire.PROTOCOL_MAJOR)
        fields["schema_hash"] = st.just(wire.SCHEMA_HASH)
    return st.builds(wire.MESSAGES[message.id], **fields)


messages = st.one_of([_messages(message) for message in PROTOCOL.messages])
sequences = st.integers(0, 2**16 - 1)
times = st.integers(0, 2**32 - 1)
