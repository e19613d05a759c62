"""Drives a sensor on a Linux I²C bus: identifies it, sets it up, and reads whole samples from its FIFO.

The sensor's own clock sets the sampling rate, and the FIFO holds the samples until they are read. A reading
transaction writes a register's number and then reads once. A second register needs another transaction,
since the I²C controllers of the Raspberry Pi 1 to 4 refuse anything that follows a read.
"""

import errno
from collections.abc import Callable
from typing import NamedTuple

from smbus2 import i2c_msg

from fltea.sources.i2c.bus import Bus
from fltea.sources.i2c.chip import Family, Row, Setting
from fltea.sources.i2c.chips import CHIPS, ask_identity, chip_of
from fltea.sources.i2c.fifo_clock import Span
from fltea.wire.layout import FaultCode
from fltea.wire.sensors import SENSORS

BURST_BYTES = 252
"""Largest number of bytes that are read at once. Some adapters transfer at most 255 bytes in one message, and
252 bytes are whole samples of most chips.
"""

TRIES = 3
NOT_ACKNOWLEDGED = frozenset({errno.EREMOTEIO, errno.ENXIO})
"""Error numbers of a transfer in which the chip did not acknowledge its address or a register's number.
Nothing was read from the FIFO, so the transfer can be repeated without a loss.
"""
PASSING = NOT_ACKNOWLEDGED | {errno.EIO, errno.ETIMEDOUT, errno.EAGAIN, errno.EINTR}
"""Error numbers that concern a single transfer. Any other error concerns the bus itself, and is raised
unchanged.
"""

Counts = tuple[tuple[int, ...], int, tuple[int, ...]]
"""Raw values of one sample in counts: acceleration, temperature, and angular rate."""


class SensorFault(Exception):
    """Raised if the sensor answers, but wrongly: for example with an unknown WHO_AM_I, or with lost settings.

    `detail`: says more about the fault. protocol/README.md defines its meaning for each `FaultCode`.
    """

    def __init__(self, code: FaultCode, detail: int) -> None:
        super().__init__(code, detail)
        self.code = code
        self.detail = detail


class TransferFailed(Exception):
    """Raised if a transfer failed at every attempt."""

    def __init__(self, error: OSError) -> None:
        super().__init__(error)
        self.error = error
        self.acknowledged = error.errno not in NOT_ACKNOWLEDGED
        """Whether the chip acknowledged the transfer's beginning. Then bytes from the FIFO may be lost."""


class Level(NamedTuple):
    """Fill level of the FIFO in bytes. It was read at some time between `before_ns` and `after_ns`."""

    bytes: int
    overflowed: bool
    before_ns: int
    after_ns: int


