"""Tests that hosts and boards with successive minor versions of the protocol understand each other.

The later version has additions only where these are permitted.
"""

import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from fltea.wire import layout as wire
from fltea.wire.block_reader import FrameReader
from fltea.wire.messages import BadFrame, Frame, Refused, encode, encode_frame, refusal

from tests.rig.protocol_support import DEFINITION, HELLO, PROTOCOL, ROOT
from tests.rig.toolchain import needed
from tools import gen_protocol, protocol_definition
from tools.protocol_definition import DefinitionError

MINOR = PROTOCOL.minor + 1
ADDED_FIELD = f"""
[[message.field]]
name = "added"
type = "i16"
since = {MINOR}
doc = "what boards of before do not know"
"""
NEXT = protocol_definition.load(
    DEFINITION.replace(f"minor = {PROTOCOL.minor}", f"minor = {MINOR}")
    .replace("# ----", ADDED_FIELD + "# ----", 3)
    # In messages.toml, a line `# ----` stands before each of the first messages. A field put before such a
    # line belongs to the message above it. Nothing is above the first line, so the field is removed there.
    .replace(ADDED_FIELD, "", 1)
    .replace(
        "data_ready = { value = 1",
        f'later = {{ value = 9, since = {MINOR}, doc = "x" }}\ndata_ready = {{ value = 1',
    )
    .replace("late = { bit = 0", f'newest = {{ bit = 6, since = {MINOR}, doc = "x" }}\nlate = {{ bit = 0')
    + f'\n[[message]]\nname = "NOTE"\nid = 99\nsince = {MINOR}\ndoc = "x"\n'
    + ADDED_FIELD.replace(f"since = {MINOR}", "")
)
"""The definition of the protocol's next minor version.

In this version, HELLO and SAMPLE have one more field each. New are also a message, a value of an enum and a
bit of the flags.
"""


def module_of(protocol: protocol_definition.Protocol) -> Any:
    """Return the Python module that is generated from a definition."""
    module = sys.modules[f"next_{id(protocol)}"] = ModuleType(f"next_{id(protocol)}")
    exec(gen_protocol.module(protocol), module.__dict__)
    return module


later = module_of(NEXT)
LATER_HELLO = (1, MINOR, later.SCHEMA_HASH, *HELLO[3:-1], 9, 77)
SAMPLE = (1, -2, 3, -4, 5, -6, 7, 0x41)


def test_the_hash_of_a_version_stays_when_the_next_one_adds() -> None:
    assert later.SCHEMA_HASHES == (wire.SCHEMA_HASH, later.SCHEMA_HASH)
    assert later.SCHEMA_HASH != wire.SCHEMA_HASH


def test_this_host_reads_the_next_board_as_far_as_it_knows_it() -> None:
    reader = FrameReader()
    messages = [later.Hello(*LATER_HELLO), later.Sample(*SAMPLE, 12), later.Note(5), later.Status(*(0,) * 8)]
    found = reader.feed_all(b"\0" + b"".join(encode(message, 3, 4) for message in messages))
    hello, sample, note, status = found
    assert hello == Frame(1, 3, 4, wire.Hello(*LATER_HELLO[:-1]))
    assert sample == Frame(2, 3, 4, wire.Sample(*SAMPLE))
    assert isinstance(note, BadFrame)
    assert status == Frame(3, 3, 4, wire.Status(*(0,) * 8))
    assert reader.counts == {"frames": 3, "unknown_type": 1}


def test_the_next_host_reads_this_board_and_takes_what_is_missing_for_0() -> None:
    assert later.Hello.unpack(HELLO.pack()) == (*HELLO, 0)
    assert later.Sample.unpack(wire.Sample(*SAMPLE).pack()) == (*SAMPLE, 0)
    assert (later.Sample.LEAST, later.Sample.SIZE) == (wire.Sample.SIZE, wire.Sample.SIZE + 2)


