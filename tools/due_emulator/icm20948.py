"""The register file of the ICM-20948: what a driver sees over I2C, in virtual time.

Written from its data sheet DS-000189, revision 1.3, whose sections the comments name. The Raspberry Pi's
driver is tested against this model, and shares no register definition with it. Not modelled: filters,
self-test, offsets, cycle mode, the interrupt pin, the DMP, the auxiliary I2C bus and the magnetometer on it,
and the rate of an accelerometer with its own divider.
"""

from fltea.wire.sensors import temperature_counts

from tools.due_emulator.chip import MS_NS, Chip
from tools.due_emulator.mpu9250_scaling import ACCEL_LSB_PER_G, GYRO_LSB_PER_DPS, to_counts
from tools.due_emulator.noise import World

QUIET_NS = 11 * MS_NS
"""Time [ns] after power-up or reset in which the chip does not acknowledge."""
READY_NS = 95 * MS_NS
"""Time after power-up or reset in which written settings are lost.

The data sheet, 3.4, gives 100 ms at most until registers can be written. The model's time is a little
shorter, because a driver may count from the time at which it began to write the reset command.
"""

WHO_AM_I, USER_CTRL, PWR_MGMT_1 = 0x000, 0x003, 0x006
INT_STATUS_2, ACCEL_XOUT_H, TEMP_OUT_L = 0x01B, 0x02D, 0x03A
FIFO_EN_2, FIFO_RST, FIFO_MODE = 0x067, 0x068, 0x069
FIFO_COUNTH, FIFO_COUNTL, FIFO_R_W = 0x070, 0x071, 0x072
BANK_SELECT = 0x7F
GYRO_SMPLRT_DIV, GYRO_CONFIG_1, ACCEL_CONFIG = 0x200, 0x201, 0x214

_RESET = {PWR_MGMT_1: 0x41, 0x005: 0x40, GYRO_CONFIG_1: 0x01, ACCEL_CONFIG: 0x01}
_WRITABLE = {
    USER_CTRL: 0xF0,
    0x005: 0x70,
    PWR_MGMT_1: 0x6F,
    0x007: 0x3F,
    0x00F: 0xFE,
    0x010: 0x8F,
    0x011: 0x01,
    0x012: 0x1F,
    0x013: 0x1F,
    0x066: 0x0F,
    FIFO_EN_2: 0x1F,
    FIFO_RST: 0x1F,
    FIFO_MODE: 0x1F,
    0x076: 0x01,
    GYRO_SMPLRT_DIV: 0xFF,
    GYRO_CONFIG_1: 0x3F,
    0x202: 0x3F,
    0x209: 0x01,
    0x210: 0x0F,
    0x211: 0xFF,
    ACCEL_CONFIG: 0x3F,
    0x215: 0x1F,
    0x253: 0x07,
}
"""Writable bits of each register (data sheet, 8 and 10). Other registers are read-only, reserved, or not
modelled.
"""
_SOURCES = ((0x10, 0, 6), (0x02, 6, 8), (0x04, 8, 10), (0x08, 10, 12))
"""For each source of data in the FIFO: its bit in the register FIFO_EN_2, and its slice of the output bytes.
"""


