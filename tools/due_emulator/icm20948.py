"""The register file of the ICM-20948: what a driver sees over I2C, in virtual time.

Written from its data sheet DS-000189, revision 1.3, whose sections the comments name. The Raspberry Pi's
driver is tested against this model, and shares no register definition with it. Not modelled: filters,
self-test, offsets, cycle mode, the interrupt pin, the DMP, the auxiliary I2C bus and the magnetometer on it,
and the rate of an accelerometer with its own divider.
"""

from fltea.wire.sensors import temperature_counts

from tools.due_emulator.banked_chip import BankedChip
from tools.due_emulator.chip import MS_NS
from tools.due_emulator.mpu9250_scaling import ACCEL_LSB_PER_G, GYRO_LSB_PER_DPS, to_counts

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
"""For each source of data in the FIFO: its bit in the register FIFO_EN_2, and begin and end of its bytes
among the output bytes, as in a Python slice.
"""


class Icm20948(BankedChip):
    """A model of the ICM-20948."""

    fifo_register = FIFO_R_W
    quiet_ns = 11 * MS_NS
    # The data sheet, 3.4, gives 100 ms at most until registers can be written. The model's time is a little
    # shorter, because a driver may count from the time at which it began to write the reset command.
    ready_ns = 95 * MS_NS
    gyro_start_ns = 35 * MS_NS  # data sheet, 3.1
    fifo_bytes = 512
    reset_values = _RESET
    writable = _WRITABLE
    bank_select, bank_shift, bank_mask = BANK_SELECT, 4, 3
    _count = 0

    @property
    def output_hz(self) -> float:
        """Nominal rate of the output registers; 0 when the chip does not convert (data sheet, 8.4 and 10)."""
        power = self.register(PWR_MGMT_1)
        if not self.is_up or power & 0x40 or power & 7 == 7:
            return 0.0
        # If GYRO_FCHOICE is 0, the gyroscope's low-pass is off, and its rate is not divided.
        if not self.register(GYRO_CONFIG_1) & 1:
            return 9000.0
        return 1125.0 / (1 + self.register(GYRO_SMPLRT_DIV))

    def _load_special(self, register: int) -> int | None:
        if ACCEL_XOUT_H <= register <= TEMP_OUT_L:
            return self._output[register - ACCEL_XOUT_H]
        match register:
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
        return None

    def _store_special(self, register: int, value: int) -> bool:
        if register == PWR_MGMT_1 and value & 0x80:
            self._reset()
            return True
        if register == FIFO_RST and value & 0x1F:
            self.fifo.clear()  # while FIFO_RST is not 0, the FIFO stays empty (data sheet, 8.58)
        return False

    # Conversions

    def _convert(self, at_ns: int) -> None:
        motion = self._motion(at_ns)
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
