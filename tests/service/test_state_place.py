"""Tests of files of snapshots that are links, or that cannot be written."""

from pathlib import Path

import pytest
from fltea.records.errors import FlteaError, UsageError
from fltea.records.whole_file import whole_file
from fltea.service import state as state_module
from fltea.service.state import DeviceState, StateFile
from fltea.settings.outputs import StateConfig

from tests.rig.host_support import fltea_here, wait_until


@pytest.mark.parametrize("target", ["real", "none"])
def test_a_link_is_refused_and_left_alone(target: str, tmp_path: Path) -> None:
    real, link = tmp_path / "real", tmp_path / "link"
    real.touch()
    link.symlink_to(tmp_path / target)
    with pytest.raises(UsageError, match=f"--state {link}: is a link, and has to be a file"):
        StateFile(StateConfig(file=str(link)), lambda kind, text: None)
    assert link.is_symlink()


def test_a_snapshot_that_cannot_be_written_at_the_end_fails_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path) -> None:
        raise FlteaError(f"{path}: no space left.")

    monkeypatch.setattr(state_module, "whole_file", refuse)
    done = fltea_here(
        "run", "-s", "synthetic:?n=900", "--once", "--pace", "fast", "--state", str(tmp_path / "state")
    )
    assert "state_failed: " in done.stderr
    assert done.returncode == 1
    assert "the newest snapshots could not be written" in done.stderr


def test_a_snapshot_that_failed_once_is_tried_again_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failures = [FlteaError("no space left.")]

    def may_refuse(path: Path) -> object:
        if failures:
            raise failures.pop()
        return whole_file(path)

    monkeypatch.setattr(state_module, "whole_file", may_refuse)
    said: list[str] = []
    path = tmp_path / "state"
    config = StateConfig(file=str(path), period_s=0.01)
    file = StateFile(config, lambda kind, text: said.append(kind))
    file.put("left", DeviceState(sensor={}, unix_ns=0))
    wait_until(lambda: bool(said), "the failure")
    file.close()
    assert not file.has_failed
    assert "left" in path.read_text()
