"""Run the real command on a machine that seems to have an MPU-9250 on /dev/i2c-1.

Usage: `python -m tests.e2e.pi_launcher NOISE run …`.

The emulator's chip model replaces the real bus behind the interface of the library smbus2, and runs in real
time. All else is as on a Raspberry Pi.
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
"""Longest pause of the test machine that chip and program can see [ns]. It is shorter than the 0.36 s in
which the chip's FIFO fills.
"""


class RealHost:
    """A host for the simulated bus, in real time. It tells the time, and lets time pass while a transfer
    lasts.

    If the test machine pauses for longer than the FIFO takes to fill, samples would be lost whatever the
    program does. Chip and program therefore see no pause longer than `LONGEST_NS`.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._begin_ns = self._last_ns = clock.host_ns()
        self._left_out_ns = 0

    def host_ns(self) -> int:
        """Return the present time for the program."""
        with self._lock:
            last_ns, self._last_ns = self._last_ns, clock.host_ns()
            self._left_out_ns += max(0, self._last_ns - last_ns - LONGEST_NS)
            return self._last_ns - self._left_out_ns

    @property
    def now_ns(self) -> int:
        """Return the present time for the chip."""
        return self.host_ns() - self._begin_ns

    def let_pass(self, ns: int) -> None:
        time.sleep(ns * 1e-9)


if __name__ == "__main__":
    host = RealHost()
    bus = FakeBus(host, Mpu9250(fractional_world(sys.argv.pop(1))))
    i2c_bus.open_bus = bus.open
    with mock.patch.object(SystemClock, "host_ns", host.host_ns):
        main()
