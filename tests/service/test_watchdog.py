"""A walk that hangs is not called alive, and a second signal does not hold up the end."""

import math
import signal
from types import SimpleNamespace

from fltea.service import daemon
from fltea.service.daemon import STUCK_S, StopOnSignal, _Run


def test_the_watchdog_is_fed_only_while_every_walk_moves(monkeypatch) -> None:
    now_s = [1000.0]
    monkeypatch.setattr(daemon.time, "monotonic", lambda: now_s[0])
    stop = StopOnSignal()
    left, right = (SimpleNamespace(moved_s=now_s[0]) for _ in range(2))
    run = _Run([], stop)
    run._walks = [left, right]  # type: ignore[list-item]
    fed: list[float] = []
    monkeypatch.setattr(run._manager, "alive", lambda: fed.append(now_s[0]))

    class Once:
        """An event to wait for that comes after one look."""

        def __init__(self) -> None:
            self.set = False

        def is_set(self) -> bool:
            return self.set

        def wait(self, timeout_s: float) -> None:
            self.set = True

    run._wait(Once())  # type: ignore[arg-type]
    assert fed == [1000.0]
    now_s[0] += STUCK_S + 1
    left.moved_s = now_s[0]
    run._wait(Once())  # type: ignore[arg-type]
    assert fed == [1000.0]
    right.moved_s = math.inf  # its source has ended
    run._wait(Once())  # type: ignore[arg-type]
    assert fed == [1000.0, now_s[0]]


def test_a_second_signal_in_the_midst_of_the_first_does_not_hang(monkeypatch) -> None:
    """`Event.set` holds a lock that its own thread cannot take again."""
    with StopOnSignal() as stop:
        stop.armed = True
        calls, was = [], stop.asked.set

        def interrupted() -> None:
            calls.append(1)
            assert len(calls) == 1, "set again, within itself"
            signal.raise_signal(signal.SIGTERM)
            was()

        monkeypatch.setattr(stop.asked, "set", interrupted)
        signal.raise_signal(signal.SIGTERM)
        assert stop.asked.is_set()
