"""Fixtures that the tests of sources share."""

import contextlib
import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture
def now_ns(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Replace all clocks by one simulated time, which advances when the program sleeps."""
    now_ns = [0]
    monkeypatch.setattr(time, "clock_gettime_ns", lambda clock: now_ns[0])
    monkeypatch.setattr(time, "time_ns", lambda: now_ns[0] + 10**18)
    monkeypatch.setattr(time, "sleep", lambda s: now_ns.__setitem__(0, now_ns[0] + round(s * 1e9)))
    return now_ns


@pytest.fixture
def fifo(tmp_path: Path) -> Iterator[Path]:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    yield path
    # opening both ends of the FIFO releases threads that still wait for somebody to open the other end
    for flags in (os.O_RDONLY, os.O_WRONLY):
        with contextlib.suppress(OSError):
            os.close(os.open(path, flags | os.O_NONBLOCK))
