"""Test that a test run refuses a native module that was built from other sources."""

import re
import runpy
import shutil
import sys
from pathlib import Path

import pytest
from fltea import _native

ROOT = Path(__file__).parents[2]
HASH = runpy.run_path(str(ROOT / "host/native/source_hash.py"))
SOURCES = HASH["sources"]()
INCLUDE = re.compile(r'^#include "(.*)"', re.M)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """Return a folder with copies of the native module's sources."""
    for path in SOURCES:
        place = tmp_path / path.relative_to(ROOT)
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, place)
    return tmp_path


def test_a_changed_byte_a_new_name_and_a_lost_file_change_it(copy: Path) -> None:
    path = copy / "firmware/core/engine/pack.hpp"
    seen = [HASH["source_hash"](), HASH["source_hash"](copy)]
    assert seen[0] == seen[1] == _native.SOURCE_HASH
    path.write_bytes(path.read_bytes()[:-1] + b" ")
    seen.append(HASH["source_hash"](copy))
    path.rename(path.with_name("packed.hpp"))
    seen.append(HASH["source_hash"](copy))
    path.with_name("packed.hpp").unlink()
    seen.append(HASH["source_hash"](copy))
    assert len(set(seen)) == 4


def test_what_says_the_same_is_not_written_again(copy: Path) -> None:
    out = copy / "source_hash.cpp"
    HASH["write"](out, copy)
    assert f'"{_native.SOURCE_HASH}"' in out.read_text()
    before = out.stat().st_ino, out.stat().st_mtime_ns
    HASH["write"](out, copy)
    assert (out.stat().st_ino, out.stat().st_mtime_ns) == before
    (copy / "host/native/engine.cpp").write_text("\n")
    HASH["write"](out, copy)
    assert _native.SOURCE_HASH not in out.read_text()


def test_all_that_is_included_counts() -> None:
    names = {path.name for path in SOURCES}
    for path in SOURCES:
        assert {Path(one).name for one in INCLUDE.findall(path.read_text())} <= names, path


def test_make_builds_anew_after_a_change_of_any() -> None:
    line = re.search(r"^NATIVE := (.*\\\n)*.*", (ROOT / "Makefile").read_text(), re.M)
    assert line is not None
    words = re.sub(
        r"\$\(addprefix (\S+?),(.*?)\)", lambda m: " ".join(m[1] + n for n in m[2].split()), line[0]
    )
    named = {path for word in re.findall(r"[\w/.*]+", words) for path in ROOT.glob(word.lstrip("/") or "-")}
    assert {*SOURCES, ROOT / "host/native/source_hash.py"} <= named


def test_a_module_of_other_sources_is_refused(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    # tests/conftest.py is loaded by its path, because several folders have a module named conftest
    conftest = request.config.pluginmanager.get_plugin(str(ROOT / "tests/conftest.py"))
    assert conftest is not None
    conftest.pytest_configure()
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    monkeypatch.delenv("FLTEA_STALE_NATIVE", raising=False)
    (tmp_path / ".dev").touch()
    for other in ("0" * 64, None):
        if other is None:
            monkeypatch.delattr(_native, "SOURCE_HASH")
        else:
            monkeypatch.setattr(_native, "SOURCE_HASH", other)
        with pytest.raises(pytest.UsageError, match="built from other sources: run `make setup`"):
            conftest.pytest_configure()
    assert not (tmp_path / ".dev").exists()
    monkeypatch.setenv("FLTEA_STALE_NATIVE", "1")
    conftest.pytest_configure()
