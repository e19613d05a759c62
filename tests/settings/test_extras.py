"""The message about a missing library gives a command that works, although fltea is on no package index."""

import sys
from pathlib import Path

import pytest
from fltea.records.errors import UsageError
from fltea.settings import extras
from fltea.settings.extras import how_to_install, load, need_matplotlib

from tests.rig.host_support import ROOT


def test_a_command_for_the_clone_that_the_program_runs_from() -> None:
    command = f"cd {ROOT} && {sys.executable} -m pip install -e '.[mqtt,record]'"
    assert how_to_install("mqtt", "record") == command


def test_a_command_for_a_clone_where_the_program_is_installed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(extras, "_ROOT", tmp_path)
    assert how_to_install("plot") == f"{sys.executable} -m pip install '.[plot]', in a clone of fltea"


def test_what_is_missing_is_named_with_the_command_and_the_way_without(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(UsageError) as found:
        need_matplotlib("heat maps need", "; without it, ask for numbers alone: --no-figures")
    assert str(found.value) == (
        "heat maps need the package matplotlib, which is not installed: "
        f"{how_to_install('plot')}; without it, ask for numbers alone: --no-figures."
    )


def test_a_fault_of_ours_is_not_taken_for_a_missing_library() -> None:
    with pytest.raises(ModuleNotFoundError):
        load("fltea.no_such_module", "mcap", "record", "MCAP files need")


@pytest.mark.parametrize("file", ["README.md", "host", "firmware/README.md", "tests/README.md", "tools"])
def test_no_document_offers_what_nobody_has_published(file: str) -> None:
    place = ROOT / file
    for page in place.rglob("*.md") if place.is_dir() else [place]:
        assert "pip install 'fltea" not in page.read_text(encoding="utf-8"), page
        assert "pip install fltea" not in page.read_text(encoding="utf-8"), page
