"""The MPU-9250 and its relatives on a Linux I²C bus: set-up, and whole samples out of its FIFO.

The settings are those of the Due's firmware (firmware/core/mpu9250.h), but that the sensor's own clock gives
the rate and its FIFO holds the samples. A transaction writes an address and then reads once: the
controller of the Raspberry Pi 1 to 4 refuses any in which something follows a read.
"""

import errno
from collections.abc import Callable
from struct import Struct
from typing import NamedTuple

from smbus2 import i2c_msg

from fltea.sources.i2c import registers as reg
from fltea.sources.i2c.bus import Bus
from fltea.wire.layout import FaultCode
from fltea.wire.sensors import SENSORS

RATE_HZ = 100.0
GYRO_RANGE_DPS = 2000.0
GYRO_LSB_PER_DPS = 16.4
ACCEL_RANGE_G = 2.0
ACCEL_LSB_PER_G = 16384.0
"""Sensitivities: PS-MPU-9250A-01, 3.1 and 3.2."""

SAMPLE = Struct(">7h")
"""One sample in the FIFO: acceleration, temperature, rate, as in the output registers [4.22 to 4.24]."""

BURST_SAMPLES = 18
"""252 bytes: some adapters move no more than 255 in one message."""

RESET_S = 0.1
"""After a reset the registers answer like after power-up: within 100 ms (PS-MPU-9250A-01, start-up time)."""
SETTLE_S = 0.05
"""The gyroscope needs 35 ms from sleep (PS-MPU-9250A-01, 3.1), where an MPU-6050 is after its reset."""

TRIES = 3
NOT_ACKNOWLEDGED = frozenset({errno.EREMOTEIO, errno.ENXIO})
"""Only an address or a register's number can be refused, so nothing had been read yet."""
PASSING = NOT_ACKNOWLEDGED | {errno.EIO, errno.ETIMEDOUT, errno.EAGAIN, errno.EINTR}
"""Failures of one transfer; any other error is one of the bus itself, and is passed on as it is."""


class Kind(NamedTuple):
    """What differs between the relatives.

    fifo_bytes: PS-MPU-9250A-01, 4.17; PS-MPU-6000A-00, 7.17. keeps_oldest: CONFIG has FIFO_MODE, so that what
    a full FIFO holds stays whole; otherwise an overflow tears it.
    """

    gyro_dlpf_hz: float
    has_accel_config_2: bool = True
    fifo_bytes: int = 512
    keeps_oldest: bool = True


def kind_of(who_am_i: int) -> Kind:
    """What the chip with this WHO_AM_I is like; a clone is taken for an MPU-9250."""
    if who_am_i == 0x68:
        return Kind(188.0, has_accel_config_2=False, fifo_bytes=1024, keeps_oldest=False)
    return Kind(184.0)


class Setting(NamedTuple):
    """What a register is set to. Bits without a meaning may read as anything on a clone."""

    register: int
    value: int
    meaning: int

    def kept(self, value: int) -> bool:
        """Whether a register that reads so is as it was set."""
        return not (value ^ self.value) & self.meaning


def settings_of(kind: Kind) -> list[Setting]:
    """All settings, in the order of writing: the first wakes the chip, the last fills the FIFO."""
    stop = reg.FIFO_MODE_STOP if kind.keeps_oldest else 0
    settings = [
        Setting(reg.PWR_MGMT_1, reg.PLL_CLOCK, 0x7F),
        Setting(reg.SMPLRT_DIV, round(1000 / RATE_HZ) - 1, 0xFF),
        Setting(reg.CONFIG, stop | 1, 0x3F | stop),
        Setting(reg.GYRO_CONFIG, 3 << reg.RANGE_SHIFT, 0xFB),
        Setting(reg.ACCEL_CONFIG, 0 << reg.RANGE_SHIFT, 0xF8),
        Setting(reg.ACCEL_CONFIG_2, 1, 0x0F),
        Setting(reg.INT_PIN_CFG, reg.PULSE_HIGH, 0xFE),
        Setting(reg.INT_ENABLE, reg.FIFO_OVERFLOW, 0x59),
        Setting(reg.FIFO_EN, reg.FIFO_ALL, 0xFF),
    ]
    return [s for s in settings if kind.has_accel_config_2 or s.register != reg.ACCEL_CONFIG_2]


class SensorFault(Exception):
    """The sensor answers, but not as it should; `detail` as in protocol/README.md, FaultCode."""

    def __init__(self, code: FaultCode, detail: int) -> None:
        super().__init__(code, detail)
        self.code = code
        self.detail = detail


class TransferFailed(Exception):
    """A transfer failed as often as it is tried."""

    def __init__(self, error: OSError) -> None:
        super().__init__(error)
        self.error = error
        self.acknowledged = error.errno not in NOT_ACKNOWLEDGED
        """Whether it broke off in its midst, so that bytes may be gone."""


