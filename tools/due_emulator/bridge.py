"""The ATmega16U2, the microcontroller between the Due's UART and USB.

The bridge passes bytes from the UART on to the host, or garbles them at a wrong baud rate.

The bridge's ring buffer is short. Bytes that the host does not read in time are lost there and counted.
"""

from collections.abc import Callable

import numpy as np

from tools.due_emulator.machine import PS_PER_S, Machine

BAUD = 250_000
"""Baud rate of the protocol."""
TOLERANCE = 0.02
"""Largest relative error of the baud rate at which a receiver reads bytes correctly."""
RING_BYTES = 128
"""Size of the bridge's buffer of bytes for the host, as in the firmware of the real bridge."""


class RequestedLosses:
    """Loses bytes between the board and the host, as a test requests."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._next = 0
        self._probability = 0.0
        self._until_ps = 0

    def lose_next(self, count: int) -> None:
        """Lose the next `count` bytes."""
        self._next += count

    def lose_randomly(self, probability: float, until_ps: int) -> None:
        """Lose each byte with this probability, until a time [ps]."""
        self._probability = probability
        self._until_ps = until_ps

    def take(self, at_ps: int) -> bool:
        """Return whether the byte that comes at this time is lost [ps]."""
        if self._next:
            self._next -= 1
            return True
        return at_ps < self._until_ps and bool(self._rng.random() < self._probability)


class Bridge:
    """Receives the bytes of the UART. Those that reach the host are passed to `deliver`.

    `host_baud`: baud rate with which the host has opened the port. If the UART sends at another rate, the
    bytes become garbage, or the run ends if `strict_baud` is set.
    """

    def __init__(self, machine: Machine, seed: int) -> None:
        self._machine = machine
        self._rng = np.random.default_rng((seed, 0x16))
        self.deliver: Callable[[int], bool] = lambda byte: True
        """Function that receives each byte, and returns whether the host had room for it."""
        self.host_baud: float = BAUD
        self.strict_baud = True
        self.delivered = 0
        self.lost_by_fault = 0
        """Number of bytes lost because a test requested this fault."""
        self.lost_in_bridge = 0
        """Number of bytes lost because the ring buffer was full."""
        self.garbled = 0
        self._ring = bytearray()
        self._reads_from_ps = 0
        self._losses = RequestedLosses(self._rng)

    def send(self, byte: int, at_ps: int, baud: float) -> None:
        """Receive a byte from the UART."""
        if self._losses.take(at_ps):
            self.lost_by_fault += 1
            return
        if abs(baud / self.host_baud - 1) > TOLERANCE:
            if self.strict_baud:
                self._machine.fault(
                    f"the UART sends at {baud:.0f} baud; the host listens at {self.host_baud:.0f}, "
                    "and a receiver tolerates 2 %"
                )
            byte = int(self._rng.integers(256))
            self.garbled += 1
        if not self._ring and self._machine.now_ps >= self._reads_from_ps and self.deliver(byte):
            self.delivered += 1
            return
        if len(self._ring) >= RING_BYTES:
            self.lost_in_bridge += 1
            return
        self._ring.append(byte)
        if len(self._ring) > 1:
            self.flush()

    def flush(self) -> None:
        """Pass bytes in the ring buffer to the host, as many as the host takes."""
        if self._machine.now_ps < self._reads_from_ps:
            return
        ring, taken = self._ring, 0
        while taken < len(ring) and self.deliver(ring[taken]):
            taken += 1
        if taken:
            del ring[:taken]
            self.delivered += taken

    def forget(self) -> None:
        """Discard the bytes in the ring buffer, as the real bridge does when the host opens the port."""
        self._ring.clear()

    def lose_next(self, count: int) -> None:
        """Lose the next `count` bytes on their way to the host."""
        self._losses.lose_next(count)

    def lose_randomly(self, probability: float, for_ps: int) -> None:
        """Lose each byte with this probability, until a time has passed [ps]."""
        self._losses.lose_randomly(probability, self._machine.now_ps + for_ps)

    def stop_reading(self, for_ps: int) -> None:
        """Let the host read nothing for a time [ps]."""
        self._reads_from_ps = self._machine.now_ps + for_ps
        self._machine.schedule(for_ps, self.flush)


def seconds_to_ps(seconds: float) -> int:
    """Convert seconds to whole picoseconds."""
    return round(seconds * PS_PER_S)
