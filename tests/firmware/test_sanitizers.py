"""Test the compiler flags of the C++ tests: a program built with them stops when it reads an unaligned word,
as the device's processor does.
"""

import re
import subprocess
from pathlib import Path

import pytest

from tests.rig.toolchain import needed

FOLDERS = [Path(__file__).parent, Path(__file__).parents[1] / "native"]
READS = """#include <cstdint>
__attribute__((noinline)) uint32_t word(const unsigned char* at) {
    return *reinterpret_cast<const uint32_t*>(at);
}
int main(int arguments, char**) {
    alignas(8) unsigned char bytes[16] = {};
    return static_cast<int>(word(bytes + (arguments - 1)));
}
"""
"""A program that reads a word; with an argument, the word's address is unaligned (no multiple of 4)."""


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_an_unaligned_word_stops_what_is_built_with_them(folder: Path, tmp_path: Path) -> None:
    asked = ["make", "-C", folder, "-pnB", f"BUILD={tmp_path}", f"{tmp_path}/tests"]
    said = subprocess.run(asked, capture_output=True, text=True, check=False).stdout
    flags = re.findall(r"^FLAGS := (.*)$", said, re.MULTILINE)
    assert len(flags) == 1
    sanitizers = re.findall(r"-f\S*sanitize\S*", flags[0])
    compiled = [line for line in said.splitlines() if re.search(r"\s-c\s-o\s\S+\.o\s", line)]
    bare = [line for line in compiled if not set(sanitizers) <= set(line.split())]
    assert len(compiled) > 2
    assert all(line.endswith("main.cpp") for line in bare), "doctest's own code alone goes without"
    (tmp_path / "reads.cpp").write_text(READS)
    compiler = needed("g++")
    made = [compiler, "-Og", *sanitizers, "-o", tmp_path / "reads", tmp_path / "reads.cpp"]
    subprocess.run(made, check=True)
    assert subprocess.run([tmp_path / "reads"], check=False).returncode == 0
    stopped = subprocess.run([tmp_path / "reads", "1"], capture_output=True, text=True, check=False)
    assert stopped.returncode != 0
    assert "misaligned address" in stopped.stderr
