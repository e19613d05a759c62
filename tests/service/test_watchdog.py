"""Tests that the reports to systemd stop when a device stream hangs, and that a signal ends the program's
waiting.
"""

import math
import signal
from collections.abc import Callable
from types import SimpleNamespace

from fltea.process.stop_on_signal import StopOnSignal
from fltea.service import daemon
from fltea.service.daemon import STUCK_S, _Run


def test_the_watchdog_is_fed_only_while_every_walk_moves(monkeypatch) -> None:
    now_s = [1000.0]
    monkeypatch.setattr(daemon.time, "monotonic", lambda: now_s[0])
    stop = StopOnSignal()
    left, right = (SimpleNamespace(moved_s=now_s[0]) for _ in range(2))
    run = _Run([], stop)
    run._streams = [left, right]  # type: ignore[list-item]
    fed: list[float] = []
    monkeypatch.setattr(run._manager, "alive", lambda: fed.append(now_s[0]))

    def once() -> Callable[[], bool]:
        """Return a function that lets the waiting loop check the device streams once and then ends it."""
        stop.wake_up.ring()
        return iter((False, True)).__next__

    run._wait(once())
    assert fed == [1000.0]
    now_s[0] += STUCK_S + 1
    left.moved_s = now_s[0]
    run._wait(once())
    assert fed == [1000.0]
    right.moved_s = math.inf  # this device stream has ended, so it no longer counts as hanging
    run._wait(once())
    assert fed == [1000.0, now_s[0]]


def test_a_signal_ends_the_waiting() -> None:
    with StopOnSignal() as stop:
        stop.armed = True
        run = _Run([], stop)
        run._streams = [SimpleNamespace(moved_s=math.inf)]  # type: ignore[list-item]
        looks: list[int] = []

        def done() -> bool:
            looks.append(1)
            if len(looks) == 2:
                signal.raise_signal(signal.SIGTERM)
                signal.raise_signal(signal.SIGINT)
                assert stop.wake_up.wait(0), "or it would be seen only at the next look"
            return False

        run._wait(done)
        assert stop.asked
        assert stop.count == 2
