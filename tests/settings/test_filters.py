"""The filters' numbers have one home, filters.toml, from which every default comes: host, device and docs."""

import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fltea.estimator.engine_settings import EngineSettings
from fltea.settings.config import Config
from support import ROOT

FILES = ("host/fltea/settings/filters.toml", "host/docs/reference/settings.md")
WRITTEN = (
    "host/fltea/settings/filters.py",
    "firmware/core/filter_settings.h",
    "host/docs/reference/settings.md",
)


def entries(table: dict[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    for key, value in table.items():
        if "value" in value:
            yield (*path, key), value
        else:
            yield from entries(value, (*path, key))


ENTRIES = list(entries(tomllib.loads((ROOT / FILES[0]).read_text(encoding="utf-8"))))


def generate(root: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(ROOT / "tools/gen_filter_settings.py"), "--root", str(root), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_the_generated_files_are_up_to_date() -> None:
    assert generate(ROOT, "--check").returncode == 0


@pytest.mark.parametrize(
    ("path", "entry"), ENTRIES, ids=lambda x: ".".join(x) if isinstance(x, tuple) else ""
)
def test_every_number_is_a_default_of_the_program(path: tuple[str, ...], entry: dict[str, Any]) -> None:
    if path != ("estimator", "state", "R"):  # R belongs to the data
        found: Any = Config()
        for name in path:
            found = getattr(found, name)
        assert found == entry["value"]
    of_engine: Any = EngineSettings()
    if path[0] != "estimator" or path[1] in (
        "variant",
        "guard",
        "startup",
    ):  # the engine's own are the paper's
        return
    for name in path[1:]:
        of_engine = getattr(of_engine, name)
    assert of_engine == entry["value"]


def test_a_change_reaches_every_file_and_nothing_else(tmp_path: Path) -> None:
    for name in FILES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text((ROOT / name).read_text(encoding="utf-8"), encoding="utf-8")
    toml = tmp_path / FILES[0]
    text = toml.read_text(encoding="utf-8")
    for old, new in (("value = 0.15,", "value = 12.25,"), ("value = 3000,", "value = 123456789,")):
        assert text.count(old) == 1
        text = text.replace(old, new)
    toml.write_text(text, encoding="utf-8")
    assert generate(tmp_path, "--check").returncode == 1
    assert generate(tmp_path).returncode == 0
    python, cpp, page = ((tmp_path / name).read_text(encoding="utf-8") for name in WRITTEN)
    assert "\nSTATE_Q: Final = 12.25\n" in python
    assert "\nWINDOW: Final = 123456789\n" in python
    assert "\nconstexpr float kStateQ = 12.25f;\n" in cpp
    assert "window" not in cpp.lower().replace("start-up window", "")
    before = (ROOT / "host/docs/reference/settings.md").read_text(encoding="utf-8").split("\n")
    changed = [(a, b) for a, b in zip(before, page.split("\n"), strict=True) if a != b]
    assert [re.split(r"\s*#", b)[0] for _, b in changed] == ["window = 123456789", "Q = 12.25"]
    assert all(a.index("#") == b.index("#") for a, b in changed)
    assert generate(tmp_path, "--check").returncode == 0


@pytest.mark.parametrize(
    "entry", ["x = 3", "x = { value = 3 }", 'x = { value = 3, meaning = "m", units = "s" }']
)
def test_an_entry_that_is_none_is_refused(entry: str, tmp_path: Path) -> None:
    for name in FILES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(f"[estimator]\n{entry}\n", encoding="utf-8")
    assert "estimator.x" in generate(tmp_path).stderr
