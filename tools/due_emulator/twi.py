"""The I²C controllers TWI0 and TWI1 as bus masters: whole bytes, with their durations on the wires.

Source: SAM3X datasheet, chapter 33 (33.8 master mode, 33.11 registers). The SAM4CP datasheet, 34.7.3.5, says
of the same controller that SCL waits in the last bit until the program has read the receive register RHR.

A byte of a write that was not acknowledged stays in the transmit register THR, and the next write sends it
first. Later controllers of the family (SAMA5D2) have a command that discards this byte; on the SAM3X only the
controller's reset, SWRST, discards it.

Not modelled, and refused: slave mode, quick command, transfers by DMA (PDC).
"""

from collections.abc import Generator

from tools.due_emulator.i2c_lines import FASTEST_HZ, TOLERANCE, I2cLines
from tools.due_emulator.machine import NEVER_PS, PS_PER_S, Alarm, Machine
from tools.due_emulator.peripheral import Peripheral
from tools.due_emulator.pio import Pio

START, STOP, MSEN, MSDIS, SVEN, SVDIS, QUICK, SWRST = (1 << bit for bit in range(8))
TXCOMP, RXRDY, TXRDY, NACK = 0x001, 0x002, 0x004, 0x100
CLEARED_BY_READ = 0x370
"""The flags GACC, OVRE, NACK and ARBLST, which a read of the status register clears (SAM3X datasheet,
33.11.6).
"""
PDC_ENABLES = 0x101

IDLE_LINE = 0xFF

LAST_BIT = 7.5
"""Position in a received byte [bits] at which the controller stops the bus clock if the receive register
still has the byte before. Once the program has read that byte, 1.5 bits follow. STOP must be requested 1 bit
before the end, so the program has half a bit of time for it.
"""
BYTE_BITS = 9

Transfer = Generator[float | None, None, None]
"""A transfer as a generator. It yields the duration of the next step in bits, or None to wait until the
program acts.
"""
Addressing = Generator[float | None, None, bool]


