"""The pin controllers PIOA to PIOD: pins as outputs, as inputs, or assigned to a peripheral.

Source: SAM3X datasheet, chapter 31. Inputs can request interrupts. Not modelled: input filters (there are no
glitches here) and the drive of unconnected pins.
"""

from collections.abc import Callable
from functools import partial

from tools.due_emulator.machine import Machine
from tools.due_emulator.peripheral import Peripheral
from tools.due_emulator.wire import Wire

ALL = 0xFFFFFFFF
WP_KEY, WPEN = 0x50494F, 0x01

PROTECTED = {
    *("PER", "PDR", "OER", "ODR", "IFER", "IFDR", "MDER", "MDDR"),
    *("PUDR", "PUER", "ABSR", "OWER", "OWDR"),
}
"""Registers that the register WPMR can protect against writes (SAM3X datasheet, 31.5.16)."""

NEEDS_CLOCK = {"PDSR", "ISR", "IER"}
"""Registers for sampled input levels and for edges. No other register needs the controller's clock (SAM3X
datasheet, 31.4.3).
"""


class Pio(Peripheral):
    """A controller of 32 pins; `connect` connects a pin to a wire."""

    status = "ISR"

    def __init__(self, machine: Machine, name: str) -> None:
        super().__init__(machine, name)
        self.on_mux_change: list[Callable[[], None]] = []
        """Functions that are called when pins are reassigned between this controller and peripherals."""
        self.on_output: Callable[[int, bool], None] = lambda bit, level: None
        """Function that is called with (bit, level) when the level of an output pin changes."""
        self._wires: dict[int, Wire] = {}
        self._shown = 0
        self._power_up()

    def reset(self) -> None:
        """Make all pins inputs with pull-ups, assigned to this controller (SAM3X datasheet, 31.7)."""
        super().reset()
        self._power_up()

    def _power_up(self) -> None:
        self.registers["PSR"] = ALL
        self._follow(ALL)
        self.settle_irq()

    def connect(self, bit: int, wire: Wire) -> None:
        """Connect a pin to a wire."""
        self._wires[bit] = wire
        wire.listen(partial(self._on_wire, bit))
        self._follow(1 << bit)

    def peripheral(self, bit: int) -> str | None:
        """Return 'A' or 'B' for the peripheral to which a pin is assigned.

        None if this controller drives the pin.
        """
        if self.registers["PSR"] >> bit & 1:
            return None
        return "B" if self.registers["ABSR"] >> bit & 1 else "A"

    def output(self, bit: int) -> bool | None:
        """Return the level that the pin drives; None if it drives none, such as an open-drain output at 1."""
        registers = self.registers
        if not (registers["PSR"] & registers["OSR"]) >> bit & 1:
            return None
        high = bool(registers["ODSR"] >> bit & 1)
        return None if high and registers["MDSR"] >> bit & 1 else high

    def level(self, bit: int) -> bool:
        """Return the level at the pin."""
        wire = self._wires.get(bit)
        if wire is not None:
            return wire.level
        driven = self.output(bit)
        return driven if driven is not None else not self.registers["PUSR"] >> bit & 1

    def clock_id(self, register: str) -> int | None:
        """Return the identifier of the clock that a register needs.

        None for a register that needs no clock.
        """
        return super().clock_id(register) if register in NEEDS_CLOCK else None

    def on_read(self, register: str) -> int:
        """Read a register. PDSR has the pins' present levels. A read of the events in ISR clears them."""
        if register == "PDSR":
            return sum(1 << bit for bit in range(32) if self.level(bit))
        value = self.registers[register]
        if register == "ISR":
            self.registers["ISR"] = 0
            self.settle_irq()
        return value

    def on_write(self, register: str, value: int) -> None:
        """Write a register. Changes of outputs and of the pins' assignments take effect immediately."""
        if register in PROTECTED and self.registers["WPMR"] & WPEN:
            self.machine.fault(f"write of 0x{value:X} to {self.name}_{register}, which WPMR protects")
        if register == "WPMR":
            if value >> 8 != WP_KEY:
                self.machine.fault(
                    f"{self.name}_WPMR = 0x{value:08X} without its key 0x50494F: the chip ignores it"
                )
            self.registers["WPMR"] = value & WPEN
            return
        if register in self._bits:
            shown, sets = self._bits[register]
            if not value & (~self.registers[shown] if sets else self.registers[shown]):
                return  # The write changes no bit.
        changed = value
        if register == "ODSR":
            changed = self.registers["OWSR"]
            self.registers["ODSR"] = self.registers["ODSR"] & ~changed | value & changed
        else:
            if register not in self._bits:
                changed = value ^ self.registers[register]
            super().on_write(register, value)
        self._follow(changed & ALL)
        if register in ("PER", "PDR", "ABSR"):
            for tell in self.on_mux_change:
                tell()

    def _follow(self, bits: int) -> None:
        """Set the wires of these pins as the registers demand.

        Call `on_output` for each output that has changed.
        """
        for bit, wire in self._wires.items():
            if bits >> bit & 1:
                who = f"P{self.name[-1]}{bit}"
                wire.pull_up(who, not self.registers["PUSR"] >> bit & 1)
                wire.drive(who, self.output(bit))
        shown = self.registers["PSR"] & self.registers["OSR"] & self.registers["ODSR"]
        changed, self._shown = shown ^ self._shown, shown
        for bit in range(32):
            if changed >> bit & 1:
                self.on_output(bit, bool(shown >> bit & 1))

    def _on_wire(self, bit: int, level: bool) -> None:
        irq = self.table.irq
        if irq is None or not self.machine.clock_on(irq):
            return
        if self._is_event(bit, level):
            self.registers["ISR"] |= 1 << bit
            self.settle_irq()

    def _is_event(self, bit: int, level: bool) -> bool:
        """Return whether an edge at a pin is an event, which sets a bit of ISR (SAM3X datasheet, 31.5.10).

        Any edge is an event, unless the pin's bit in AIMMR is set. Then only edges to one level are events:
        to the level of the pin's bit in FRLHSR.
        """
        if not self.registers["AIMMR"] >> bit & 1:
            return True
        return level == bool(self.registers["FRLHSR"] >> bit & 1)
