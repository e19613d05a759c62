"""Runs the emulated board in real time, with its programming port as a pseudo-terminal.

The board is reset whenever a program opens this port.

The kernel reports whether the port is open, but not the moment of opening. A port that is closed and opened
again between two checks, some 5 to 20 ms apart, is not noticed and does not reset the board.
"""

import math
import sys
import time
from typing import NoReturn

from tools.due_emulator.board import Board
from tools.pty_port import PtyPort

CHUNK_S = 0.005
ERASE_BAUD = 1200
BEHIND_S = 0.5
"""Smallest lag behind real time that causes a warning [s]. If the board runs at half of real time, the lag
grows to this value in a second.
"""
AGAIN_S = 60.0
"""Shortest time between two warnings [s]."""
WINDOW_S = 1.0
"""Shortest time over which the speed of the emulation is measured [s]."""


class Pace:
    """Measures how far a run lags behind real time. `check` must be called with rising times."""

    def __init__(self) -> None:
        self.worst_lag_s = 0.0
        self._mark = (0.0, 0.0)
        self._speed: float | None = None
        self._warned_s = -math.inf

    def check(self, real_s: float, board_s: float) -> str | None:
        """Return the warning that is due now, or None.

        `real_s`: real time since the beginning [s]. `board_s`: the board's virtual time since the beginning
        [s].
        """
        lag_s = real_s - board_s
        self.worst_lag_s = max(self.worst_lag_s, lag_s)
        before_s, board_before_s = self._mark
        if real_s - before_s >= WINDOW_S:
            self._speed = (board_s - board_before_s) / (real_s - before_s)
            self._mark = (real_s, board_s)
        # No warning is needed while the lag shrinks.
        if lag_s <= BEHIND_S or real_s - self._warned_s < AGAIN_S or self._speed is None or self._speed >= 1:
            return None
        self._warned_s = real_s
        return (
            f"this machine is too slow or too busy: the board runs at {self._speed:.0%} of real time and is "
            f"{lag_s:.1f} s behind."
        )


class Front:
    """Runs the board while a client has the port open; otherwise the board stands still.

    Warnings are printed to standard error.
    """

    def __init__(self, board: Board, port: PtyPort) -> None:
        self._board = board
        self._port = port
        self.worst_lag_s = 0.0
        self.openings = 0

    @property
    def notes(self) -> list[str]:
        """Remarks on the run for the report."""
        notes = [f"the port was opened {self.openings} time(s)"]
        if self.worst_lag_s > BEHIND_S:
            notes.append(f"this machine is too slow: up to {self.worst_lag_s:.1f} s behind real time")
        return notes

    def serve(self) -> NoReturn:
        """Serve one client of the port after another, until a signal interrupts the program.

        Raises:
            EmulationFault: the program did what the real board does not tolerate.
        """
        while True:
            while not self._port.is_open:
                self._board.machine.check_interrupted()
                self._look_at_baud()
                time.sleep(4 * CHUNK_S)
            self.openings += 1
            self._board.reopen_port()
            self._run()
            self._port.forget()

    def _run(self) -> None:
        board, port = self._board, self._port
        begin_s, board_begin_s = time.monotonic(), board.now_s
        pace = Pace()
        while port.is_open:
            board.machine.check_interrupted()
            self._look_at_baud()
            due_s = time.monotonic() - begin_s
            done_s = board.now_s - board_begin_s
            if not board.memory.is_blank:
                if (warning := pace.check(due_s, done_s)) is not None:
                    print(f"due_emulator: {warning}", file=sys.stderr, flush=True)
                self.worst_lag_s = max(self.worst_lag_s, pace.worst_lag_s)
                # Run for a limited time only, so that the port is checked often even if the board lags.
                board.run_until(board_begin_s + min(due_s, done_s + 4 * CHUNK_S) + CHUNK_S)
            board.bridge.flush()
            port.flush()
            ahead_s = board.now_s - board_begin_s - (time.monotonic() - begin_s)
            time.sleep(max(0.0, CHUNK_S if board.memory.is_blank else ahead_s))

    def _look_at_baud(self) -> None:
        baud = self._port.baud
        self._board.bridge.host_baud = baud
        if baud == ERASE_BAUD and not self._board.memory.is_blank:
            self._board.memory.erase_flash()
            print(
                "due_emulator: the port was opened at 1200 baud, so the bridge erased the flash, as the real "
                "one does: the board is silent until it is flashed (here: until the emulator starts again).",
                file=sys.stderr,
                flush=True,
            )
