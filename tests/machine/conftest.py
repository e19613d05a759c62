"""The simulated machine for the tests of this folder."""

from pathlib import Path

import pytest
from fltea.diagnostics import host_system

from tests.rig.fake_system import FakeSystem


@pytest.fixture
def system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakeSystem:
    """Make commands use a simulated machine in place of this one."""
    system = FakeSystem(tmp_path)
    monkeypatch.setattr(host_system, "System", lambda: system)
    return system
