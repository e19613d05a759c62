"""The machine that the tests of this folder look at."""

from pathlib import Path

import pytest
from fake_system import FakeSystem
from fltea.machine import host_system


@pytest.fixture
def system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakeSystem:
    """One of our own making, which commands take for this machine, too."""
    system = FakeSystem(tmp_path)
    monkeypatch.setattr(host_system, "System", lambda: system)
    return system
