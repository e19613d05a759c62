"""Registers that programs poll, stored so that `execution.cpp` can read them without Python.

`execution.cpp` only performs reads without side effects. Each peripheral updates the entries of its registers
whenever these change.
"""

import ctypes

MOST = 16
NONE, WORD, COUNTER = range(3)


class QuickRegister(ctypes.Structure):
    """A register of one of two kinds: it has a fixed value, or it counts the cycles of a clock.

    A fixed value is in `_value`. A read clears the bits `_cleared` of the register. While one of them is set,
    Python performs the read.

    A counter has the value `_from_cycles` at the time `_from_ps`. It grows with the frequency `_hz` /
    `_divider`, and begins at 0 again when it reaches `_period`.
    """

    _fields_ = tuple(
        (name, ctypes.c_uint64)
        for name in (
            *("address", "_kind", "_clock", "_value", "_cleared"),
            *("_from_ps", "_from_cycles", "_hz", "_divider", "_period"),
        )
    )

    def hold(self, value: int, cleared: int) -> None:
        """Give the register a fixed value. `cleared`: the bits of the value that a read clears."""
        self._value, self._cleared, self._kind = value, cleared, WORD

    def count(self, from_ps: int, from_cycles: int, rate_hz: tuple[int, int], period: int) -> None:
        """Let the register count with the frequency `rate_hz` (numerator, denominator).

        Its value is `from_cycles` at the time `from_ps`. When it reaches `period`, it begins at 0 again.
        """
        self._from_ps, self._from_cycles, self._period = from_ps, from_cycles, period
        self._hz, self._divider = rate_hz
        self._kind = COUNTER


class QuickReads(ctypes.Structure):
    """All quick registers of a machine: those that C++ reads without Python.

    `clocked`: which peripherals have a clock, as in `Machine`.
    """

    _fields_ = (
        ("clocked", ctypes.c_uint64),
        ("_count", ctypes.c_uint64),
        ("_registers", QuickRegister * MOST),
    )

    def add(self, address: int, clock: int | None) -> QuickRegister:
        """Add a register. `clock`: identifier of the peripheral whose clock a read needs, or None."""
        register: QuickRegister = self._registers[self._count]
        self._count += 1
        register.address, register._clock = address, 0 if clock is None else 1 << clock
        return register
