"""Test the committed image of the firmware for the Due, whether the sources reproduce it bit by bit, and the
program that checks this.
"""

import hashlib
import json
import re
import shutil
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.rig.tiers import long, slow
from tests.rig.toolchain import arm_compiler, missing, run_tool

ROOT = Path(__file__).resolve().parents[2]
IMAGE = "firmware/due/image/fltea_due.bin"
RECORD = "firmware/due/image/fltea_due.json"
BUILD_ID = "firmware/core/build_id.h"
ELF = "build/firmware/timer/fltea_due.elf"

FLASH = range(0x00080000, 0x00100000)
RAM = range(0x20070000, 0x20088000)
UART, PIOB, TC0 = 8, 12, 27


def copy_tree(root: Path) -> Path:
    shutil.copytree(ROOT / "firmware", root / "firmware")
    shutil.copy2(ROOT / "pyproject.toml", root)
    return root


def vectors(image: bytes) -> tuple[int, int, tuple[int, ...], tuple[int, ...]]:
    stack, reset, *rest = struct.unpack("<61I", image[: 61 * 4])
    return stack, reset, tuple(rest[:14]), tuple(rest[14:])


def image() -> bytes:
    return (ROOT / IMAGE).read_bytes()


def record() -> dict[str, Any]:
    return dict(json.loads((ROOT / RECORD).read_text()))


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the project's sources in which both images of the firmware were freshly built."""
    arm_compiler()
    root = copy_tree(tmp_path_factory.mktemp("first") / "fltea")
    done = run_tool("build_firmware", root)
    assert done.returncode == 0, done.stderr
    return root


def test_image_is_what_the_sources_give() -> None:
    done = run_tool("build_firmware", ROOT, "--check")
    if done.returncode in (3, 4):
        missing(done.stderr)
    assert done.returncode == 0, done.stderr


def test_record_tells_of_this_image() -> None:
    assert record()["sha256"] == hashlib.sha256(image()).hexdigest()
    assert record()["flash_bytes"] == len(image())
    assert record()["sampling_mode"] == "timer"


def test_build_id_is_the_same_everywhere() -> None:
    done = run_tool("generated", ROOT, "build_id", "--check")
    assert done.returncode == 0, done.stderr
    text = (ROOT / BUILD_ID).read_text()
    named = dict(re.findall(r'constexpr char (\w+)\[\] = "(.*)";', text))
    assert named == {"kVersion": record()["version"], "kBuildId": record()["build_id"]}
    assert record()["build_id"].encode() + b"\0" in image()
    assert record()["version"].encode() + b"\0" in image()
    assert len(f"{named['kVersion']} due {named['kBuildId']}") <= 24


def test_size_keeps_its_limits() -> None:
    assert record()["flash_bytes"] <= 50_000
    sizes = f"{record()['flash_bytes']:,} and {record()['ram_bytes']:,} bytes"
    assert sizes in (ROOT / "firmware/README.md").read_text(encoding="utf-8")
    assert record()["ram_bytes"] <= 48 * 1024


def test_vector_table() -> None:
    stack, reset, exceptions, interrupts = vectors(image())
    assert stack % 8 == 0
    assert RAM.start < stack <= RAM.stop
    for handler in (reset, *exceptions, *interrupts):
        assert handler % 2 == 1, "Thumb state"
        assert FLASH.start + 61 * 4 <= handler < FLASH.start + len(image())
    unexpected = exceptions[0]
    assert set(exceptions) == {unexpected}
    assert {n for n, handler in enumerate(interrupts) if handler != unexpected} == {UART, TC0}
    assert len({unexpected, reset, interrupts[UART], interrupts[TC0]}) == 4


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mode", "handlers"),
    [
        long("timer", {UART: "on_uart", TC0: "on_tick"}),
        ("data_ready", {UART: "on_uart", TC0: "on_tick", PIOB: "on_data_ready_pin"}),
    ],
)
def test_each_interrupt_has_its_own_handler(built: Path, mode: str, handlers: dict[int, str]) -> None:
    folder = built / "build/firmware" / mode
    command = ["arm-none-eabi-nm", "-C", str(folder / "fltea_due.elf")]
    names = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    address = {name: int(value, 16) for value, name in re.findall(r"^(\w+) T (?:.*::)?(\w+)", names, re.M)}
    stack, reset, exceptions, interrupts = vectors((folder / "fltea_due.bin").read_bytes())
    assert (reset, exceptions[0]) == (address["reset_handler"] | 1, address["unexpected_handler"] | 1)
    for number, handler in enumerate(interrupts):
        assert handler == address[handlers.get(number, "unexpected_handler")] | 1, number
    assert f"{stack:08x} B stack_top" in names or f"{stack:08x} b stack_top" in names


def test_image_knows_no_paths() -> None:
    texts = re.findall(rb"[ -~]{6,}", image())
    # Machine code contains the byte of a slash, too, but not between letters as in a path.
    path = re.compile(rb"[a-z_]{3,}/[a-z_]{3,}|\.cpp$|\.hp*$")
    assert not [text for text in texts if path.search(text)]
    assert all(map(path.search, (b"firmware/core", b"noise_fit.cpp")))


