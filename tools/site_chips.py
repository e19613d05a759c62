"""Writes the site's table of chips that a Raspberry Pi can read, from the driver's tables."""

from fltea.sources.i2c.chips import chip_of
from fltea.wire.sensors import SENSORS


def chips() -> str:
    """Return a row for each chip: its names, its settings, and the time in which its FIFO fills."""
    text = [
        "| chip | WHO_AM_I | `&chip=` | rate | range | low-pass of the rate | FIFO |",
        "|---|---|---|---|---|---|---|",
    ]
    for who_am_i, sensor in SENSORS.items():
        chip = chip_of(who_am_i)
        cells = (
            sensor.name,
            f"`0x{who_am_i:02X}`",
            f"`{sensor.family}`",
            f"{chip.rate_hz:g} Hz",
            f"±{chip.gyro_range_dps:g} deg/s, ±{chip.accel_range_g:g} g",
            f"{chip.gyro_dlpf_hz:g} Hz",
            f"{chip.fifo_samples} samples, {chip.fifo_s:.2g} s",
        )
        text.append(f"| {' | '.join(cells)} |")
    return "\n".join(text)
