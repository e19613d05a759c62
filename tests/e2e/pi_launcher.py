"""Run the real command on a machine that seems to have an MPU-9250 on /dev/i2c-1.

Usage: `python -m tests.e2e.pi_launcher NOISE run …`.

The chip model takes the place of the bus behind the interface of smbus2, in real time. All else is as on a
Raspberry Pi.
"""

import sys
import threading
import time
from unittest import mock

from fltea.cli.app import main
from fltea.records import clock
from fltea.sources.i2c import bus as i2c_bus
from fltea.sources.i2c.source import SystemClock

from tests.rig.fake_smbus import FakeBus
from tools.due_emulator.mpu9250 import Mpu9250
from tools.due_emulator.noise import fractional_world

LONGEST_NS = 200_000_000
"""Longest pause [ns]; it is shorter than the chip's FIFO lasts, which is 0.36 s."""


class RealHost:
    """What the fake bus needs of a host: its time, and that a transfer takes some time.

    If the test machine pauses for longer than the FIFO lasts, samples would be lost whatever the program
    does. So chip and program see no pause longer than `LONGEST_NS`.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._begin_ns = self._last_ns = clock.host_ns()
        self._left_out_ns = 0

    def host_ns(self) -> int:
        """Return the time of the program."""
        with self._lock:
            last_ns, self._last_ns = self._last_ns, clock.host_ns()
            self._left_out_ns += max(0, self._last_ns - last_ns - LONGEST_NS)
            return self._last_ns - self._left_out_ns

    @property
    def now_ns(self) -> int:
        """Return the time of the chip."""
        return self.host_ns() - self._begin_ns

    def let_pass(self, ns: int) -> None:
        time.sleep(ns * 1e-9)


if __name__ == "__main__":
    host = RealHost()
    bus = FakeBus(host, Mpu9250(fractional_world(sys.argv.pop(1))))
    i2c_bus.open_bus = bus.open
    with mock.patch.object(SystemClock, "host_ns", host.host_ns):
        main()
