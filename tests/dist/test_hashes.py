"""Set-up installs only pinned packages, with a hash for every file (tools/hashes.sh)."""

import re
import subprocess
import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tests.rig.host_support import ROOT

PINNED = re.compile(r"^([A-Za-z0-9][\w.-]*)==(\S+)", re.MULTILINE)
LISTS = ("build", "run", "dev", "audit", "dist")


def plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def pins(file: Path) -> dict[str, str]:
    return {plain(name): version for name, version in PINNED.findall(file.read_text("utf-8"))}


def hashes(name: str) -> dict[str, str]:
    return pins(ROOT / f"tools/hashes/{name}.txt")


CONSTRAINTS = pins(ROOT / "constraints.txt")


@pytest.mark.parametrize("name", LISTS)
def test_every_package_has_a_version_and_a_hash(name: str) -> None:
    text = (ROOT / f"tools/hashes/{name}.txt").read_text("utf-8")
    assert "://" not in text
    entries = re.split(r"^(?=[a-z])", text, flags=re.MULTILINE)[1:]
    assert len(entries) == len(hashes(name)) > 4
    for entry in entries:
        assert PINNED.match(entry), entry
        assert re.search(r"^    --hash=sha256:[0-9a-f]{64}( \\)?$", entry, re.MULTILINE), entry


@pytest.mark.parametrize("name", ["build", "run", "dev"])
def test_the_versions_are_those_of_the_constraints(name: str) -> None:
    found = hashes(name)
    other = {package for package in found if found[package] != CONSTRAINTS.get(package)}
    assert not other, f"constraints.txt has no or another version of {other}: `make hashes` after a change"


def test_nothing_that_is_asked_for_is_left_out() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"]
    script = (ROOT / "tools/hashes.sh").read_text("utf-8")

    def named(requirements: list[str]) -> set[str]:
        found = set()
        for one in requirements:
            inner = re.match(r"fltea\[(.*)\]", one)
            if inner:
                found |= {name for extra in inner[1].split(",") for name in named(extras[extra])}
            else:
                found.add(plain(re.split(r"[\[<>=~; ]", one)[0]))
        return found

    for level in ("run", "dev"):
        match = re.search(rf"^hashes {level} .*\(extras (.*)\)$", script, re.MULTILINE)
        assert match
        wanted = named(project["dependencies"]) | named([f"fltea[{','.join(match[1].split())}]"])
        lacking = wanted - set(hashes(level))
        assert not lacking, f"tools/hashes/{level}.txt lacks {lacking}: `make hashes`"
    assert set(hashes("run")) <= set(hashes("dev"))


def test_set_up_asks_for_hashes_and_nothing_else() -> None:
    for file in ("tools/setup.sh", "tools/deploy/service.sh"):
        script = (ROOT / file).read_text("utf-8")
        assert script.count("--require-hashes") + script.count('"${checked[@]}"') >= 2
        assert "--no-deps --no-build-isolation" in script
        assert "constraints.txt" not in script


def test_what_is_given_to_others_is_made_of_files_with_hashes() -> None:
    """Each `pip install` in tools/dist uses only packages from the lists with hashes. The lists include all
    dependencies.
    """
    scripts = {file.name: file.read_text("utf-8") for file in (ROOT / "tools/dist").glob("*.sh")}
    installs = [line for text in scripts.values() for line in re.findall(r"pip install.*", text)]
    assert len(installs) == 2
    assert all("--no-deps --require-hashes" in line for line in installs)
    asked = [
        (which, name, names.split("|"))
        for text in scripts.values()
        for which, name, names in re.findall(r"^[^#\n]*\b(entries\w*) (\w+) '?([\w|-]+)'?", text, re.M)
    ]
    assert len(asked) == 4
    assert all(set(names) <= set(hashes(list_)) for _, list_, names in asked)
    needed = {name for which, list_, names in asked if (which, list_) == ("entries", "dev") for name in names}
    assert closure("pytest", "hypothesis", "pytest-timeout") == needed
    assert closure("fltea[outputs]") - {"fltea"} <= set(hashes("run")) - {"unicorn"}


def closure(*names: str) -> set[str]:
    """Return the names of these packages and of all their dependencies that are installed on this machine."""
    found: set[str] = set()
    waiting = [Requirement(name) for name in names]
    while waiting:
        one = waiting.pop()
        found.add(plain(one.name))
        for text in metadata.requires(one.name) or ():
            need = Requirement(text)
            if any(need.marker is None or need.marker.evaluate({"extra": x}) for x in one.extras or {""}):
                waiting.append(need)
    return found


def test_a_file_that_was_changed_is_refused(tmp_path: Path) -> None:
    wheel = tmp_path / "other-1.0-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.writestr("other.py", "print('mine')")
    (tmp_path / "list.txt").write_text(f"other==1.0 --hash=sha256:{'0' * 64}\n")
    command = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--require-hashes",
        "--no-deps",
        "--no-index",
        "--dry-run",
    ]
    done = subprocess.run(
        [*command, "--find-links", tmp_path, "-r", tmp_path / "list.txt"], capture_output=True, text=True
    )
    assert done.returncode == 1
    assert "HASH" in done.stderr.upper()
