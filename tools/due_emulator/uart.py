"""UART and USARTs as transmitters: holding register, shift register, and the DMA controller (PDC).

Sources: SAM3X datasheet, chapters 34 (UART), 35 (USART) and 26 (PDC). Only transmission is modelled.
"""

from typing import Protocol

from tools.due_emulator.machine import PS_PER_S, Alarm, Machine
from tools.due_emulator.memory_map import Memory
from tools.due_emulator.peripheral import Peripheral

RSTTX, TXEN, TXDIS = 1 << 3, 1 << 6, 1 << 7
TXRDY, ENDTX, TXEMPTY, TXBUFE = 1 << 1, 1 << 4, 1 << 9, 1 << 11
PDC_TXTEN, PDC_TXTDIS, PDC_RXTEN, PDC_RXTDIS = 1 << 8, 1 << 9, 1 << 0, 1 << 1
NO_PARITY = 4
BITS_PER_BYTE = 10
"""Bits of a byte on the wire: start bit, eight data bits and stop bit. No other format is modelled."""
OVERSAMPLING = 16


class Line(Protocol):
    """Destination of transmitted bytes."""

    def send(self, byte: int, at_ps: int, baud: float) -> None:
        """Receive a byte at the end of its stop bit. `at_ps`: time of that end. `baud`: true baud rate."""


