"""Converts a motion of the sensor to the counts in its output registers, at the configured ranges."""

from fltea.wire.sensors import temperature_counts

from tools.due_emulator.noise import Motion

GYRO_LSB_PER_DPS = (131.0, 65.5, 32.8, 16.4)
"""Counts per deg/s for each value of GYRO_FS_SEL in register 27 (MPU-9250 product specification, 3.1)."""
ACCEL_LSB_PER_G = (16384, 8192, 4096, 2048)
"""Counts per g for each value of ACCEL_FS_SEL in register 28 (MPU-9250 product specification, 3.2)."""
OUTPUT_BYTES = 14


def output_bytes(motion: Motion, gyro_fs: int, accel_fs: int, who_am_i: int) -> bytes:
    """Return the bytes of registers 59 to 72 for a motion: acceleration, temperature, rate."""
    accel = [to_counts(a * ACCEL_LSB_PER_G[accel_fs]) for a in motion.accel_g]
    temperature = to_counts(temperature_counts(motion.celsius, who_am_i))
    gyro = [to_counts(r * GYRO_LSB_PER_DPS[gyro_fs]) for r in motion.rate_dps]
    return b"".join((*accel, temperature, *gyro))


def to_counts(value: float) -> bytes:
    """Return the nearest count as two bytes, high byte first, saturated at the ends of int16."""
    return max(-32768, min(32767, round(value))).to_bytes(2, "big", signed=True)
