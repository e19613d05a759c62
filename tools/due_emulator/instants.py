"""Which sampling instants were due, as the board itself knows it: the sensor's bus and resets are watched."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

from tools.due_emulator.board import Board
from tools.due_emulator.machine import PS_PER_S
from tools.due_emulator.reset_controller import ResetType

DATA = 0x3B
"""First of the sensor's data registers."""
PERIOD_PS = PS_PER_S // 100


class Burst(NamedTuple):
    """One reading of the sensor's data registers, whole or not: when it began, and what it gave."""

    at_ps: int
    data: bytearray


@dataclass
class Boot:
    """One life of the program, as the emulator knows it.

    ended_ps: of the reset, or of the run. first_ps: of the first reading of the sensor. heard: numbers of the
    first and of the last sample that the host could use. bursts: empty where nobody keeps them.
    """

    cause: ResetType
    began_ps: int
    ended_ps: int = 0
    first_ps: int | None = None
    heard: tuple[int, int] | None = None
    bursts: list[Burst] = field(default_factory=list)

    @property
    def due(self) -> int:
        """Instants from the first reading of the sensor on: one each 10 ms, whatever became of them."""
        return 0 if self.first_ps is None else (self.ended_ps - self.first_ps) // PERIOD_PS + 1


class BusWatch:
    """Hears the sensor's side of the bus; tells of each reading of its data registers when it begins."""

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
