"""A walk that hangs is not called alive."""

from fltea import daemon
from fltea.config import load_config
from fltea.daemon import STUCK_S, StopOnSignal, _Run


def test_the_watchdog_is_fed_only_while_every_walk_moves(monkeypatch) -> None:
    now_s = [1000.0]
    monkeypatch.setattr(daemon.time, "monotonic", lambda: now_s[0])
    stop = StopOnSignal()
    run = _Run([load_config(None, {"name": name}) for name in ("left", "right")], stop)
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
    run._moved_s["left"] = now_s[0]
    run._wait(Once())  # type: ignore[arg-type]
    assert fed == [1000.0]
    run._moved_s["right"] = now_s[0]
    run._wait(Once())  # type: ignore[arg-type]
    assert fed == [1000.0, now_s[0]]
