"""The table of chips on the site that a Raspberry Pi reads, written from what the driver knows of them."""

from fltea.sources.i2c.chips import chip_of
from fltea.wire.sensors import SENSORS


def chips() -> str:
    """Return a row for each chip: how it is named and set up, and for how long its FIFO lasts."""
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
