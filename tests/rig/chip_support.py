"""Emulated sensor chips that are already set up, and a simulated environment for them. The values that a chip
measures in this environment tell the time of the measurement.
"""

from tools.due_emulator.mpu9250 import Mpu9250
from tools.due_emulator.noise import Constant, Motion

MS = 1_000_000


class Ramp:
    """A simulated environment whose values tell the time. The rate x grows by 0x0123 LSB per ms, at ±2000
    deg/s. The rates y and z and the acceleration x change by 1 LSB per ms.
    """

    def at(self, now_ns):
        n = now_ns // MS
        return Motion((n * 0x0123 / 16.4, -n / 16.4, n / 16.4), (n / 16384, 0.0, 1.0), 25.0)


def running(world=None, *, at_ms=0, dlpf=1, divider=0, gyro=0x18, **options):
    """Return an emulated chip that is set up as the firmware does it."""
    chip = Mpu9250(world or Constant((1.0, -2.0, 3.0)), **options)
    chip.advance(at_ms * MS)
    chip.write_register(0x6B, 0x01)
    chip.write_register(0x19, divider, dlpf, gyro, 0x00, 0x01)
    return chip


def words(data):
    return [int.from_bytes(data[i : i + 2], "big", signed=True) for i in range(0, len(data), 2)]