class Icm20948(Chip):
    """A model of the ICM-20948 that was powered on long before time 0.

    `world`: object that says how the sensor moves at a given time. `fifo_bytes`: capacity of the FIFO.
    """

    fifo_register = FIFO_R_W

    def __init__(
        self, world: World, *, address: int = 0x68, clock_ppm: float = 0.0, fifo_bytes: int = 512
    ) -> None:
        super().__init__(address, clock_ppm)
        self.world = world
        self.fifo.size = fifo_bytes
        self.bank = self._status = self._count = 0
        self._output = bytes(14)
        self._registers: dict[int, int] = {}
        self._restore()

    # Time and power

    def advance(self, now_ns: int) -> None:
        """Advance time to `now_ns`."""
        if self._ready_at_ns is not None and self._ready_at_ns <= now_ns:
            self._now_ns = self._ready_at_ns
            self._restore()
        self._now_ns = now_ns
        while (at_ns := self._next_update_ns()) is not None and at_ns <= now_ns:
            self._updates += 1
            self._convert(at_ns)

    @property
    def output_hz(self) -> float:
        """Nominal rate of the output registers; 0 when the chip does not convert (data sheet, 8.4 and 10)."""
        power = self.register(PWR_MGMT_1)
        if not self.powered or self._ready_at_ns is not None or power & 0x40 or power & 7 == 7:
            return 0.0
        # If GYRO_FCHOICE is 0, the gyroscope's low-pass is off, and its rate is not divided.
        if not self.register(GYRO_CONFIG_1) & 1:
            return 9000.0
        return 1125.0 / (1 + self.register(GYRO_SMPLRT_DIV))

    def power_on(self) -> None:
        self.powered = True
        self._begin(QUIET_NS, READY_NS)

    def register(self, register: int) -> int:
        """Return the contents of a register without using the bus.

        `register`: the register's number plus 256 times the number of its bank.
        """
        return self._registers.get(register, 0)

    def spoil(self, register: int, value: int) -> None:
        """Change a register without the driver's knowledge, for tests of what the driver notices."""
        self._registers[register] = value

    # Registers

    @property
    def _register(self) -> int:
        return self._pointer if self._pointer == BANK_SELECT else self.bank << 8 | self._pointer

    def _load(self, register: int) -> int:
        if ACCEL_XOUT_H <= register <= TEMP_OUT_L:
            return self._output[register - ACCEL_XOUT_H]
        match register:
            case 0x7F:
                return self.bank << 4
            case 0x000:
                return 0xEA
            case 0x01B:
                status, self._status = self._status, 0
                return status
            # Reading this register stores both bytes of the FIFO's count, so that they belong together (data
            # sheet, 8.60).
            case 0x070:
                self._count = len(self.fifo)
                return self._count >> 8
            case 0x071:
                return self._count & 0xFF
            case 0x072:
                return self.fifo.pop()
        return self.register(register)

    def _store(self, register: int, value: int) -> None:
        if register == BANK_SELECT:
            self.bank = value >> 4 & 3
        elif register == PWR_MGMT_1 and value & 0x80:
            self._begin(QUIET_NS, READY_NS)
        else:
            before = self.output_hz
            self._registers[register] = value & _WRITABLE.get(register, 0)
            if self.output_hz != before:
                self._start_clock()
        if self.register(FIFO_RST):  # While FIFO_RST is not 0, the FIFO stays empty (data sheet, 8.58).
            self.fifo.clear()

    def _restore(self) -> None:
        self._ready_at_ns = None
        self._quiet_until_ns = 0
        self._registers = dict(_RESET)
        self.bank = 0
        self.fifo.clear()
        self._status = self._count = 0
        self._output = bytes(14)
        self._selected = False
        self._start_clock()

    # Conversions

    def _convert(self, at_ns: int) -> None:
        motion = self.world.at(at_ns)
        accel_lsb = ACCEL_LSB_PER_G[self.register(ACCEL_CONFIG) >> 1 & 3]
        gyro_lsb = GYRO_LSB_PER_DPS[self.register(GYRO_CONFIG_1) >> 1 & 3]
        values = [to_counts(a * accel_lsb) for a in motion.accel_g]
        values += [to_counts(r * gyro_lsb) for r in motion.rate_dps]
        values += [to_counts(temperature_counts(motion.celsius, 0xEA))]
        self._output = b"".join(values)
        sources = self.register(FIFO_EN_2)
        if self.register(USER_CTRL) & 0x40 and not self.register(FIFO_RST) and sources:
            data = b"".join(self._output[a:b] for bit, a, b in _SOURCES if sources & bit)
            if self.fifo.push(data, bool(self.register(FIFO_MODE) & 1)):
                self._status |= 0x01
