"""The ATmega16U2 between the UART and the host: it takes bytes at the host's baud rate, or garbles them.

Its ring is short: bytes that the host does not fetch in time are lost there and counted.
"""

from collections.abc import Callable

import numpy as np

from tools.due_emulator.machine import PS_PER_S, Machine

BAUD = 250_000
"""Baud rate of the protocol."""
TOLERANCE = 0.02
"""Further off than that, a receiver misreads bytes."""
RING_BYTES = 128
"""Its buffer towards the host (the board's bridge firmware)."""


class Bridge:
    """Takes the UART's bytes; `deliver` gets those that reach the host.

    host_baud: what the host has opened the port with. Where the UART sends at another rate, bytes become
    garbage, or end the run if `strict_baud` is set.
    """

    def __init__(self, machine: Machine, seed: int) -> None:
        self._machine = machine
        self._rng = np.random.default_rng((seed, 0x16))
        self.deliver: Callable[[int], bool] = lambda byte: True
        """Takes each byte that reaches the host, and says whether it did."""
        self.host_baud: float = BAUD
        self.strict_baud = True
        self.delivered = 0
        self.lost_by_fault = 0
        """Bytes taken off the wire by a fault of the script."""
        self.lost_in_bridge = 0
        """Bytes for which the ring had no room."""
        self.garbled = 0
        self._ring = bytearray()
        self._reads_from_ps = 0
        self._lose_next = 0
        self._lose_probability = 0.0
        self._lose_until_ps = 0

    def send(self, byte: int, at_ps: int, baud: float) -> None:
        """Take a byte from the UART."""
        if self._is_lost(at_ps):
            self.lost_by_fault += 1
            return
        if abs(baud / self.host_baud - 1) > TOLERANCE:
            if self.strict_baud:
                self._machine.fault(
                    f"the UART sends at {baud:.0f} baud; the host listens at {self.host_baud:.0f}, "
                    "and 2 % is all that a receiver forgives"
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
        """Hand over what waits in the ring, as far as the host takes it."""
        if self._machine.now_ps < self._reads_from_ps:
            return
        ring, taken = self._ring, 0
        while taken < len(ring) and self.deliver(ring[taken]):
            taken += 1
        if taken:
            del ring[:taken]
            self.delivered += taken

    def forget(self) -> None:
        """Empty the ring, as when the port is opened."""
        self._ring.clear()

    def lose_next(self, count: int) -> None:
        """Let the next bytes not arrive."""
        self._lose_next += count

    def lose_randomly(self, probability: float, for_ps: int) -> None:
        """Let each byte for so long be lost with this probability."""
        self._lose_probability = probability
        self._lose_until_ps = self._machine.now_ps + for_ps

    def stop_reading(self, for_ps: int) -> None:
        """Let the host take nothing for so long."""
        self._reads_from_ps = self._machine.now_ps + for_ps
        self._machine.schedule(for_ps, self.flush)

    def _is_lost(self, at_ps: int) -> bool:
        if self._lose_next:
            self._lose_next -= 1
            return True
        return at_ps < self._lose_until_ps and bool(self._rng.random() < self._lose_probability)


def seconds_to_ps(seconds: float) -> int:
    """Seconds to whole picoseconds."""
    return round(seconds * PS_PER_S)
