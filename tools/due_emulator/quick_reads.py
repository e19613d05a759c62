"""Registers that programs poll, laid out for `execution.cpp`: it reads them without Python.

Only reads that do nothing are made there. A peripheral keeps its entries true whenever they change; nobody
has to look at them.
"""

import ctypes

MOST = 16
NONE, WORD, COUNTER = range(3)


class QuickRegister(ctypes.Structure):
    """A register that holds a value, or counts.

    Holding: value; while it has one of the bits `cleared`, reading it does something and is left to Python.
    Counting: `from_cycles` and the cycles of hz / divider since from_ps, taken back to 0 at each `period`.
    """

    _fields_ = tuple(
        (name, ctypes.c_uint64)
        for name in (
            *("address", "_kind", "_clock", "_value", "_cleared"),
            *("_from_ps", "_from_cycles", "_hz", "_divider", "_period"),
        )
    )

    def hold(self, value: int, cleared: int) -> None:
        """Hold a value."""
        self._value, self._cleared, self._kind = value, cleared, WORD

    def count(self, from_ps: int, from_cycles: int, rate_hz: tuple[int, int], period: int) -> None:
        """Count."""
        self._from_ps, self._from_cycles, self._period = from_ps, from_cycles, period
        self._hz, self._divider = rate_hz
        self._kind = COUNTER


class QuickReads(ctypes.Structure):
    """All such registers of a machine. clocked: as `Machine.clocked`."""

    _fields_ = (
        ("clocked", ctypes.c_uint64),
        ("_count", ctypes.c_uint64),
        ("_registers", QuickRegister * MOST),
    )

    def add(self, address: int, clock: int | None) -> QuickRegister:
        """Lay out a register; clock: identifier of the peripheral whose clock it needs, if it needs one."""
        register: QuickRegister = self._registers[self._count]
        self._count += 1
        register.address, register._clock = address, 0 if clock is None else 1 << clock
        return register