# Why more than 12 attributes: each is one register, wire or deadline of the modelled peripheral.
class Twi(Peripheral):
    """One I²C controller on its bus.

    `lines`: the bus to which the controller's pins TWD (data) and TWCK (clock) are connected. `pio`, `pins`:
    the pins' controller and their bits in it; the program has to assign these pins to the controller
    (peripheral A).
    """

    status = "SR"

    def __init__(self, machine: Machine, name: str, lines: I2cLines, pio: Pio, pins: tuple[int, int]) -> None:
        super().__init__(machine, name)
        self._stale = False
        self._lines = lines
        self._pio = pio
        self._pins = pins
        self.busy_ps = 0
        """Total time for which transfers have held the bus [ps]."""
        self.transfers = 0
        self.stale_reads = 0
        """Each of this many coming reads leaves an extra byte in the receive register, as if the program had
        requested STOP too late.
        """
        self._quick_status = machine.quick_reads.add(
            self.table.base + self.table.registers["SR"].offset, self.clock_id("SR")
        )
        self._alarm = Alarm(machine, self._resume)
        self._thr: int | None = None
        self._remains: int | None = None
        """The byte that stayed in the transmit register because a write was not acknowledged, or None."""
        self._on_line: tuple[bool, int, int] | None = None
        """The byte that is on the wires: whether the sensor sends it, its value, and the time at which it
        started [ps]. None if no byte is on the wires.
        """
        self._transfer: Transfer | None = None
        self._waiting = self._stalled = False
        self._begun_ps = 0
        self._stop_ps = NEVER_PS
        """Time at which the program requested STOP."""
        self._bit_ps = 1.0
        self._idle()
        pio.on_mux_change.append(self._on_mux_change)
        lines.scl.listen(self._on_scl)

    def reset(self) -> None:
        """Reset the controller, as a reset of the chip or the command SWRST does. A transfer is cut off."""
        self._abort()
        super().reset()
        self._idle()
        self.settle_irq()

    @property
    def half_bits_s(self) -> tuple[float, float]:
        """Times for which SCL is low and high in a bit, by register CWGR (SAM3X datasheet, 33.11.5) [s]."""
        ckdiv, mck_hz = self.field("CWGR", "CKDIV"), self.machine.mck_hz
        low, high = (((self.field("CWGR", name) << ckdiv) + 4) / mck_hz for name in ("CLDIV", "CHDIV"))
        return low, high

    @property
    def scl_hz(self) -> float:
        """Clock of the bus [Hz]."""
        return 1 / sum(self.half_bits_s)

    @property
    def load_ps(self) -> int:
        """Total time for which transfers have held the bus [ps].

        Unlike `busy_ps`, this time includes the present transfer.
        """
        running = self.machine.now_ps - self._begun_ps if self._transfer is not None else 0
        return self.busy_ps + running

    def on_read(self, register: str) -> int:
        """Read a register. A read of the status register clears its events.

        While the receive register RHR is full, the controller stops the bus clock in the last bit of the next
        byte. After the program has read RHR, the rest of this byte follows.
        """
        value = self.registers[register]
        if register == "SR":
            self.flag("SR", CLEARED_BY_READ, False)
        elif register == "RHR":
            self.flag("SR", RXRDY, False)
            self._continue()
        return value

    def on_write(self, register: str, value: int) -> None:
        """Write a register: a command, data or a setting. Settings may change only between transfers."""
        match register:
            case "CR":
                self._command(value)
            case "THR":
                self._transmit(value & 0xFF)
            case "PTCR" if value & PDC_ENABLES:
                self.machine.fault(f"{self.name}_PTCR: transfers by PDC are not modelled for the TWI")
            case _:
                if register in ("MMR", "IADR", "CWGR") and self._transfer is not None:
                    self.machine.fault(f"{self.name}_{register} is written while a transfer is under way")
                super().on_write(register, value)

    # Commands

    def _command(self, value: int) -> None:
        if value & SWRST:
            self.reset()
            return
        if value & QUICK:
            self.machine.fault(f"{self.name}_CR = 0x{value:X}: the quick command is not modelled")
        if value & (SVEN | SVDIS):
            self._slave = not value & SVDIS
        if value & MSDIS:
            self._abort()
            self._master = False
            self.flag("SR", TXRDY, False)
            return
        if value & MSEN:
            self._master = True
            if self._transfer is None:
                self.flag("SR", TXRDY, True)
        if value & START and self.field("MMR", "MREAD"):
            if self._transfer is not None:
                self.machine.fault(f"{self.name}: START while a transfer is under way")
            self._begin(self._receive())
        if value & STOP and self._transfer is not None:
            self._stop_ps = min(self._stop_ps, self.machine.now_ps)
            self._continue()

    def _transmit(self, byte: int) -> None:
        if self._transfer is None:
            if self.field("MMR", "MREAD"):
                self.machine.fault(f"{self.name}_THR is written, but MMR.MREAD says that this is a read")
            self._thr = byte
            self._begin(self._send(self._remains))
            return
        if not self.registers["SR"] & TXRDY:
            self.machine.fault(f"{self.name}_THR is written while TXRDY is 0: the byte before it is lost")
        self._thr = byte
        self.flag("SR", TXRDY, False)
        self._continue()

    def _begin(self, transfer: Transfer) -> None:
        self._stale = self._stale and bool(self.registers["SR"] & RXRDY)
        self._check_ready()
        self._transfer = transfer
        self._begun_ps = self.machine.now_ps
        self.transfers += 1
        self._stop_ps, self._bit_ps = NEVER_PS, PS_PER_S / self.scl_hz
        self.flag("SR", TXCOMP | TXRDY, False)
        self._resume()

    def _check_ready(self) -> None:
        name, fault = self.name, self.machine.fault
        if not self._master:
            fault(f"{name}: a transfer without MSEN")
        if self._slave:
            fault(f"{name}: a transfer while SVEN is on; slave mode is not modelled")
        if self.registers["SR"] & RXRDY and not self._stale:
            fault(f"{name}: STOP was set too late, so one byte too many was read and lies in RHR")
        for bit in self._pins:
            if self._pio.peripheral(bit) != "A":
                fault(f"{name}: a transfer while P{self._pio.name[-1]}{bit} is not assigned to peripheral A")
        if self.scl_hz > FASTEST_HZ * (1 + TOLERANCE):
            fault(f"{name}_CWGR sets {self.scl_hz / 1e3:.0f} kHz: the sensor takes 400 kHz")

    # Transfers

    def _open(self, read: bool) -> Addressing:
        """Send START and addresses.

        A read that begins with the address of a register in the sensor needs a repeated START (SAM3X
        datasheet, 33.8.6).
        """
        self._lines.take(self.name)
        address = self.field("MMR", "DADR")
        inner = self.field("MMR", "IADRSZ")
        self._show(address << 1 | (read and not inner))
        yield 10
        acked = self._lines.start(address, read and not inner)
        for place in reversed(range(inner)):
            if not acked:
                return False
            byte = self.registers["IADR"] >> 8 * place & 0xFF
            self._show(byte)
            yield 9
            acked = self._lines.write(byte)
        if acked and read and inner:
            self._show(address << 1 | 1)
            yield 10
            acked = self._lines.start(address, True)
        return acked

    def _show(self, byte: int, *, sending: bool = False) -> None:
        self._on_line = (sending, byte, self.machine.now_ps)

    def _receive(self) -> Transfer:
        if not (yield from self._open(read=True)):
            yield from self._refused()
            return
        machine, more = self.machine, True
        while more:
            byte = self._lines.read(True)
            self._show(byte, sending=True)
            end_ps = machine.now_ps + self._ps(BYTE_BITS)
            if self.registers["SR"] & RXRDY:
                yield LAST_BIT
            while self.registers["SR"] & RXRDY:
                yield None
            rest_ps = self._ps(BYTE_BITS - LAST_BIT)
            end_ps = max(end_ps, machine.now_ps + rest_ps)
            self._on_line = (True, byte, end_ps - self._ps(BYTE_BITS))
            yield (end_ps - machine.now_ps) / self._bit_ps
            # If a device has held SCL low during this wait, the byte ends later.
            while machine.now_ps > end_ps:
                end_ps = machine.now_ps + rest_ps
                yield BYTE_BITS - LAST_BIT
            more = self._stop_ps >= end_ps - self._ps(1)
            self.registers["RHR"] = byte
            self.flag("SR", RXRDY, True)
        if self.stale_reads:
            yield from self._anticipate()
        yield from self._close()

    def _anticipate(self) -> Transfer:
        """After the program has read the last byte, receive one byte more: 0xFF, as the idle bus is high.

        The real controller can receive such an extra byte, too. The Linux driver empties the receive register
        for this reason.
        """
        while self.registers["SR"] & RXRDY:
            yield None
        self.stale_reads -= 1
        self._stale = True
        self.registers["RHR"] = IDLE_LINE
        self.flag("SR", RXRDY, True)

    def _send(self, remains: int | None) -> Transfer:
        if not (yield from self._open(read=False)):
            self._remains, self._thr = self._thr, None
            yield from self._refused()
            return
        self._remains = None
        while True:
            if remains is not None:
                byte, remains = remains, None
            else:
                taken, self._thr = self._thr, None
                assert taken is not None
                byte = taken
                self.flag("SR", TXRDY, True)
            self._show(byte)
            yield 9
            if not self._lines.write(byte):
                yield from self._refused()
                return
            while self._thr is None:
                if self._stop_ps < NEVER_PS:
                    yield from self._close()
                    return
                yield None

    def _refused(self) -> Transfer:
        yield from self._close(NACK | TXRDY)

    def _close(self, flags: int = TXRDY) -> Transfer:
        self._on_line = None
        yield 1
        self._lines.stop()
        self._end()
        self.flag("SR", TXCOMP | flags, True)

    # Time

    def _resume(self) -> None:
        """Continue the transfer up to its next wait."""
        self._waiting = False
        if self._transfer is None or self._stalled:
            return
        if not self._lines.scl.level:
            return  # SCL is stretched: `_on_scl` continues the transfer
        if not self._lines.sda.level:
            # A device holds SDA low, so neither START nor data can be sent; only the commands SWRST (reset)
            # and MSDIS (master off) end this state.
            self._stalled = True
            return
        try:
            bits = next(self._transfer)
        except StopIteration:
            return
        # An access of the program can end two kinds of waits. LAST_BIT: the receive register is full; the
        # wait ends early if the program reads that register. None: the wait ends only when the program acts.
        self._waiting = bits in (None, LAST_BIT)
        if bits is not None:
            self._alarm.set(self._ps(bits))

    def _continue(self) -> None:
        if self._waiting:
            self._resume()

    def _on_scl(self, high: bool) -> None:
        if high and self._transfer is not None and not self._alarm.is_set and not self._waiting:
            self._resume()

    def _ps(self, bits: float) -> int:
        return round(bits * self._bit_ps)

    def _end(self) -> None:
        self.busy_ps += self.machine.now_ps - self._begun_ps
        self._transfer = None
        self._stalled = self._waiting = False
        self._on_line = None

    def _abort(self) -> None:
        """Release the bus immediately. A sensor that is within a byte stays at that bit."""
        if self._transfer is None:
            return
        self._alarm.cancel()
        if self._on_line is not None and not self._stalled:
            sending, byte, begun_ps = self._on_line
            bits = (self.machine.now_ps - begun_ps) / self._bit_ps
            if sending and self.registers["SR"] & RXRDY:
                bits = min(bits, LAST_BIT)
            if bits < 8:
                self._lines.cut_off(sending, byte, int(bits))
        self._end()

    def _on_mux_change(self) -> None:
        if self._transfer is not None and any(self._pio.peripheral(bit) != "A" for bit in self._pins):
            transfer = self._transfer
            self._abort()  # the wires are disconnected, but the controller does not notice
            self._transfer, self._begun_ps, self._stalled = transfer, self.machine.now_ps, True

    def _idle(self) -> None:
        self._master = self._slave = self._stale = False
        self._thr = self._remains = None
        self._on_line = None

    def settle_irq(self) -> None:
        """Update the interrupt request, and the copy of the status register that `execution.cpp` reads."""
        self._quick_status.hold(self.registers["SR"], CLEARED_BY_READ)
        super().settle_irq()
