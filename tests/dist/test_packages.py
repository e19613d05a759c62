"""What `make dist` builds from, as far as seconds allow: the sdist has all of the wheel; versions agree."""

import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path

import fltea
import pytest
from host_support import ROOT
from toolchain import missing

from tools.dist.same_figures import differences

DIST = ROOT / "tools/dist"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> tarfile.TarFile:
    pytest.importorskip("scikit_build_core")
    folder = tmp_path_factory.mktemp("sdist")
    code = "import sys, scikit_build_core.build as backend; print(backend.build_sdist(sys.argv[1]))"
    subprocess.run(
        [sys.executable, "-c", code, str(folder)], cwd=ROOT, check=True, capture_output=True, timeout=60
    )
    (path,) = folder.glob("fltea-*.tar.gz")
    return tarfile.open(path)


def needed() -> list[Path]:
    """The package, the sources of the native module, the headers that those include, the licence."""
    package = [
        path
        for path in (ROOT / "host/fltea").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    ]
    native = [*(ROOT / "host/native").glob("*.?pp"), ROOT / "host/native/CMakeLists.txt"]
    core = [*(ROOT / "firmware/core").glob("*.h"), *(ROOT / "firmware/core/engine").glob("*.hpp")]
    return [*package, *native, *core, *(ROOT / name for name in ("pyproject.toml", "README.md", "LICENSE"))]


def test_sdist_holds_what_the_wheel_needs(sdist: tarfile.TarFile) -> None:
    held = {name.partition("/")[2] for name in sdist.getnames()}
    lost = sorted(str(path.relative_to(ROOT)) for path in needed() if path.suffix != ".so")
    lost = [name for name in lost if name not in held]
    assert lost == []


def test_sdist_holds_neither_tests_nor_what_was_built(sdist: tarfile.TarFile) -> None:
    parts = {part for name in sdist.getnames() for part in name.split("/")[1:]}
    assert not parts & {"tests", ".ci", ".venv", "build", "__pycache__", ".git"}


def test_sdist_builds_packages(sdist: tarfile.TarFile) -> None:
    held = {name.partition("/")[2] for name in sdist.getnames()}
    assert {"constraints.txt", "Makefile", "tools/deploy/service.sh", "tools/dist/wheels.sh"} <= held


def test_version_is_the_same_everywhere() -> None:
    def found(pattern: str, file: str) -> str:
        match = re.search(pattern, (ROOT / file).read_text("utf-8"), re.MULTILINE)
        assert match, file
        return match[1]

    versions = {
        "pyproject.toml": PROJECT["version"],
        "host/fltea/__init__.py": fltea.__version__,
        "firmware/core/library.properties": found(r"^version=(.*)$", "firmware/core/library.properties"),
        "firmware/core/build_id.h": found(r'kVersion\[\] = "(.*)"', "firmware/core/build_id.h"),
        "firmware/due/image/fltea_due.json": found(r'"version": "(.*)"', "firmware/due/image/fltea_due.json"),
    }
    assert set(versions.values()) == {PROJECT["version"]}, versions


def test_every_version_has_its_part_of_the_changelog() -> None:
    headings = re.findall(r"^## \[(.*?)\]", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert PROJECT["version"] in headings or headings[:1] == ["Unreleased"]


def test_scripts_are_clean_bash() -> None:
    shellcheck = shutil.which("shellcheck") or missing("shellcheck is not installed")
    scripts = sorted(str(path.relative_to(ROOT)) for path in DIST.rglob("*.sh"))
    done = subprocess.run([shellcheck, "-x", *scripts], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, "")


def test_figures_of_two_machines_are_compared() -> None:
    def count(verdict: str, alpha: float, n: int, exactly: bool = False) -> int:
        ours, theirs = (
            [{"verdict": v, "axes": [{"alpha": a, "n": m}]}]
            for v, a, m in (("white", 0.5, 3), (verdict, alpha, n))
        )
        return len(list(differences(ours, theirs, exactly)))

    assert count("white", 0.5000001, 3) == 0
    assert count("white", 0.5000001, 3, exactly=True) == 1
    assert count("white", 0.501, 3) == 1
    assert count("drift", 0.501, 4) == 3
    assert len(list(differences([{"axes": []}], [{"axes": [0.5]}], False))) == 1
