"""What set-up installs is what is pinned, every file by its hash (tools/hashes.sh)."""

import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from host_support import ROOT

PINNED = re.compile(r"^([A-Za-z0-9][\w.-]*)==(\S+)", re.MULTILINE)
LISTS = ("build", "run", "dev", "audit")


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
    assert len(entries) == len(hashes(name)) > 5
    for entry in entries:
        assert PINNED.match(entry), entry
        assert re.search(r"^    --hash=sha256:[0-9a-f]{64}( \\)?$", entry, re.MULTILINE), entry


@pytest.mark.parametrize("name", ["build", "run", "dev"])
def test_the_versions_are_those_of_the_constraints(name: str) -> None:
    found = hashes(name)
    assert found == {package: CONSTRAINTS.get(package) for package in found}


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
        assert wanted <= set(hashes(level))
    assert set(hashes("run")) <= set(hashes("dev"))


def test_set_up_asks_for_hashes_and_nothing_else() -> None:
    for file in ("tools/setup.sh", "tools/deploy/service.sh"):
        script = (ROOT / file).read_text("utf-8")
        assert script.count("--require-hashes") + script.count('"${checked[@]}"') >= 2
        assert "--no-deps --no-build-isolation" in script
        assert "constraints.txt" not in script


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