class Driver:
    """Sets up and reads one sensor; the caller must set `bus` first.

    `family`: name in `CHIPS` of the family to which the sensor belongs, if the user gives it, else "".
    `now_ns`: function that reads the host's clock [ns].
    `i2c_errors`: number of transfers that failed, or whose first answer was wrong and whose repeated answer
    was right.
    `retried`: whether a transfer was repeated since the caller last set this to False.
    """

    def __init__(self, address: int, now_ns: Callable[[], int], family: str = "") -> None:
        self.bus: Bus | None = None
        self.address = address
        self._families = [CHIPS[family]] if family else list(CHIPS.values())
        self._family = self._families[0]  # the family to which `self.chip` belongs
        self.chip = self._family.chip(0)
        self.i2c_errors = 0
        self.retried = False
        self._now_ns = now_ns
        self._bank: int | None = None
        self._overflowed = False
        self._temperature = 0
        self.filled = Span(0, 0)

    def identify(self) -> int:
        """Return the WHO_AM_I of the sensor.

        Raises:
            SensorFault: the chip is unknown, so its registers or scales may differ.
            TransferFailed: no chip answers at the address.
        """
        # The WHO_AM_I is read twice for each family, since interference may flip a bit of an answer.
        who_am_i, known = ask_identity(self._ask, self._families, tries=2)
        if not known:
            raise SensorFault(FaultCode.SENSOR_UNKNOWN, who_am_i)
        return who_am_i

    def start_reset(self, who_am_i: int) -> None:
        """Reset every register. The caller must wait for the chip's `reset_s` before the next transfer."""
        self._family = CHIPS[SENSORS[who_am_i].family]
        self.chip = chip_of(who_am_i)
        self._bank = None
        self._write(*self.chip.reset)
        self._bank = None

    def configure(self) -> None:
        """Write every setting and read it back.

        Afterwards the gyroscope needs the chip's `settle_s` to settle.

        Raises:
            SensorFault: a register did not keep its setting.
            TransferFailed: the sensor no longer answers.
        """
        for setting in self.chip.settings:
            self._write(setting.register, setting.value)
            self._confirm(setting.register, 1, [setting])

    def check_settings(self) -> None:
        """Check that the registers still hold the settings of the samples' rate, scale and content.

        A chip whose supply voltage failed for a moment still answers, but its settings are reset. So samples
        count as valid only if this check succeeds after the samples were read.

        Raises:
            SensorFault, TransferFailed: `configure` says for which reasons.
        """
        for first, n in self.chip.checked:
            span = range(first, first + n)
            self._confirm(first, n, [s for s in self.chip.settings if s.register in span])

    def restart_fifo(self) -> None:
        """Empty the FIFO, and start to fill it again. `filled` then says when the filling started.

        Before the start, the overflow flag is read, which clears it. If it were read after the start, and the
        bus delayed the read, the flag of a new overflow could be cleared.
        """
        *emptying, (register, value) = self.chip.restart
        for one in emptying:
            self._write(*one)
        self._read(self.chip.overflow[0], 1)
        before_ns = self._now_ns()
        self._write(register, value)
        self.filled = Span(before_ns, self._now_ns())
        self._confirm(self.chip.running.register, 1, [self.chip.running])
        self._overflowed = False

    def level(self) -> Level:
        """Return the FIFO's fill level, and whether the FIFO has overflowed since its last restart."""
        chip = self.chip
        self._select(chip.fifo_count)
        before_ns = self._now_ns()
        count = int.from_bytes(self._read(chip.fifo_count, 2), "big")
        after_ns = self._now_ns()
        status, bits = chip.overflow
        self._overflowed |= bool(self._read(status, 1)[0] & bits)
        if chip.temperature is not None:
            self._temperature = int.from_bytes(self._read(chip.temperature, 2), "big", signed=True)
        too_full = count > chip.fifo_bytes - chip.packet.size
        return Level(count, self._overflowed or too_full, before_ns, after_ns)

    def read_samples(self, n: int) -> list[Row]:
        """Return the values of the oldest `n` samples in the FIFO. They take at most `BURST_BYTES` bytes.

        Raises:
            TransferFailed: the read failed; if the error's `acknowledged` is True, some bytes may be lost.
        """
        # A transfer that broke off cannot be repeated, since the FIFO gives each byte only once.
        layout = self.chip.packet.layout
        return list(layout.iter_unpack(self._read(self.chip.fifo_data, n * layout.size, NOT_ACKNOWLEDGED)))

    def counts(self, row: Row) -> Counts:
        """Split a sample into the counts of acceleration, temperature and angular rate.

        If the FIFO does not hold the temperature, the value that the last call of `level` read is used.
        """
        _, accel, gyro, place, _ = self.chip.packet
        temperature = self._temperature if place is None else row[place]
        return row[accel : accel + 3], temperature, row[gyro : gyro + 3]

    def _ask(self, family: Family) -> int:
        """Read the chip's WHO_AM_I from the register that this family uses for it.

        The bank of this register is selected only if the chip is known to be of this family. On another kind
        of chip, a write to the register that selects the bank may do something else.
        """
        if family is self._family and self.chip.banks is not None:
            self._bank = None
            return self._read(family.who_am_i, 1)[0]
        return self._transfer_read(family.who_am_i & 0xFF, 1, PASSING)[0]

    def _confirm(self, first: int, n: int, settings: list[Setting]) -> None:
        """Check the settings in `n` successive registers from `first` on.

        If a setting is wrong, read the registers once more, since a bit may have flipped on the bus.
        """
        for last_time in (False, True):
            values = self._read(first, n)
            wrong = [s for s in settings if not s.kept(values[s.register - first])]
            if not wrong:
                self.i2c_errors += last_time
                return
        register, value, _ = wrong[0]
        detail = register << 16 | value << 8 | values[register - first]
        raise SensorFault(FaultCode.READBACK_MISMATCH, detail)

    def _select(self, register: int) -> None:
        """Select the bank of a register, if the chip has banks."""
        bank = register >> 8
        banks = self.chip.banks
        if banks is None or bank == self._bank:
            return
        self._bank = None  # the selected bank is unknown until the write has succeeded
        message = i2c_msg.write(self.address, [banks.select, bank << banks.shift])
        self._transfer([message], PASSING)
        self._bank = bank

    def _write(self, register: int, value: int) -> None:
        self._select(register)
        self._transfer([i2c_msg.write(self.address, [register & 0xFF, value])], PASSING)

    def _read(self, register: int, n: int, repeatable: frozenset[int] = PASSING) -> bytes:
        self._select(register)
        return self._transfer_read(register & 0xFF, n, repeatable)

    def _transfer_read(self, number: int, n: int, repeatable: frozenset[int]) -> bytes:
        answer = i2c_msg.read(self.address, n)
        self._transfer([i2c_msg.write(self.address, [number]), answer], repeatable)
        return bytes(answer)

    def _transfer(self, messages: list[i2c_msg], repeatable: frozenset[int]) -> None:
        assert self.bus is not None
        for tries_left in range(TRIES - 1, -1, -1):
            try:
                return self.bus.i2c_rdwr(*messages)
            except OSError as error:
                if error.errno not in PASSING:
                    raise
                self.i2c_errors += 1
                self.retried = True
                if not tries_left or error.errno not in repeatable:
                    raise TransferFailed(error) from error
        raise AssertionError("unreachable")
