"""Peripherals of which only the registers are emulated. This suffices to start the Arduino core."""

from tools.due_emulator.peripheral import Peripheral

PLAIN = (
    *("HSMCI", "SSC", "SPI0", "PWM", "EMAC", "CAN0", "CAN1", "ADC", "DMAC", "DACC", "SMC", "MATRIX"),
    *("SUPC", "RTT", "RTC", "GPBR", "CHIPID", "UOTGHS"),
)
"""Names of the peripherals of which only the registers are emulated."""

RESET_VALUES = {
    # the chip's identifier (SAM3X datasheet, 9.2.3), which flash tools check
    ("CHIPID", "CIDR"): 0x285E_0A60,
}
REFUSED = {
    ("ADC", "CR"): 0x02,
    ("SPI0", "CR"): 0x01,
    ("DMAC", "EN"): 0x01,
    ("EMAC", "NCR"): 0x0C,
}
"""For each peripheral and register: the bits that would start functions that are not modelled. Writing such a
bit ends the run.
"""
SUPC_KEY, SUPC_KEYED = 0xA5, ("CR", "MR")
USB_CTRL_ENABLED, USB_CTRL_FROZEN, USB_CLOCK_USABLE = 1 << 15, 1 << 14, 1 << 14


class RegisterFile(Peripheral):
    """A peripheral that only stores written values.

    Registers that set, clear or show bits work. A write that would start a function is a fault.
    """

    def _store_reset_values(self) -> None:
        super()._store_reset_values()
        for (name, register), value in RESET_VALUES.items():
            if name == self.name:
                self.registers[register] = value

    def on_write(self, register: str, value: int) -> None:
        """Store the value, or set or clear bits."""
        if value & REFUSED.get((self.name, register), 0):
            self.machine.fault(f"{register} = 0x{value:X} starts {self.name}, which is not modelled")
        if self.name == "SUPC" and register in SUPC_KEYED:
            if value >> 24 != SUPC_KEY:
                self.machine.fault(
                    f"SUPC_{register} = 0x{value:08X} without its key 0xA5: the chip ignores it"
                )
            value &= 0x00FF_FFFF
        super().on_write(register, value)
        if self.name == "UOTGHS" and register == "CTRL":
            usable = value & USB_CTRL_ENABLED and not value & USB_CTRL_FROZEN
            self.registers["SR"] = USB_CLOCK_USABLE if usable else 0
