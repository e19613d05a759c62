"""Tests of files of snapshots that a power cut or a full disk has left empty, cut off or full of zeros."""

from pathlib import Path

import pytest
from fltea.service.state import StateFile
from fltea.settings.outputs import StateConfig

from tests.rig.host_support import QUICK, fltea_here


def run(path: Path) -> str:
    """Run the program with this file of snapshots, and return what it says."""
    done = fltea_here(
        "run", "-s", "synthetic:?n=300", "--once", "--format", "none", "--state", str(path), *QUICK
    )
    assert done.returncode == 0, done.stderr
    return done.stderr


@pytest.mark.parametrize("zeros", [0, pytest.param(100, marks=pytest.mark.slow)])
def test_a_snapshot_that_was_cut_is_set_aside(zeros: int, tmp_path: Path) -> None:
    path, refused = tmp_path / "state", tmp_path / "state.refused"
    run(path)
    whole = path.read_bytes()
    for kept in (0, 1, 11, 12, 30, 400, len(whole) - 1):
        cut = whole[:kept] + bytes(zeros)
        path.write_bytes(cut)
        said: list[str] = []
        file = StateFile(StateConfig(str(path)), lambda kind, text: said.append(kind))  # noqa: B023
        file.close()
        assert (file.found, said) == ({}, ["state_refused"])
        assert refused.read_bytes() == cut


def test_an_empty_snapshot_does_not_end_the_program(tmp_path: Path) -> None:
    path = tmp_path / "state"
    path.touch()
    assert "state.refused" in run(path)
    assert b"devices" in path.read_bytes()
