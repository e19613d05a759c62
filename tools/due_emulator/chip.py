"""What the sensors on an I2C bus have in common: a FIFO, bytes on the bus, and a clock for conversions."""

import errno
from collections import deque

from tools.due_emulator.noise import Motion, World

PS_PER_NS = 1000
MS_NS = 1_000_000
_POINTER_MASK = 0x7F


class Fifo:
    """A queue of bytes in a chip. A full queue loses its oldest bytes or refuses the newest.

    The queue counts all bytes: offered, read, lost and discarded.

    `size`: capacity in bytes. The FIFO counts bytes, as the chips do: after an overflow the first byte read
    may lie within a sample.
    """

    def __init__(self) -> None:
        self.size = 0
        self._bytes: deque[int] = deque()
        self._last = 0
        self.written = self.read_out = self.lost = self.cleared = 0
        """Total numbers of bytes offered, read, lost by overflow, and discarded by a reset."""

    def __len__(self) -> int:
        return len(self._bytes)

    def push(self, data: bytes, stop_when_full: bool) -> bool:
        """Append bytes; return whether there was an overflow."""
        self.written += len(data)
        excess = max(0, len(self._bytes) + len(data) - self.size)
        self.lost += excess
        if stop_when_full:
            self._bytes.extend(data[: len(data) - excess])
        else:
            self._bytes.extend(data)
            for _ in range(excess):
                self._bytes.popleft()
        return excess > 0

    def pop(self) -> int:
        """Remove and return the oldest byte.

        An empty FIFO repeats the last byte (MPU-9250 register map, register 116).
        """
        if self._bytes:
            self._last = self._bytes.popleft()
            self.read_out += 1
        return self._last

    def clear(self) -> None:
        """Discard all bytes."""
        self.cleared += len(self._bytes)
        self._bytes.clear()


