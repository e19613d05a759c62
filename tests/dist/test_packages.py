"""Tests of what `make dist` builds, as far as that can be tested in seconds.

The source distribution has all that the wheel needs, and versions agree.
"""

import json
import re
import subprocess
import sys
import tarfile
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import fltea
import pytest

from tests.rig.host_support import ROOT
from tests.rig.toolchain import needed as installed
from tools.dist.deb_copyright import main as copyright_of
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
    """Return the files of the package, the sources of the native module, the headers they include, and the
    licence."""
    package = [
        path
        for path in (ROOT / "host/fltea").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    ]
    native = [path for path in (ROOT / "host/native").iterdir() if path.is_file()]
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
        "host/fltea/records/version.py": fltea.__version__,
        "firmware/core/library.properties": found(r"^version=(.*)$", "firmware/core/library.properties"),
        "firmware/core/build_id.h": found(r'kVersion\[\] = "(.*)"', "firmware/core/build_id.h"),
        "firmware/due/image/fltea_due.json": found(r'"version": "(.*)"', "firmware/due/image/fltea_due.json"),
    }
    assert set(versions.values()) == {PROJECT["version"]}, versions


def test_every_version_has_its_part_of_the_changelog() -> None:
    headings = re.findall(r"^## \[(.*?)\]", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert PROJECT["version"] in headings or headings[:1] == ["Unreleased"]


def test_scripts_are_clean_bash() -> None:
    scripts = sorted((ROOT / "tools").rglob("*.sh"))
    command = [installed("shellcheck"), "-x", *scripts]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
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


def control() -> dict[str, str]:
    """Return the fields of the binary package in debian/control, each as one line."""
    text = (DIST / "debian/control").read_text("utf-8")
    fields = re.findall(r"^([A-Z][\w-]*): (.*(?:\n .*)*)", text.split("\n\n")[1], re.MULTILINE)
    return {name: re.sub(r"\n ", " ", value) for name, value in fields}


def test_debian_package_asks_for_what_its_wheel_is_made_for() -> None:
    fields = control()
    assert fields["Package"] == "fltea"
    assert fields["Architecture"].split() == ["amd64", "arm64"]
    depends = {part.strip() for part in fields["Depends"].split(",")}
    common = (DIST / "common.sh").read_text("utf-8")
    # The wheel itself works with Python's stable ABI, so one wheel serves all versions. The libraries that
    # the Debian package has next to it are for one version, the system's own Python.
    assert re.search(r"^abi=cp311-abi3$", common, re.MULTILINE)
    assert tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["scikit-build"]["wheel"] == {
        "packages": ["host/fltea"],
        "py-api": "cp311",
    }
    assert {"python3 (>= @PYTHON@)", "python3 (<< @NEXT@)"} <= depends
    maps = re.findall(r"^declare -A (python|suite)_of=\((.*)\)$", common, re.MULTILINE)
    names = [set(re.findall(r"\[(.*?)\]=", text)) for _, text in maps]
    systems = re.search(r"^systems=\((.*)\)$", common, re.MULTILINE)
    assert systems
    assert names == [set(systems[1].split())] * 2
    glibc = re.search(r"^glibc=(\d)_(\d+)$", common, re.MULTILINE)
    assert glibc
    assert f"libc6 (>= {glibc[1]}.{glibc[2]})" in depends


def test_files_that_are_packed_exist() -> None:
    script = (DIST / "deb.sh").read_text("utf-8")
    named = set(re.findall(r"\$here/(tools/[\w./-]+)", script))
    assert len(named) >= 7
    assert [name for name in sorted(named) if not (ROOT / name).is_file()] == []
    # deb.sh changes some lines of the systemd unit, so these lines must be there.
    unit = (ROOT / "tools/deploy/fltea.service").read_text("utf-8")
    assert all(
        f"\n{line}" in unit
        for line in ("ExecStart=/opt/fltea/bin/fltea ", "RestartSteps=", "RestartMaxDelaySec=")
    )


def test_container_takes_the_package_that_is_built() -> None:
    text = (ROOT / "tools/deploy/Containerfile").read_text("utf-8")
    pattern = re.search(r"^COPY (\S+) ", text, re.MULTILINE)
    common = (DIST / "common.sh").read_text("utf-8")
    code = f'cd "{ROOT}"; {common}\nbasename "$(deb_of deb13 amd64)"'
    built = subprocess.run(
        ["bash", "-c", code], check=True, capture_output=True, text=True, timeout=30
    ).stdout
    assert pattern
    assert fnmatch(built.strip(), pattern[1])
    assert "USER fltea\n" in text
    command = json.loads(re.findall(r"^CMD (.*)$", text, re.MULTILINE)[0])
    unit = (ROOT / "tools/deploy/fltea.service").read_text("utf-8")
    assert f"fltea {' '.join(command)}\n" in unit


def test_every_override_says_why() -> None:
    """A comment precedes each group of lintian's overrides."""
    lines = (DIST / "debian/lintian-overrides").read_text("utf-8").splitlines()
    assert lines[0].startswith("# ")
    assert all(line.startswith(("# ", "fltea: ")) for line in lines)


def test_copyright_names_the_licence_of_every_library(tmp_path: Path) -> None:
    for name, extra in (
        ("one", "License-Expression: MIT"),
        ("two", "Classifier: License :: OSI Approved :: BSD License"),
    ):
        info = tmp_path / f"{name}-1.0.dist-info"
        (info / "licenses").mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.4\nName: {name}\nVersion: 1.0\n{extra}\n")
        (info / "licenses" / "LICENSE").write_text("All of it.\n")
        (info / "RECORD").write_text(f"{info.name}/licenses/LICENSE,,\n{info.name}/METADATA,,\n")
    text = copyright_of(ROOT / "LICENSE", tmp_path, "/usr/lib/fltea")
    assert "Permission is hereby granted" in text
    assert "one 1.0: MIT" in text
    assert "two 1.0: BSD License" in text
    assert "/usr/lib/fltea/one-1.0.dist-info/licenses/LICENSE" in text
    (tmp_path / "two-1.0.dist-info/METADATA").write_text("Metadata-Version: 2.4\nName: two\nVersion: 1.0\n")
    with pytest.raises(SystemExit, match="two does not say its licence"):
        copyright_of(ROOT / "LICENSE", tmp_path, "/usr/lib/fltea")