@pytest.mark.long
def test_bytes_do_not_depend_on_the_place(built: Path, tmp_path: Path) -> None:
    root = copy_tree(tmp_path / "another place/and deeper")
    done = run_tool("build_firmware", root)
    assert done.returncode == 0, done.stderr
    for mode in ("timer", "data_ready"):
        for name in ("fltea_due.bin", "fltea_due.elf"):
            file = f"build/firmware/{mode}/{name}"
            assert (root / file).read_bytes() == (built / file).read_bytes(), file
    assert (root / RECORD).read_text() == (built / RECORD).read_text()


def disassembly(root: Path, function: str) -> list[str]:
    command = ["arm-none-eabi-objdump", "-dC", "--no-show-raw-insn", str(root / ELF)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found = re.search(
        rf"^[0-9a-f]+ <[^\n]*{function}[^\n]*>:\n(.*?)\n\n", done.stdout, re.DOTALL | re.MULTILINE
    )
    assert found, function
    return found[1].splitlines()


@pytest.mark.slow
def test_unique_id_is_read_from_ram_alone(built: Path) -> None:
    lines = disassembly(built, "read_unique_words")
    assert int(lines[0].split(":")[0], 16) in RAM
    branches = [line for line in lines if re.search(r"\tb\w*(\.[nw])?\t|\tcbn?z\t", line)]
    assert branches
    # each branch has to stay in this function: the linker could insert a jump in RAM that leads to code in
    # flash
    for line in branches:
        assert "read_unique_words" in line.partition("\t")[2], f"leaves the function: {line}"


@pytest.mark.slow
def test_no_double_and_no_libc(built: Path) -> None:
    command = ["arm-none-eabi-nm", "-C", str(built / ELF)]
    names = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "reset_handler" in names
    assert not re.search(
        r"__aeabi_(d|\w*2d)|\b(exp|log|pow|sin|sqrt)f?$|malloc|printf|atexit|operator new|_GLOBAL__sub_I",
        names,
    )


@pytest.mark.long
def test_check_finds_a_changed_byte(built: Path, tmp_path: Path) -> None:
    root = copy_tree(tmp_path / "fltea")
    shutil.copytree(built / "firmware", root / "firmware", dirs_exist_ok=True)
    changed = bytearray((root / IMAGE).read_bytes())
    changed[0x200] ^= 1
    (root / IMAGE).write_bytes(changed)
    done = run_tool("build_firmware", root, "--check")
    assert done.returncode == 1
    assert "another image" in done.stderr
    facts = json.loads((root / RECORD).read_text())
    facts["sha256"] = hashlib.sha256(changed).hexdigest()
    (root / RECORD).write_text(json.dumps(facts))
    done = run_tool("build_firmware", root, "--check")
    assert done.returncode == 1
    assert "first differing byte at 0x00080200" in done.stderr


def test_check_finds_a_changed_source(tmp_path: Path) -> None:
    root = copy_tree(tmp_path)
    source = root / "firmware/due/clock.cpp"
    source.write_text(source.read_text() + "// changed\n")
    # with an empty PATH: the check needs no compiler
    done = run_tool("build_firmware", root, "--check", env={"PATH": ""})
    assert done.returncode == 1
    assert record()["build_id"] in done.stderr
    done = run_tool("generated", root, "build_id", "--check")
    assert done.returncode == 1
    assert BUILD_ID in done.stderr


def without_the_image(root: Path) -> None:
    (root / RECORD).unlink()


def as_it_is(root: Path) -> None: ...


def with_another_compiler(root: Path) -> None:
    (root / RECORD).write_text(json.dumps({**record(), "compiler": "arm-none-eabi-g++ 4.8.3"}))


@pytest.mark.parametrize(
    ("change", "has_compiler", "code", "says"),
    [
        (without_the_image, True, 1, "missing"),
        (as_it_is, False, 3, "gcc-arm-none-eabi"),
        slow(with_another_compiler, True, 4, "4.8.3"),
    ],
)
def test_what_cannot_be_checked_is_told(
    change: Callable[[Path], None], has_compiler: bool, code: int, says: str, tmp_path: Path
) -> None:
    if code == 4:
        arm_compiler()
    root = copy_tree(tmp_path)
    change(root)
    how = {} if has_compiler else {"env": {"PATH": str(tmp_path)}}
    done = run_tool("build_firmware", root, "--check", **how)
    assert (done.returncode, says in done.stderr) == (code, True), done.stderr


@pytest.mark.parametrize("change", ["content", "name", "new"])
def test_build_id_follows_the_sources(tmp_path: Path, change: str) -> None:
    root = copy_tree(tmp_path)
    source = root / "firmware/due/led.cpp"
    if change == "content":
        source.write_text(source.read_text().replace("27", "26"))
    elif change == "name":
        source.rename(source.with_name("lcd.cpp"))  # the new name sorts to the same place among the files
    else:
        source.with_name("empty.h").touch()
    assert run_tool("generated", root, "build_id").returncode == 0
    text = (root / BUILD_ID).read_text()
    assert record()["build_id"] not in text
    assert re.search(r'kBuildId\[\] = "[0-9a-f]{8}"', text)
