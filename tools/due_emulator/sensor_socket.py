"""The socket into which the sensor is plugged: its supply, its INT pin, and its clock."""

from tools.due_emulator.machine import Alarm, Machine
from tools.due_emulator.mpu9250 import Mpu9250
from tools.due_emulator.wire import Wire

PS_PER_NS = 1000


class SensorSocket:
    """A sensor chip in its socket, with the faults of a loose plug or a bad contact.

    The bus calls `start`, `write`, `read` and `stop` as it would call those of the chip.
    """

    def __init__(self, machine: Machine, chip: Mpu9250) -> None:
        self.machine = machine
        self.chip = chip
        self.int_wire = Wire(machine, "the sensor's INT pin")
        self.nacks_left = 0
        """Number of bytes, from the next one on, that the sensor will not acknowledge."""
        self.nack_until_ps = 0
        """Time until which no byte is acknowledged [ps]."""
        self._alarm = Alarm(machine, self._on_event)
        chip.on_int = lambda level, at_ns: self.int_wire.drive("sensor", level)
        self.int_wire.drive("sensor", False)
        self.settle()

    def start(self, address: int, read: bool) -> bool:
        """Send START and address; return whether the sensor acknowledges."""
        self._catch_up()
        ack = self.chip.start(address, read) and not self._refuses()
        self.settle()
        return ack

    def write(self, byte: int) -> bool:
        """Write a byte; return whether the sensor acknowledges.

        A byte that is not acknowledged does not reach the sensor.
        """
        self._catch_up()
        ack = not self._refuses() and self.chip.write(byte)
        self.settle()
        return ack

    def read(self, ack: bool) -> int:
        """Read a byte; 0xFF, the idle level, if no chip answers."""
        self._catch_up()
        value = self.chip.read(ack)
        self.settle()
        return value

    def stop(self) -> None:
        """Send STOP to the sensor."""
        self._catch_up()
        self.chip.stop()
        self.settle()

    def unplug(self) -> None:
        """Unplug the sensor, which loses its supply."""
        self._catch_up()
        self.chip.power_off()
        self.int_wire.drive("sensor", None)
        self.settle()

    def plug(self, who_am_i: int | None = None) -> None:
        """Plug in the sensor, or another sensor with this `who_am_i`, which then powers up."""
        self._catch_up()
        self.int_wire.drive("sensor", False)
        self.chip.power_on(who_am_i)
        self.settle()

    def become(self, who_am_i: int) -> None:
        """Make the sensor one with another `who_am_i`, as if it had always been there."""
        self.chip.become(who_am_i)
        self.settle()

    def brown_out(self) -> None:
        """Set the sensor's registers to their reset values, while it keeps running."""
        self._catch_up()
        self.chip.brown_out()
        self.settle()

    def set_clock_ppm(self, ppm: float) -> None:
        """Change the rate of the sensor's own clock."""
        self._catch_up()
        self.chip.clock_ppm = ppm
        self.settle()

    def settle(self) -> None:
        """Set the alarm for the next time at which the sensor's INT pin can change."""
        self._alarm.cancel()
        at_ns = self.chip.next_event_ns()
        if at_ns is not None:
            self._alarm.set(at_ns * PS_PER_NS - self.machine.now_ps)

    def _on_event(self) -> None:
        self._catch_up()
        self.settle()

    def _catch_up(self) -> None:
        self.chip.advance(self.machine.now_ps // PS_PER_NS)

    def _refuses(self) -> bool:
        if self.nacks_left:
            self.nacks_left -= 1
            return True
        return self.machine.now_ps < self.nack_until_ps
