"""What the tests of sources share."""

import time

import pytest


@pytest.fixture
def now_ns(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The time of all clocks, in one place; sleeping moves it on."""
    now_ns = [0]
    monkeypatch.setattr(time, "clock_gettime_ns", lambda clock: now_ns[0])
    monkeypatch.setattr(time, "time_ns", lambda: now_ns[0] + 10**18)
    monkeypatch.setattr(time, "sleep", lambda s: now_ns.__setitem__(0, now_ns[0] + round(s * 1e9)))
    return now_ns
