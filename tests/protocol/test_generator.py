"""Tests of the code generator.

With `--check` the generator names the generated files that are out of date. Its errors name the mistake in
the definition of the protocol.

`make lint` checks the committed files with `--check`.
"""

import shutil
import zlib
from pathlib import Path

import pytest
from fltea.wire import layout as wire

from tests.rig.protocol_support import DEFINITION, PROTOCOL, ROOT
from tests.rig.toolchain import run_tool
from tools.protocol_definition import DefinitionError, load

FILES = ["firmware/core/messages.h", "host/fltea/wire/layout.py"]


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for name in [*FILES, "protocol/messages.toml"]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, tmp_path / name)
    return tmp_path


def test_check_names_what_differs_and_writes_nothing(tree: Path) -> None:
    definition = tree / "protocol/messages.toml"
    definition.write_text(DEFINITION.replace('name = "boot_id"', 'name = "boot_number"'))
    before = {name: (tree / name).read_bytes() for name in FILES}
    done = run_tool("generated", tree, "gen_protocol", "--check")
    assert done.returncode == 1
    assert [line.split()[0] for line in done.stderr.splitlines()] == FILES
    assert before == {name: (tree / name).read_bytes() for name in FILES}


def test_generate_writes_only_what_differs(tree: Path) -> None:
    (tree / FILES[1]).write_text("")
    stamps = {name: (tree / name).stat().st_mtime_ns for name in FILES}
    done = run_tool("generated", tree, "gen_protocol")
    assert (done.returncode, done.stdout) == (0, f"wrote {FILES[1]}\n")
    assert (tree / FILES[1]).read_text() == (ROOT / FILES[1]).read_text()
    assert (tree / FILES[0]).stat().st_mtime_ns == stamps[FILES[0]]


def test_what_is_wrong_ends_the_command(tree: Path) -> None:
    (tree / "protocol/messages.toml").write_text(DEFINITION.replace("id = 2", "id = 1"))
    done = run_tool("generated", tree, "gen_protocol")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "protocol/messages.toml: message: id 1 is there twice\n"


def test_schema_hash_covers_what_changes_the_meaning_of_bytes() -> None:
    assert zlib.crc32(PROTOCOL.canonical(PROTOCOL.minor).encode()) == wire.SCHEMA_HASH
    for old, new in [
        ("id = 4", "id = 40"),
        ('name = "gyro_x"', 'name = "gyro_w"'),
        ('name = "FAULT"', 'name = "FAILURE"'),
        ('type = "i16"\nunit = "LSB"', 'type = "u16"\nunit = "LSB"'),
        ("scale = 0.001", "scale = 0.01"),
        ('unit = "g"', 'unit = "m/s^2"'),
        ('type = "f32"', 'type = "u32"'),
        ("timer = { value = 0", "timer = { value = 9"),
        ("late = { bit = 0", "late = { bit = 7"),
        ("retried = {", "repeated_read = {"),
    ]:
        assert old in DEFINITION
        assert load(DEFINITION.replace(old, new, 1)).schema_hash != PROTOCOL.schema_hash, new
    for old, new in [
        ('doc = "kind of the fault"', 'doc = "sort of the fault"'),
        ("scale = 0.001", "scale = 0.0010"),
        (f"minor = {PROTOCOL.minor}", "minor = 99"),
        ("max_payload = 240", "max_payload = 200"),
    ]:
        assert old in DEFINITION
        assert load(DEFINITION.replace(old, new, 1)).schema_hash == PROTOCOL.schema_hash, new


