"""The wires SDA and SCL between the Due and the sensor, and which of the two holds which wire low.

If the program drives the wires itself (bit-banging), every edge is modelled.

The Due's I²C controller (TWI) transfers whole bytes, for speed; its clock edges are not on the wires. If a
transfer is cut off within a byte, the sensor stays in the middle of that byte, holds SDA low if its present
bit is a 0, and releases SDA only after further clock edges (NXP's I²C-bus specification UM10204, 3.1.16).
"""

from enum import Enum, auto

from tools.due_emulator.machine import Machine
from tools.due_emulator.sensor_socket import SensorSocket
from tools.due_emulator.wire import Wire

FASTEST_HZ = 400_000
"""Clock rate of I²C's fast mode, which is the highest rate that the sensor supports (MPU-9250 product
specification, 3.5).
"""
TOLERANCE = 0.01
SHORTEST_PERIOD_PS = round(1e12 / (FASTEST_HZ * (1 + TOLERANCE)))


class Phase(Enum):
    """What the sensor expects next on the bus."""

    IDLE = auto()
    ADDRESS = auto()
    RECEIVE = auto()
    SEND = auto()
    IGNORE = auto()


# Why more than 12 attributes: each is one wire, or one state of the transfer on the two wires.
class I2cLines:
    """The wires SDA and SCL with the sensor at one end.

    If `socket` is None, there is no sensor, only pull-ups.

    SDA is the wire `sda`, SCL the wire `scl`; the Due's pin controllers (PIO) drive both like any other wire.
    """

    def __init__(self, machine: Machine, socket: SensorSocket | None, pull_ups: bool = True) -> None:
        self.machine = machine
        self.socket = socket
        self.sda = Wire(machine, "SDA")
        self.scl = Wire(machine, "SCL")
        for wire in (self.sda, self.scl):
            wire.pull_up("the board", pull_ups)
        self.sda.listen(self._on_sda)
        self.scl.listen(self._on_scl)
        self.clocks_without_stop = 0
        """Number of rising edges of SCL since the last STOP. A program that bit-bangs must end with a
        STOP.
        """
        self.recovery_clocks = 0
        """Total number of rising edges of SCL. The controller TWI makes none on these wires, so these are
        pulses that the program makes itself, mostly to free a stuck bus.
        """
        self._phase = Phase.IDLE
        self._bits = 0
        self._shift = 0
        self._acked = False
        self._rise_ps: int | None = None
        self._stuck_clocks = 0
        self._sensor_moves = False

    # Transfers by the controller TWI, in whole bytes

    def take(self, controller: str) -> None:
        """Let a controller begin a transfer.

        The run ends with an error if the program itself has made pulses on SCL (bit-banging) and no STOP
        after them.
        """
        if self.clocks_without_stop:
            self.machine.fault(
                f"{controller} starts after {self.clocks_without_stop} clocks by PIO that no STOP ended: "
                "raise SDA while SCL is high before the TWI takes over"
            )
        self._phase = Phase.IDLE
        self._hold(False)

    def start(self, address: int, read: bool) -> bool:
        """Let the controller send START and an address; return whether the sensor acknowledges."""
        return self.socket is not None and self.socket.start(address, read)

    def write(self, byte: int) -> bool:
        """Let the controller write a byte; return whether the sensor acknowledges."""
        return self.socket is not None and self.socket.write(byte)

    def read(self, ack: bool) -> int:
        """Let the controller read a byte."""
        return self.socket.read(ack) if self.socket is not None else 0xFF

    def stop(self) -> None:
        """Let the controller send STOP."""
        if self.socket is not None:
            self.socket.stop()

    def cut_off(self, sending: bool, byte: int, bits: int) -> None:
        """Set the wires' state after a controller has stopped in the middle of a byte and has left SCL high.

        `bits` (0 to 7): number of the byte's bits that were complete when the controller stopped.

        If the sensor was sending the byte, and the bit after these is a 0, the sensor holds SDA low.
        """
        if self.socket is None or not self.socket.chip.powered:
            return
        self._shift = byte if sending else byte >> (7 - bits)
        self._phase = Phase.SEND if sending else Phase.RECEIVE
        self._bits = bits + 1
        self._hold(sending and not byte >> (7 - bits) & 1)

    # Faults of wires and sensor

    def hold_sda(self, clocks: int = 0) -> None:
        """Let a stuck sensor hold SDA low for `clocks` rising edges of SCL.

        If `clocks` is 0, the sensor holds SDA until `release_sda` is called.
        """
        self._stuck_clocks = clocks
        self._move(self.sda, "a stuck sensor", False)

    def release_sda(self) -> None:
        """Let the stuck sensor release SDA; if SCL is high, the rising edge of SDA is a STOP on the wires."""
        self._stuck_clocks = 0
        self.sda.drive("a stuck sensor", None)

    def hold_scl(self) -> None:
        """Hold SCL low, like a sensor that stretches the clock forever."""
        self._move(self.scl, "a stuck sensor", False)

    def release_scl(self) -> None:
        """Release SCL, which `hold_scl` held low."""
        self._move(self.scl, "a stuck sensor", None)

    def unplug(self) -> None:
        """Unplug the sensor: it holds no wire any more."""
        self._phase = Phase.IDLE
        self._hold(False)
        self.release_sda()
        self.release_scl()
        if self.socket is not None:
            self.socket.unplug()

    # What the sensor does on the wires

    def _on_scl(self, high: bool) -> None:
        if self._sensor_moves:
            return
        if high:
            self._check_period()
            self.clocks_without_stop += 1
            self.recovery_clocks += 1
            self._count_stuck()
            self._sample()
        else:
            self._shift_out()

    def _check_period(self) -> None:
        now_ps = self.machine.now_ps
        if self._rise_ps is not None and now_ps - self._rise_ps < SHORTEST_PERIOD_PS:
            period_us = (now_ps - self._rise_ps) / 1e6
            self.machine.fault(
                f"SCL clocked by PIO every {period_us:.3f} us: the sensor takes 2.5 us (400 kHz)"
            )
        self._rise_ps = now_ps

    def _count_stuck(self) -> None:
        if self._stuck_clocks:
            self._stuck_clocks -= 1
            if not self._stuck_clocks:
                self._move(self.sda, "a stuck sensor", None)

    def _sample(self) -> None:
        if self._phase in (Phase.ADDRESS, Phase.RECEIVE) and self._bits < 8:
            self._shift = (self._shift << 1 | self.sda.level) & 0xFF
        elif self._phase is Phase.SEND and self._bits == 8:
            self._acked = not self.sda.level
        self._bits += 1

    def _shift_out(self) -> None:
        if self._phase is Phase.SEND:
            if self._bits < 8:
                self._hold(not self._shift >> (7 - self._bits) & 1)
            elif self._bits == 8:
                self._hold(False)
            elif self._acked:
                self._load()
            else:
                self._phase = Phase.IGNORE
        elif self._phase in (Phase.ADDRESS, Phase.RECEIVE):
            if self._bits == 8:
                self._acknowledge()
            elif self._bits > 8:
                self._hold(False)
                self._bits = 0
                if self._phase is Phase.ADDRESS:
                    self._after_address()

    def _acknowledge(self) -> None:
        if self._phase is Phase.ADDRESS:
            acked = self.start(self._shift >> 1, bool(self._shift & 1))
        else:
            acked = self.write(self._shift)
        if acked:
            self._hold(True)
        else:
            self._phase = Phase.IGNORE

    def _after_address(self) -> None:
        if self._shift & 1:
            self._load()
        else:
            self._phase = Phase.RECEIVE

    def _load(self) -> None:
        self._phase = Phase.SEND
        self._shift = self.read(True)
        self._bits = 0
        self._hold(not self._shift >> 7)

    def _on_sda(self, high: bool) -> None:
        if not self.scl.level or self._sensor_moves:
            return
        if high:
            self._phase = Phase.IDLE
            self.clocks_without_stop = 0
            self._rise_ps = None
            self.stop()
        else:
            self._phase = Phase.ADDRESS
            self._bits = self._shift = 0

    def _hold(self, low: bool) -> None:
        self._move(self.sda, "the sensor", False if low else None)

    def _move(self, wire: Wire, who: str, level: bool | None) -> None:
        """Drive a wire from the sensor's side.

        A change from the sensor's side is not counted as a clock edge, START or STOP.
        """
        self._sensor_moves = True
        wire.drive(who, level)
        self._sensor_moves = False
