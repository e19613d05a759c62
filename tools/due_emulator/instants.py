"""Counts the sampling instants that were due on the board, from what the sensor's bus and the resets show."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

from tools.due_emulator.board import Board
from tools.due_emulator.machine import PS_PER_S
from tools.due_emulator.reset_controller import ResetType

DATA = 0x3B
"""Number of the first of the sensor's data registers, which have acceleration, temperature and rate."""
PERIOD_PS = PS_PER_S // 100


class Burst(NamedTuple):
    """One read of the sensor's data registers, complete or not: its start time and its bytes."""

    at_ps: int
    data: bytearray


@dataclass
class Boot:
    """One run of the program between two resets, with facts that the emulator observed.

    `ended_ps`: moment of the next reset, or of the end of the run. `first_ps`: moment of the first read of
    the sensor. `heard`: numbers of the first and the last sample that the host could use. `bursts`: the reads
    of the sensor; empty unless the user of this class appends them.
    """

    cause: ResetType
    began_ps: int
    ended_ps: int = 0
    first_ps: int | None = None
    heard: tuple[int, int] | None = None
    bursts: list[Burst] = field(default_factory=list)

    @property
    def due(self) -> int:
        """Number of sampling instants since the first read of the sensor.

        There is one instant every 10 ms, whether its sample was received or not.
        """
        return 0 if self.first_ps is None else (self.ended_ps - self.first_ps) // PERIOD_PS + 1


class BusWatch:
    """Watches the sensor's side of the bus and calls `on_burst` when a read of its data registers begins."""

    def __init__(self, board: Board, on_burst: Callable[[Burst], None]) -> None:
        self._board = board
        self._on_burst = on_burst
        self._pointer: int | None = None
        self._burst: Burst | None = None
        socket = board.socket
        socket.start = partial(self._start, socket.start)  # type: ignore[method-assign]
        socket.write = partial(self._write, socket.write)  # type: ignore[method-assign]
        socket.read = partial(self._read, socket.read)  # type: ignore[method-assign]

    def _start(self, go: Callable[[int, bool], bool], address: int, read: bool) -> bool:
        ack = go(address, read)
        if read and ack and self._pointer == DATA:
            self._burst = Burst(self._board.machine.now_ps, bytearray())
            self._on_burst(self._burst)
        elif not read:
            self._pointer = self._burst = None
        return ack

    def _write(self, go: Callable[[int], bool], byte: int) -> bool:
        ack = go(byte)
        if ack and self._pointer is None:
            self._pointer = byte
        return ack

    def _read(self, go: Callable[[bool], int], ack: bool) -> int:
        byte = go(ack)
        if self._burst is not None:
            self._burst.data.append(byte)
        return byte