# Why more than 12 attributes: each is one register, latch or deadline that all modelled sensors have.
class Chip:
    """One chip on the bus; bytes are transferred by `start`, `write`, `read` and `stop`.

    `address`: address on the bus. `clock_ppm`: error of the chip's clock, positive if it is too fast.
    `fifo_register`: the register of the FIFO. After each access to another register, the chip goes on to the
    next register; after an access to this one it stays. `gyro_start_ns`: time that the gyroscope needs after
    it was switched on [ns]; until then it measures nothing. `fifo_kind`: class of the FIFO; it decides
    which value is read from an empty FIFO.
    """

    fifo_register: int
    gyro_start_ns = 0
    fifo_kind: type[Fifo] = Fifo
    world: World

    def __init__(self, address: int, clock_ppm: float) -> None:
        self.address = address
        self.fifo = self.fifo_kind()
        self.powered = True
        self._clock_ppm = clock_ppm
        self._now_ns = self._quiet_until_ns = 0
        self._ready_at_ns: int | None = None
        self._pointer = 0
        self._selected = self._reading = self._pointer_next = False
        self._anchor_ps = self._updates = 0
        self._period_ps: int | None = None
        self._gyro_starts_until_ns = 0

    # Members that a subclass (one for each kind of chip) defines or replaces

    @property
    def output_hz(self) -> float:
        """Nominal rate at which the output registers change; 0 when the chip does not convert."""
        raise NotImplementedError

    @property
    def _register(self) -> int:
        """Number of the register from which the next byte is read, or to which it is written."""
        return self._pointer

    def _load(self, register: int) -> int:
        raise NotImplementedError

    def _store(self, register: int, value: int) -> None:
        raise NotImplementedError

    def _restore(self) -> None:
        """Restore reset values, and restart the clock if these values let it run."""
        raise NotImplementedError

    def register(self, register: int) -> int:
        """Return the contents of a register without using the bus.

        `register` is its number plus 256 times its bank.
        """
        raise NotImplementedError

    def spoil(self, register: int, value: int) -> None:
        """Change a register from outside, without the driver's knowledge."""
        raise NotImplementedError

    # Power supply

    def power_off(self) -> None:
        """Remove the supply: the chip no longer acknowledges, and its registers are lost."""
        self.powered = False
        self._restore()

    def brown_out(self) -> None:
        """Set all registers to their reset values while the chip keeps running and acknowledging.

        For the driver, this is the worst kind of a brown-out.
        """
        self._restore()

    def _begin(self, quiet_ns: int, ready_ns: int) -> None:
        """Reset the chip.

        For the time `quiet_ns` the chip acknowledges nothing. It loses values that are written within the
        time `ready_ns`.
        """
        self._restore()
        self._quiet_until_ns = self._now_ns + quiet_ns
        self._ready_at_ns = self._now_ns + ready_ns
        self._start_clock()

    # Bus

    def start(self, address: int, read: bool) -> bool:
        """Receive a START or repeated START with an address; return whether the chip acknowledges."""
        self._selected = address == self.address and self.powered and self._now_ns >= self._quiet_until_ns
        self._reading = read
        self._pointer_next = not read
        return self._selected

    def write(self, byte: int) -> bool:
        """Receive a byte. The first byte is a register's address.

        Later bytes are values for successive registers.
        """
        if not self._selected or self._reading:
            return False
        if self._pointer_next:
            self._pointer, self._pointer_next = byte & _POINTER_MASK, False
        else:
            self._store(self._register, byte)
            self._step_pointer()
        return True

    def read(self, ack: bool) -> int:
        """Return the next byte.

        If `ack` is false, this byte is the last. If the chip is not being read, the result is 0xFF, the bus's
        idle level.
        """
        if not self._selected or not self._reading:
            return 0xFF
        value = self._load(self._register)
        self._step_pointer()
        self._selected = ack
        return value

    def stop(self) -> None:
        self._selected = False

    def _step_pointer(self) -> None:
        if self._register != self.fifo_register:
            self._pointer = (self._pointer + 1) & _POINTER_MASK

    # Convenience functions for whole transactions

    def read_block(self, register: int, n: int) -> bytes:
        """Read `n` bytes from `register` on in one transaction, as `smbus2` does.

        Raises:
            OSError: EREMOTEIO, which Linux reports when no chip acknowledges.
        """
        data = b""
        if self.start(self.address, False) and self.write(register) and self.start(self.address, True):
            data = bytes(self.read(ack=i < n - 1) for i in range(n))
        self.stop()
        if len(data) < n:
            raise OSError(errno.EREMOTEIO, "Remote I/O error")
        return data

    def write_register(self, register: int, *values: int) -> None:
        """Write a value to a register; further values go to the registers that follow.

        Raises:
            OSError: EREMOTEIO, which Linux reports when no chip acknowledges.
        """
        acked = self.start(self.address, False) and all(self.write(b) for b in (register, *values))
        self.stop()
        if not acked:
            raise OSError(errno.EREMOTEIO, "Remote I/O error")

    # Clock

    def _start_clock(self) -> None:
        """Start the chip's clock now; it updates the output registers at the configured rate."""
        self._anchor_ps, self._updates = self._now_ns * PS_PER_NS, 0
        rate_hz = self.output_hz * (1 + self._clock_ppm * 1e-6)
        # at time 0, a chip has been on for long
        if rate_hz and self._period_ps is None and self._now_ns:
            self._gyro_starts_until_ns = self._now_ns + self.gyro_start_ns
        self._period_ps = round(1e12 / rate_hz) if rate_hz else None

    def _motion(self, at_ns: int) -> Motion:
        """Return what the chip feels of the world at a time.

        A gyroscope that is still starting feels nothing.
        """
        motion = self.world.at(at_ns)
        if at_ns < self._gyro_starts_until_ns:
            return motion._replace(rate_dps=(0.0, 0.0, 0.0))
        return motion

    def _next_update_ns(self) -> int | None:
        if self._period_ps is None:
            return None
        return -(-(self._anchor_ps + (self._updates + 1) * self._period_ps) // PS_PER_NS)