@pytest.mark.parametrize(
    ("old", "new", "error"),
    [
        ("id = 2", "id = 1", r"message: id 1 is there twice"),
        ('name = "STATUS"', 'name = "SAMPLE"', r"message: name SAMPLE is there twice"),
        ('name = "gyro_y"', 'name = "gyro_x"', r"message SAMPLE: field gyro_x is there twice"),
        ("id = 2", "id = 256", r"`int` <= 255 - at `\$.message\[SAMPLE\].id`"),
        ("id = 2", "id = 0", r"`int` >= 1 - at `\$.message\[SAMPLE\].id`"),
        ("id = 2", "id = true", r"`int`, got `bool` - at `\$.message\[SAMPLE\].id`"),
        (
            'type = "text24"',
            'type = "text"',
            r"\(u8\|u16.* - at `.*\[HELLO\].field\[firmware_version\].type`",
        ),
        ('type = "text24"', 'type = "u12"', r"firmware_version\].type`"),
        ('type = "text24"', 'type = "f64"', r"firmware_version\].type`"),
        ('type = "text24"', 'type = "text0"', r"firmware_version\].type`"),
        ('type = "text24"', "type = 24", r"`str`, got `int` .*firmware_version\].type`"),
        ('type = "text24"', 'type = "text197"', r"message HELLO: 241 bytes of payload; at most 240 fit"),
        ("max_payload = 240", "max_payload = 243", r"`int` <= 242 - at `\$.protocol.max_payload`"),
        (f"minor = {PROTOCOL.minor}", "minor = 256", r"`int` <= 255 - at `\$.protocol.minor`"),
        ("fifo = { value = 2", "fifo = { value = 256", r"`int` <= 255 - at `\$.enum"),
        ("fifo = { value = 2", "fifo = { value = -1", r"`int` >= 0 - at `\$.enum"),
        ("fifo = { value = 2", "fifo = { value = 1", r"sampling_mode: value 1 is there twice"),
        ("late = { bit = 0", "late = { bit = 8", r"`int` <= 7 - at `\$.flags"),
        ("late = { bit = 0", "late = { value = 0", r"unknown field `value` - at `\$.flags"),
        ('enum = "fault_code"', 'enum = "fault"', r"no \[enum.fault\] in the file"),
        ('enum = "fault_code"', "", r"enum fault_code: no field uses it"),
        (
            'name = "alpha"\ntype = "f32"',
            'name = "alpha"\ntype = "f32"\nunit = "1"\nscale = 0.5',
            r"a scale needs an integer type, not f32 - at `.*\[ESTIMATE\].field\[alpha\]`",
        ),
        (
            'name = "alpha"\ntype = "f32"',
            'name = "alpha"\ntype = "f32"\nenum = "axis"',
            r"enum and flags need type u8, not f32 - at `.*\[ESTIMATE\].field\[alpha\]`",
        ),
        ("scale = 0.001", "scale = 0", r"scale 0 is not a number above 0 - at `.*field\[sample_rate\]`"),
        ("scale = 0.001", 'scale = "x"', r"field\[sample_rate\].scale`"),
        ("scale = 0.001", "scale = nan", r"scale .* is not a number above 0"),
        ('unit = "Hz"\nscale', "scale", r"a scale needs a unit - at `.*\[HELLO\].field\[sample_rate\]`"),
        ("scale = 0.001", "scal = 0.001", r"unknown field `scal` - at `.*field\[sample_rate\]`"),
        ('doc = "kind of the fault"', "", r"required field `doc` - at `.*\[FAULT\].field\[code\]`"),
        ('doc = "kind of the fault"', 'doc = "kind of \\"fault\\""', r"\[FAULT\].field\[code\].doc`"),
        ('name = "overruns"', 'name = "over runs"', r"\[STATUS\].field\[over runs\].name`"),
        ('name = "overruns"', 'name = "register"', r"name 'register' is reserved"),
        ('name = "overruns"', 'name = "count"', r"name 'count' is reserved"),
        ('name = "FAULT"', 'name = "MPU"', r"name 'MPU' is reserved"),
        ('name = "overruns"', f'name = "{"o" * 24}"', r"`str` of length <= 23"),
        ('name = "HELLO"', 'name = "HI"', r"message HELLO with id 1 is missing"),
        ('name = "schema_hash"', 'name = "hash"', r"HELLO must begin with protocol_major u8"),
        ("[protocol]", "[protocols]", r"unknown field `protocols`"),
        ("[protocol]", "[protocol", r"not TOML"),
    ],
)
def test_wrong_definitions_are_named(old: str, new: str, error: str) -> None:
    assert old in DEFINITION
    with pytest.raises(DefinitionError, match=error):
        load(DEFINITION.replace(old, new, 1))
