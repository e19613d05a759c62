"""Explains failures on a Linux I²C bus to the user: what happened, the likely cause, and what to do."""

from fltea.sources.i2c.bus import detect_command
from fltea.sources.i2c.chips import ADDRESSES, with_banks
from fltea.wire import faults
from fltea.wire.layout import FaultCode
from fltea.wire.sensors import known_sensors

_WIRES = (
    "On a Raspberry Pi: VCC to pin 1 (3.3 V), GND to pin 6, SDA to pin 3, SCL to pin 5; the address is "
    + " or ".join(f"0x{address:02X} with {how}" for address, how in ADDRESSES.items())
)


def fault_text(code: FaultCode, detail: int, path: str, address: int) -> str:
    """Return the text about a fault of the sensor.

    `detail`: detail of the fault, as protocol/README.md defines it for this code.
    """
    match code:
        case FaultCode.SENSOR_MISSING:
            return (
                f"no sensor answers at I²C address 0x{address:02X} on {path}. {_WIRES}. "
                f"'{detect_command(path)}' shows which addresses answer."
            )
        case FaultCode.SENSOR_UNKNOWN:
            keys = " or ".join(f"'&chip={name}'" for name in with_banks())
            return (
                f"a chip answers at 0x{address:02X} on {path}, but its WHO_AM_I is 0x{detail:02X}: no "
                f"{known_sensors()}, nor a known clone. Is it another kind of sensor? 0x00 or 0xFF mean a "
                "bad contact on SDA, or a chip that another program left with another bank of registers "
                f"selected: then name the chip in the source, by {keys}."
            )
        case FaultCode.BUS_HELD:
            return (
                f"transfers on {path} break off: SDA or SCL stays low, or is disturbed. Check for a short to "
                f"GND, SDA and SCL swapped, and a sensor without 3.3 V. {_WIRES}. "
                f"If '{detect_command(path)}' takes minutes, the reason is the same."
            )
    text = faults.fault_text(code, detail, f"the sensor at 0x{address:02X} on {path}")
    return f"{text} {_WIRES}." if code == FaultCode.SENSOR_LOST else text


def bus_lost_text(path: str, error: OSError) -> str:
    """Return the text that tells the user that the bus itself failed."""
    return (
        f"the I²C bus {path} was lost ({error}): its adapter was unplugged, its driver was unloaded, or it "
        "cannot do plain I²C transfers. It is opened again."
    )


def loss_text(cause: str, missing: int, doubt: int, fifo_s: float) -> tuple[str, str]:
    """Return kind and text of a message about samples that were lost in the sensor's FIFO.

    `missing`: number of lost samples; the true number differs from it by at most `doubt`. `fifo_s`: time that
    the samples of a full FIFO span [s].
    """
    lost = f"{missing} samples are lost"
    if doubt:
        lost = f"{missing} ± {doubt} samples are lost"
    match cause:
        case "overflow":
            return "fifo_overflow", (
                f"the sensor's FIFO ran over: nobody read it for longer than the {fifo_s:.2g} s that it "
                f"holds; {lost}. Is the machine overloaded, or was the program stopped?"
            )
        case "misaligned":
            why = "held no whole samples: disturbed wires, or another program that reads the same sensor"
        case "out_of_step":
            why = (
                "held more or less than the time allows: another program that reads the same sensor, or, if "
                "it happens every few seconds, a clone whose clock is wrong by some percent"
            )
        case _:
            why = "may have lost bytes in a transfer that broke off: disturbed wires, or a loose contact"
    return "fifo_restarted", f"the sensor's FIFO was emptied, because it {why}; {lost}."
