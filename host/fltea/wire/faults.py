"""Explains a device's FAULT messages to users, and says what they should do.

The codes in FAULT messages are listed in protocol/README.md.
"""

from fltea.wire.layout import FaultCode

_LINES = {1: "SDA stays", 2: "SCL stays", 3: "SDA and SCL stay"}


def fault_text(code: int, detail: int, sensor: str = "the sensor") -> str:
    """Return a text for users that says what fault happened, its likely cause, and what to do.

    `code`, `detail`: the fields of the FAULT message.
    `sensor`: name of the sensor, which the text mentions.
    """
    match code:
        case FaultCode.SENSOR_MISSING:
            return (
                f"no sensor answers at I²C address 0x{detail:02X}. Check its wires: VCC to 3.3 V, GND, SDA "
                "to pin 20, SCL to pin 21; AD0 to GND gives address 0x68, to 3.3 V 0x69 (kSensorAddress in "
                "the firmware's settings.h)."
            )
        case FaultCode.SENSOR_UNKNOWN:
            return (
                f"a chip answers, but its WHO_AM_I is 0x{detail:02X}. This is neither an MPU-9250 nor one of "
                "its known relatives. Check which kind of sensor it is. 0x00 or 0xFF means a bad contact on "
                "SDA."
            )
        case FaultCode.READBACK_MISMATCH:
            register, written, read = detail >> 16, detail >> 8 & 0xFF, detail & 0xFF
            bank = f" of bank {register >> 8}" if register >> 8 else ""
            return (
                f"register 0x{register & 0xFF:02X}{bank} of {sensor} holds 0x{read:02X} in place of "
                f"0x{written:02X}, so the chip is set up again. If this happens once, the chip's 3.3 V "
                "supply dipped, the chip was plugged in again, or a wire is loose. If it happens again and "
                "again, the chip is a clone, another program uses the sensor, or the wires are too long for "
                "the bus's speed (keep them below 30 cm)."
            )
        case FaultCode.BUS_HELD:
            return (
                f"{_LINES.get(detail, 'the I²C bus stays')} low after nine clock pulses. Check for a short "
                "to GND, for swapped SDA and SCL, and for a sensor without 3.3 V."
            )
        case FaultCode.SENSOR_LOST:
            return (
                f"{sensor} stopped answering ({detail} errors in a row) and is set up again. The cause is "
                "a loose wire, or a dip of its 3.3 V supply."
            )
        case FaultCode.DATA_READY_MISSING:
            return (
                f"no edge on the data-ready pin for {detail / 1e6:.3g} s. Check the fifth wire, from the "
                "sensor's INT to pin 2. Without this wire, build the firmware in timer mode (settings.h)."
            )
        case FaultCode.SENSOR_FROZEN:
            equal = f" ({detail} equal samples in a row)" if detail else ""
            return (
                f"{sensor} answers, but gives no new samples{equal}, so the sensor is set up again. If this "
                "happens once, the sensor fell asleep after a dip of its 3.3 V supply. If it happens again "
                "and again, the sensor's clock has stopped, so the chip is broken or a bad copy; try another "
                "one."
            )
        case _:
            return f"this fltea does not know the fault's code (detail 0x{detail:X}). Update fltea."
