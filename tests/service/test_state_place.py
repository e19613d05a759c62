"""Tests of files of snapshots that are links, or that cannot be written."""

from pathlib import Path

import pytest
from fltea.records.errors import UsageError
from fltea.service.state import StateFile
from fltea.settings.outputs import StateConfig


@pytest.mark.parametrize("target", ["real", "none"])
def test_a_link_is_refused_and_left_alone(target: str, tmp_path: Path) -> None:
    real, link = tmp_path / "real", tmp_path / "link"
    real.touch()
    link.symlink_to(tmp_path / target)
    with pytest.raises(UsageError, match=f"--state {link}: is a link, and has to be a file"):
        StateFile(StateConfig(file=str(link)), lambda kind, text: None)
    assert link.is_symlink()
