"""A signal such as SIGTERM asks the program for an orderly end. Before the program is ready to end in order,
the signal stops it at once.
"""

import signal

import pytest
from fltea.process.interrupted import Interrupted
from fltea.process.stop_on_signal import StopOnSignal


def test_signals_are_counted_and_ring_the_wake_up() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with StopOnSignal() as stop:
        stop.armed = True
        assert not stop.asked
        assert not stop.wake_up.wait(0)
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGINT)
        assert stop.asked
        assert stop.wake_up.wait(0)
        assert stop.count == 2
    assert signal.getsignal(signal.SIGTERM) == before


def test_before_it_is_armed_a_signal_interrupts() -> None:
    with StopOnSignal() as stop, pytest.raises(Interrupted) as caught:
        signal.raise_signal(signal.SIGTERM)
    assert (stop.asked, caught.value.code) == (False, 143)


def test_a_program_started_by_nohup_outlives_its_terminal() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with StopOnSignal() as stop:
            signal.raise_signal(signal.SIGHUP)
            signal.raise_signal(signal.SIGHUP)
            assert not stop.asked
            assert stop.count == 0
    finally:
        signal.signal(signal.SIGHUP, before)
