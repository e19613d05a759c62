"""Settings of the MPU-9250 and related chips, the same as in the Due's firmware (firmware/core/mpu9250.h)."""

from struct import Struct

from fltea.sources.i2c import mpu9250_registers as reg
from fltea.sources.i2c.chip import AD0, INT16_ENDS, Chip, Family, Packet, Setting

RATE_HZ = 100.0
PACKET = Packet(Struct(">7h"), accel=0, temperature=3, gyro=4)
"""Layout of a sample: acceleration, temperature and rate, as in the output registers (MPU-9250
register map, sections 4.22 to 4.24).
"""


def mpu9250(who_am_i: int) -> Chip:
    """Return the description of the chip with this WHO_AM_I. A clone is treated as an MPU-9250.

    The data sheets PS-MPU-9250A-01 (section 4.17) and PS-MPU-6000A-00 (section 7.17) describe the FIFO.
    Section 4.15 of PS-MPU-9250A-01 gives the clock an error of ±1 %; `clock_error` is four times as large,
    since an error beyond it costs samples. An MPU-6050 has no FIFO_MODE, so an overflow of its FIFO destroys
    a part of a sample.
    """
    old = who_am_i == 0x68
    stop = 0 if old else reg.FIFO_MODE_STOP
    settings = (
        Setting(reg.PWR_MGMT_1, reg.PLL_CLOCK, 0x7F),
        Setting(reg.SMPLRT_DIV, round(1000 / RATE_HZ) - 1, 0xFF),
        Setting(reg.CONFIG, stop | 1, 0x3F | stop),
        Setting(reg.GYRO_CONFIG, 3 << reg.RANGE_SHIFT, 0xFB),
        Setting(reg.ACCEL_CONFIG, 0 << reg.RANGE_SHIFT, 0xF8),
        Setting(reg.ACCEL_CONFIG_2, 1, 0x0F),
        Setting(reg.INT_PIN_CFG, reg.PULSE_HIGH, 0xFE),
        Setting(reg.INT_ENABLE, reg.FIFO_OVERFLOW, 0x59),
        Setting(reg.FIFO_EN, reg.FIFO_ALL, 0xFF),
    )
    return Chip(
        rate_hz=RATE_HZ,
        clock_error=0.04,
        gyro_range_dps=2000.0,  # ranges: data sheet PS-MPU-9250A-01, sections 3.1 and 3.2
        gyro_lsb_per_dps=16.4,
        gyro_ends=INT16_ENDS,
        gyro_dlpf_hz=188.0 if old else 184.0,
        accel_range_g=2.0,
        accel_lsb_per_g=16384.0,
        reset=(reg.PWR_MGMT_1, reg.RESET),
        reset_s=0.1,  # start-up time of the registers by data sheet PS-MPU-9250A-01
        # the gyroscope needs 35 ms to start from sleep (data sheet PS-MPU-9250A-01, section 3.1), and an
        # MPU-6050 sleeps after a reset
        settle_s=0.05,
        settings=tuple(s for s in settings if not (old and s.register == reg.ACCEL_CONFIG_2)),
        checked=((reg.SMPLRT_DIV, reg.FIFO_EN + 1 - reg.SMPLRT_DIV),),
        # An MPU-6050 resets its FIFO only while the FIFO is switched off.
        restart=tuple((reg.USER_CTRL, value) for value in (0, reg.USER_FIFO_RST, reg.USER_FIFO_EN)),
        running=Setting(reg.USER_CTRL, reg.USER_FIFO_EN, 0x70),
        packet=PACKET,
        fifo_bytes=1024 if old else 512,
        keeps_oldest=not old,
        fifo_count=reg.FIFO_COUNT_H,
        fifo_data=reg.FIFO_R_W,
        overflow=(reg.INT_STATUS, reg.FIFO_OVERFLOW),
    )


FAMILY = Family("mpu9250", reg.WHO_AM_I, AD0, mpu9250)