# Why more than 12 attributes: each is one register, wire or deadline of the modelled peripheral.
class Transmitter(Peripheral):
    """The transmit side of a UART or USART."""

    def __init__(self, machine: Machine, name: str, memory: Memory, line: Line) -> None:
        super().__init__(machine, name)
        self.status = "SR" if name == "UART" else "CSR"
        self._memory = memory
        self._line = line
        self.bytes_sent = 0
        self.busy_ps = 0
        """Total time for which a byte was on the wire [ps]."""
        self._alarm, self._quiet_alarm = Alarm(machine, self._sent), Alarm(machine, self._sent)
        self._timing_of: tuple[int, int, int] | None = None
        self._baud = 0.0
        self._byte_ps = self._end_ps = 0
        self._clear()

    def _clear(self) -> None:
        self._enabled = False
        self._holding: int | None = None
        self._shifting: int | None = None
        self.registers[self.status] = ENDTX | TXBUFE

    def reset(self) -> None:
        """Switch the transmitter off. A byte that is on the wire is cut off and lost."""
        self._cancel()
        super().reset()
        self._clear()
        self._settle()

    def _cancel(self) -> None:
        self._alarm.cancel()
        self._quiet_alarm.cancel()

    @property
    def baud(self) -> float:
        """Baud rate that the register BRGR sets (SAM3X datasheet, 34.5.1) [baud]."""
        divider = self.field("BRGR", "CD")
        if not divider:
            self.machine.fault(f"{self.name} sends while BRGR.CD is 0: it has no clock")
        if self.name == "UART":
            return self.machine.mck_hz / (OVERSAMPLING * divider)
        oversampling = 8 if self.field("MR", "OVER") else OVERSAMPLING
        return self.machine.mck_hz / (oversampling * (divider + self.field("BRGR", "FP") / 8))

    def on_write(self, register: str, value: int) -> None:
        """Write a register: a command, a byte to send, interrupts, the DMA controller (PDC), or a setting."""
        r = self.registers
        match register:
            case "CR":
                self._command(value)
            case "THR":
                self._hold(value)
            case "PTCR":
                self._control_pdc(value)
            case "TCR" | "TNCR":
                if register == "TNCR" and value and not r["TCR"]:
                    # TCR and TNCR are the lengths of the present block and of the next. If TNCR is written
                    # while TCR is 0, the datasheet does not say whether the next block starts. So no program
                    # may rely on it.
                    self.machine.fault(f"{self.name}_TNCR is written while TCR is 0: write TPR and TCR first")
                r[register] = value & 0xFFFF
                if r[register]:
                    r[self.status] &= ~(ENDTX | TXBUFE)
                self._feed()
            case "BRGR" | "MR" if self._shifting is not None and value != r[register]:
                self.machine.fault(f"{self.name}_{register} is changed while a byte is on the line")
            case _:
                super().on_write(register, value)

    def _command(self, value: int) -> None:
        if value & RSTTX:
            self._cancel()
            self._holding = self._shifting = None
            self._enabled = False
        if value & TXDIS:
            # A byte that is on the wire is still sent completely (SAM3X datasheet, 34.6.1).
            self._enabled = False
        elif value & TXEN:
            self._check_format()
            self._enabled = True
        self._feed()

    def _check_format(self) -> None:
        if self.field("MR", "PAR") != NO_PARITY or self.field("MR", "CHMODE"):
            self.machine.fault(
                f"{self.name}_MR = 0x{self.registers['MR']:X}: the host expects 8N1 (PAR 4, CHMODE 0)"
            )

    def _hold(self, byte: int) -> None:
        if not self._enabled:
            self.machine.fault(f"{self.name}_THR is written while the transmitter is off: the byte is lost")
        if self._holding is not None:
            self.machine.fault(f"{self.name}_THR is written while TXRDY is 0: the byte before it is lost")
        self._holding = byte & 0xFF
        self._feed()

    def _control_pdc(self, value: int) -> None:
        status = self.registers["PTSR"]
        if value & PDC_TXTDIS:
            status &= ~PDC_TXTEN
        elif value & PDC_TXTEN:
            status |= PDC_TXTEN
        if value & PDC_RXTEN and not value & PDC_RXTDIS:
            self.machine.fault(f"{self.name}_PTCR: receiving is not modelled")
        self.registers["PTSR"] = status
        self._feed()

    def _feed(self) -> None:
        """Move bytes from memory to the holding register, and from the holding register to the wire."""
        if self._holding is None:
            self._fetch()
        if self._shifting is None and self._holding is not None and self._enabled:
            self._shifting, self._holding = self._holding, None
            self._settle_timing()
            self._end_ps = self.machine.now_ps + self._byte_ps
            self._fetch()
        if self._shifting is not None:
            self._await_end()
        self._settle()

    def _await_end(self) -> None:
        """Set alarms for the end of this byte, and for the next end of a byte that changes a status flag.

        Within a block that the DMA controller (PDC) sends, most bytes end without such a change.
        """
        left_ps, more = self._end_ps - self.machine.now_ps, 0
        if self._is_amid_a_block():
            self._quiet_alarm.set(left_ps, quiet=True)
            more = self.registers["TCR"] - 1
        self._alarm.set(left_ps + more * self._byte_ps)

    def _settle_timing(self) -> None:
        """Update the duration of a byte; settings cannot change while a byte is on the wire."""
        settings = self.machine.mck_hz, self.registers["BRGR"], self.registers["MR"]
        if settings != self._timing_of:
            self._check_format()
            self._baud = self.baud
            self._byte_ps = round(BITS_PER_BYTE * PS_PER_S / self._baud)
            self._timing_of = settings

    def _fetch(self) -> None:
        r = self.registers
        if self._holding is not None or not self._enabled or not r["PTSR"] & PDC_TXTEN or not r["TCR"]:
            return
        self._holding = self._take()
        if not r["TCR"]:
            r[self.status] |= ENDTX
            r["TPR"], r["TCR"] = r["TNPR"], r["TNCR"]
            r["TNCR"] = 0
            if not r["TCR"]:
                r[self.status] |= TXBUFE

    def _take(self) -> int:
        """Let the DMA controller (PDC) read the next byte from memory; return it."""
        r = self.registers
        byte = self._memory.read(r["TPR"], 1)
        if byte is None:
            self.machine.fault(f"{self.name}: the PDC reads at 0x{r['TPR']:08X}, where there is no memory")
        r["TPR"] += 1
        r["TCR"] -= 1
        return byte[0]

    def _sent(self) -> None:
        assert self._shifting is not None
        byte, self._shifting = self._shifting, None
        self.bytes_sent += 1
        self.busy_ps += self._byte_ps
        self._line.send(byte, self.machine.now_ps, self._baud)
        if self._is_amid_a_block():
            self._shifting, self._holding = self._holding, self._take()
            self._end_ps += self._byte_ps
            if self.registers["TCR"] > 1:
                self._quiet_alarm.set(self._byte_ps, quiet=True)
        else:
            self._feed()

    def _is_amid_a_block(self) -> bool:
        """Return whether the DMA controller (PDC) has at least two more bytes of its block to send.

        The end of the byte on the wire then changes no status flag.
        """
        r = self.registers
        return self._holding is not None and self._enabled and r["TCR"] > 1 and r["PTSR"] & PDC_TXTEN != 0

    def _settle(self) -> None:
        r = self.registers
        ready = self._enabled and self._holding is None
        empty = ready and self._shifting is None
        flags = TXRDY * ready | TXEMPTY * empty
        r[self.status] = r[self.status] & ~(TXRDY | TXEMPTY) | flags
        self.settle_irq()