class Level(NamedTuple):
    """What the FIFO held at some moment between `before_ns` and `after_ns`."""

    bytes: int
    overflowed: bool
    before_ns: int
    after_ns: int


class Driver:
    """One sensor; `bus` has to be set before it is used.

    now_ns: the host's clock. `i2c_errors` counts transfers that failed, or gave a wrong answer and then the
    right one. `retried`: whether one had to be repeated since this was last set to False.
    """

    def __init__(self, address: int, now_ns: Callable[[], int]) -> None:
        self.bus: Bus | None = None
        self.address = address
        self.kind = Kind(0.0)
        self.i2c_errors = 0
        self.retried = False
        self._now_ns = now_ns
        self._settings: list[Setting] = []
        self._overflowed = False

    def identify(self) -> int:
        """Ask who is there.

        Raises:
            SensorFault: a chip that is not known: it might have other registers or scales.
            TransferFailed: nobody answers.
        """
        for _ in range(2):  # a wrong answer may be a bit that flipped on the wires
            who_am_i = self._read(reg.WHO_AM_I, 1)[0]
            if who_am_i in SENSORS:
                return who_am_i
        raise SensorFault(FaultCode.SENSOR_UNKNOWN, who_am_i)

    def start_reset(self, who_am_i: int) -> None:
        """Give every register its reset value; the next transfer has to wait for `RESET_S`."""
        self.kind = kind_of(who_am_i)
        self._settings = settings_of(self.kind)
        self._write(reg.PWR_MGMT_1, reg.RESET)

    def configure(self) -> None:
        """Write and read back every setting; then the gyroscope needs `SETTLE_S`.

        Raises:
            SensorFault: a register did not keep its setting.
            TransferFailed: the sensor no longer answers.
        """
        for setting in self._settings:
            self._write(setting.register, setting.value)
            self._confirm(setting.register, 1, [setting])

    def check_settings(self) -> None:
        """See that what gives a sample its rate, scale and shape is as it was set.

        A chip that lost its supply for a moment answers as if nothing had happened. What it read out before
        this can be believed only after it.

        Raises:
            SensorFault, TransferFailed: as `configure`.
        """
        span = range(reg.SMPLRT_DIV, reg.FIFO_EN + 1)
        self._confirm(span[0], len(span), [s for s in self._settings if s.register in span])

    def restart_fifo(self) -> None:
        """Empty the FIFO and let it fill from here on."""
        for value in (0, reg.USER_FIFO_RST, reg.USER_FIFO_EN):  # an MPU-6050 resets it only while it is off
            self._write(reg.USER_CTRL, value)
        self._confirm(reg.USER_CTRL, 1, [Setting(reg.USER_CTRL, reg.USER_FIFO_EN, 0x70)])
        self._read(reg.INT_STATUS, 1)
        self._overflowed = False

    def level(self) -> Level:
        """How full the FIFO is, and whether it ran over since it was restarted."""
        before_ns = self._now_ns()
        count = int.from_bytes(self._read(reg.FIFO_COUNT_H, 2), "big")
        after_ns = self._now_ns()
        self._overflowed |= bool(self._read(reg.INT_STATUS, 1)[0] & reg.FIFO_OVERFLOW)
        too_full = count > self.kind.fifo_bytes - SAMPLE.size
        return Level(count, self._overflowed or too_full, before_ns, after_ns)

    def read_samples(self, n: int) -> list[tuple[int, ...]]:
        """Take the oldest n samples out of the FIFO, at most `BURST_SAMPLES`; seven counts each.

        Raises:
            TransferFailed: with `acknowledged`, some of the bytes may be gone.
        """
        # A transfer that broke off cannot be repeated: the FIFO does not give a byte twice.
        return list(SAMPLE.iter_unpack(self._read(reg.FIFO_R_W, n * SAMPLE.size, NOT_ACKNOWLEDGED)))

    def _confirm(self, first: int, n: int, settings: list[Setting]) -> None:
        """Read n registers; a wrong one may be a bit that flipped on the wires: ask once more."""
        for last_time in (False, True):
            values = self._read(first, n)
            wrong = [s for s in settings if not s.kept(values[s.register - first])]
            if not wrong:
                self.i2c_errors += last_time
                return
        register, value, _ = wrong[0]
        detail = register << 16 | value << 8 | values[register - first]
        raise SensorFault(FaultCode.READBACK_MISMATCH, detail)

    def _write(self, register: int, value: int) -> None:
        self._transfer([i2c_msg.write(self.address, [register, value])], PASSING)

    def _read(self, register: int, n: int, repeatable: frozenset[int] = PASSING) -> bytes:
        answer = i2c_msg.read(self.address, n)
        self._transfer([i2c_msg.write(self.address, [register]), answer], repeatable)
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
