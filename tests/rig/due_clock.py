"""The emulated Due's way from 4 MHz to 84 MHz, as a program goes it."""

from tools.due_emulator.board import Board
from tools.due_emulator.machine import PS_PER_S

MS = PS_PER_S // 1000
FAR = 0x0037_0809
"""CKGR_MOR with its key: crystal and RC on, start-up 64 slow cycles (1.95 ms)."""
PLLA_168 = 1 << 29 | 13 << 16 | 0x3F << 8 | 1


def crystal(board: Board) -> None:
    board.pmc.write("CKGR_MOR", FAR)
    board.machine.advance(2 * MS)
    board.pmc.write("CKGR_MOR", FAR | 1 << 24)
    board.machine.advance(MS)


def plla(board: Board) -> None:
    crystal(board)
    board.pmc.write("CKGR_PLLAR", PLLA_168)
    board.machine.advance(2 * MS)


def wait_states(board: Board) -> None:
    for controller in board.flash_controllers:
        controller.write("FMR", 4 << 8)


def full_speed(board: Board) -> None:
    wait_states(board)
    plla(board)
    for value in (0x11, 0x12):
        board.pmc.write("MCKR", value)
        board.machine.advance(MS)
