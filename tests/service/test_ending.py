"""Tests of how the program waits at its end for tasks, such as its outputs.

The waiting has no time limit until somebody asks for the end. After that it has a limit, and a further signal
ends the waiting.
"""

import threading
from collections.abc import Callable
from typing import Any

import pytest
from fltea.process.stop_on_signal import StopOnSignal
from fltea.service import daemon, ending
from fltea.service.daemon import _Run
from fltea.service.ending import KEEP_S, OTHER_S, SAY_S, Awaited, Ending
from fltea.service.state import StateFile
from fltea.settings.config import load_configs

from tests.rig.host_support import PATIENCE_S


class Scene:
    """An `Ending` with a clock that advances only while the `Ending` waits."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s, self.asked, self.signals = 0.0, True, 1
        monkeypatch.setattr(ending.time, "monotonic", lambda: self.now_s)
        self.said: list[str] = []
        self.ending = Ending(lambda: self.asked, lambda: self.signals, self.said.append)

    def wait(self, *awaited: Awaited) -> float:
        """Wait for these tasks, and return how long that took [s]."""
        began_s = self.now_s
        self.ending.wait(awaited)
        return self.now_s - began_s

    def after(self, end_s: float, then: Callable[[], None] = lambda: None) -> Callable[[float], bool]:
        """Return a function that waits for a task until it ends at `end_s`, for at most the time that is
        passed to it, and tells whether the task has ended. Each time, it calls `then` first.
        """

        def done(timeout_s: float) -> bool:
            then()
            self.now_s = min(self.now_s + timeout_s, max(self.now_s, end_s))
            return self.now_s >= end_s

        return done


@pytest.fixture
def scene(monkeypatch: pytest.MonkeyPatch) -> Scene:
    return Scene(monkeypatch)


def test_what_hangs_gets_no_more_time_together_than_one_alone(scene: Scene) -> None:
    hanging = [Awaited(name, scene.after(1e9)) for name in "abc"]
    assert OTHER_S <= scene.wait(*hanging) < OTHER_S + 1
    assert scene.ending.left == ["a", "b", "c"]
    assert scene.ending.lost == []
    assert scene.said[0] == "waits for a, up to 10 s; another signal ends the waiting at once."
    assert scene.said[1:] == [f"{name} did not end in time; its last data are lost." for name in "abc"]


def test_what_nothing_else_has_is_written_however_slow_the_disk(scene: Scene) -> None:
    slow = Awaited("state", scene.after(KEEP_S - 1), kept=True)
    scene.wait(Awaited("stdout", scene.after(1e9)), slow)
    assert scene.ending.left == ["stdout"]
    scene.wait(Awaited("record", scene.after(1e9), kept=True))
    assert scene.ending.lost == ["record"]


def test_until_the_end_is_asked_for_there_is_no_limit(scene: Scene) -> None:
    scene.asked = False

    def ask() -> None:
        scene.asked = scene.now_s >= 3600

    took_s = scene.wait(Awaited("stdout", scene.after(1e9, ask)))
    assert 3600 + OTHER_S <= took_s < 3601 + OTHER_S


def test_another_signal_counts_once_it_was_said_what_is_waited_for(scene: Scene) -> None:
    """A terminal that is closed may send two signals at once, which must count as one request for the end. A
    further signal counts once the user was told what the program waits for.
    """
    scene.signals = 2

    def signal_again() -> None:
        scene.signals = 2 + bool(scene.said)

    assert SAY_S <= scene.wait(Awaited("state", scene.after(1e9, signal_again), kept=True)) < SAY_S + 1
    assert scene.ending.lost == ["state"]
    assert scene.wait(Awaited("stdout", scene.after(1e9))) < 1


class Held:
    """A function that a thread calls and cannot leave until the test permits it."""

    def __init__(self) -> None:
        self.entered, self.go = threading.Event(), threading.Event()

    def __call__(self, *_: object) -> None:
        self.entered.set()
        assert self.go.wait(PATIENCE_S)


def run_to_its_end(*urls: str, **settings: Any) -> tuple[Exception | None, bool]:
    """Run the program to its end; a signal has asked for the end before the start."""
    stop = StopOnSignal()
    stop.ask()
    return _Run(load_configs(None, {"format": "none", **settings}, list(urls)), stop).run()


def test_a_state_is_there_although_it_took_longer_than_a_busy_machine_lets_wait(
    monkeypatch: pytest.MonkeyPatch, tmp_path
) -> None:
    write, held = StateFile._write, Held()

    def slow(file: StateFile) -> None:
        threading.Timer(1.0, held.go.set).start()
        held()
        write(file)

    monkeypatch.setattr(StateFile, "_write", slow)
    assert run_to_its_end("synthetic:", **{"state.file": str(tmp_path / "state")}) == (None, True)


def test_walks_that_hang_are_given_up(monkeypatch: pytest.MonkeyPatch, capfd) -> None:
    monkeypatch.setattr(ending, "OTHER_S", 0.1)
    held = Held()
    monkeypatch.setattr(daemon._Run, "_pump", lambda run, walk: held())
    assert run_to_its_end("synthetic:?seed=1", "synthetic:?seed=2") == (None, False)
    held.go.set()
    assert capfd.readouterr().err.count("did not end") == 2


def test_a_state_that_cannot_be_written_in_time_is_a_failure(
    monkeypatch: pytest.MonkeyPatch, tmp_path
) -> None:
    monkeypatch.setattr(ending, "KEEP_S", 0.1)
    held = Held()
    monkeypatch.setattr(StateFile, "_write", lambda file: held())
    failure, done = run_to_its_end("synthetic:", **{"state.file": str(tmp_path / "state")})
    held.go.set()
    assert str(failure) == "not all data were written, since these did not end within the time limit: state."
    assert not done
