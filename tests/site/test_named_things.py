"""No comment, docstring or page names a file, test, make target, module or setting that does not exist."""

import re
import subprocess
from functools import cache

import pytest
from fltea.settings.config import Config
from fltea.settings.setting import all_declared

from tests.rig.host_support import ROOT
from tools import site_records

SOURCES = (".py", ".pyi", ".hpp", ".cpp", ".h", ".ino", ".sh")
ELSEWHERE = frozenset(
    {
        *(
            "Print.h",
            "UARTClass.h",
            "WInterrupts.h",
            "sam3x8e.h",
            "variant.h",
        ),  # a file of Arduino's core for SAM boards
        "gen_dataset.py",
        "mavlogdump.py",  # a program of pymavlink
        "random.py",  # an example of a file of the user
        "wit_protocol_resolver.py",  # a file from the sensor maker WitMotion
        "NAME.sh",  # NAME stands for any name
    }
)
"""Files of other programs that our texts name."""


@cache
def tracked() -> tuple[str, ...]:
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return tuple(name for name in listed.stdout.splitlines() if (ROOT / name).is_file())


def prose(name: str) -> str:
    """Return what a file says to readers: its comments and docstrings, or the whole text of a page."""
    source = (ROOT / name).read_text(encoding="utf-8")
    if name.endswith((".py", ".pyi")):
        return "\n".join(re.findall(r'(?m)(?:^|(?<=\s))# [^\n]*|^\s*(?:""".*?""")', source, re.DOTALL))
    if name.endswith((".hpp", ".cpp", ".h", ".ino")):
        return "\n".join(re.findall(r"//[^\n]*|/\*.*?\*/", source, re.DOTALL))
    if name.endswith((".sh", "Makefile", ".toml")):
        return "\n".join(re.findall(r"(?m)^\s*#.*$", source))
    return source


READ = [
    name
    for name in tracked()
    if name.endswith((*SOURCES, ".md", "Makefile", ".toml")) and name != "CHANGELOG.md"
]
ROOMS = sorted(path.name for path in (ROOT / "host/fltea").iterdir() if (path / "__init__.py").exists())


def unknown_files(text: str) -> set[str]:
    endings = "|".join(re.escape(ending[1:]) for ending in SOURCES)
    named = set(re.findall(rf"(?<![\w./:*{{}}<>-])([\w./-]*\w\.(?:{endings}))(?![\w/*])", text))
    return {one for one in named - ELSEWHERE if one.lstrip("./") not in ends_of_paths()}


@cache
def ends_of_paths() -> frozenset[str]:
    """Return every name that a text may use for a file: its path, or an end of it from a folder on."""
    parts = [name.split("/") for name in tracked()]
    return frozenset("/".join(one[n:]) for one in parts for n in range(len(one)))


@cache
def known_tests() -> frozenset[str]:
    found = set()
    for name in tracked():
        if name.startswith("tests/") and name.endswith((".py", ".cpp")):
            found |= set(re.findall(r"\btest_\w+", (ROOT / name).read_text(encoding="utf-8")))
            found.add(name.rsplit("/", 1)[1].partition(".")[0])
    return frozenset(found)


def unknown_targets(text: str) -> set[str]:
    targets = set(re.findall(r"(?m)^([a-z-]+):(?!=)", (ROOT / "Makefile").read_text(encoding="utf-8")))
    return set(re.findall(r"`make ([a-z][a-z-]*)", text)) - targets


@cache
def settings() -> frozenset[str]:
    """Return the names of settings, such as estimator.order.Q0, and those of their tables."""
    found = set(all_declared(Config()))
    return frozenset({*found, *(".".join(name.split(".")[:n]) for name in found for n in range(1, 4))})


def unknown_modules(text: str) -> set[str]:
    """Return the names `package.module.Name` in a text whose module is not in that package of the host."""
    found = set()
    for room, module in re.findall(rf"`(?:fltea\.)?({'|'.join(ROOMS)})\.(\w+)\.[A-Z]\w+`", text):
        folder = ROOT / "host/fltea" / room
        exists = (folder / f"{module}.py").exists() or (folder / module).is_dir()
        if not exists and f"{room}.{module}" not in settings():
            found.add(f"{room}.{module}")
    return found


@cache
def fields_of_records() -> frozenset[str]:
    """Return the names of record fields, such as link.frames, and of the objects that contain them."""
    rows = re.findall(r"(?m)^\| `([^`]+)`", site_records.records())
    return frozenset({*rows, *(".".join(name.split(".")[:n]) for name in rows for n in (1, 2))})


def unknown_settings(text: str) -> set[str]:
    """Return names in a text that look like settings, as `link.no_such` does, but are none.

    Names of record fields may look the same, and are not returned.
    """
    tables = {name.partition(".")[0] for name in settings() if "." in name}
    named = re.findall(rf"`((?:{'|'.join(sorted(tables))})(?:\.[a-zA-Z]\w*)+)(?: ?=[^`]*)?`", text)
    return {name for name in named if name not in settings() and name not in fields_of_records()}


@pytest.mark.parametrize("name", READ)
def test_what_a_text_names_exists(name: str) -> None:
    text = prose(name)
    assert unknown_files(text) == set()
    assert set(re.findall(r"`(test_\w+)`", text)) - known_tests() == set()
    assert unknown_targets(text) == set()
    assert unknown_modules(text) == set()
    if name.endswith(".md"):
        assert unknown_settings(text) == set()