PROGRAM = """
#include "decoder.hpp"
#include <cstdio>
int main() {
    uint8_t bytes[4096];
    const size_t n = fread(bytes, 1, sizeof bytes, stdin);
    fltea::Decoded found;
    fltea::Decoder().feed(bytes, n, found);
    for (const auto& row : found.samples) printf("sample %d %d\\n", row.sample.gyro_x, row.sample.added);
    for (const auto& other : found.others)
        printf("%s %d %zu\\n", other.reason == fltea::Reason::none ? "frame" : reason_name(other.reason),
               other.type, other.size);
    printf("%d %d %d\\n", fltea::can_read(1, %MINOR%, %HASH%), fltea::can_read(1, %MINOR%, 1),
           fltea::can_read(2, %MINOR%, %HASH%));
}
"""


@pytest.mark.long
def test_the_next_native_decoder_reads_this_board_and_the_one_after_it(tmp_path: Path) -> None:
    (tmp_path / "messages.h").write_text(gen_protocol.header(NEXT))
    program = PROGRAM.replace("%MINOR%", str(PROTOCOL.minor)).replace("%HASH%", str(wire.SCHEMA_HASH))
    (tmp_path / "main.cpp").write_text(program)
    folders = [f"-I{tmp_path}", f"-I{ROOT / 'host/native'}"]
    sources = [tmp_path / "main.cpp", ROOT / "host/native/decoder.cpp"]
    flags = ["-std=c++17", "-fsanitize=address,undefined"]
    subprocess.run([needed("g++"), *flags, *folders, *sources, "-o", tmp_path / "read"], check=True)
    sample = wire.Sample(*SAMPLE)
    longer = encode_frame(2, 0, 0, later.Sample(*SAMPLE, 12).pack() + b"xyz")
    cut = encode_frame(2, 0, 0, sample.pack()[:-1])
    data = b"\0" + b"".join([encode(HELLO, 0, 0), encode(sample, 1, 2), longer, cut])
    done = subprocess.run([tmp_path / "read"], input=data, capture_output=True, check=True)
    assert done.stdout.decode().splitlines() == [
        "sample 1 0",
        "sample 1 12",
        f"frame 1 {wire.Hello.SIZE}",
        f"length 0 {len(cut) - 1}",
        "1 0 0",
    ]


@pytest.mark.parametrize(
    ("major", "minor", "schema", "readable"),
    [
        (1, PROTOCOL.minor, wire.SCHEMA_HASH, True),
        # the version is the same but the hash is not: the definition was changed
        (1, PROTOCOL.minor, 0xDEADBEEF, False),
        # this minor version is older than `oldest` in messages.toml: messages that it has were changed since
        (1, PROTOCOL.minor - 1, 0xDEADBEEF, False),
        (1, MINOR, 0xDEADBEEF, True),
        (2, MINOR, 0xDEADBEEF, False),
        (2, PROTOCOL.minor, wire.SCHEMA_HASH, False),
    ],
)
def test_which_versions_are_read(major: int, minor: int, schema: int, readable: bool) -> None:
    hello = HELLO._replace(protocol_major=major, protocol_minor=minor, schema_hash=schema)
    assert refusal(hello.pack()) == (None if readable else Refused(major, minor, schema))


@pytest.mark.parametrize(
    ("old", "new", "error"),
    [
        (f"oldest = {PROTOCOL.oldest}", "oldest = 200", r"oldest 200 is later than minor"),
        ('name = "detail"', f'since = {PROTOCOL.oldest}\nname = "detail"', r"since \d+: additions are of"),
        ('name = "gyro_x"', f'since = {MINOR + 1}\nname = "gyro_x"', r"message SAMPLE: a field is added at"),
    ],
)
def test_an_addition_at_the_wrong_place_is_named(old: str, new: str, error: str) -> None:
    assert old in DEFINITION
    with pytest.raises(DefinitionError, match=error):
        protocol_definition.load(DEFINITION.replace(old, new, 1))
