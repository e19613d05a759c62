"""The Arduino Due with a sensor on its I2C pins: its parts, their wiring, and the kinds of reset."""

import hashlib
from collections.abc import Callable

from tools.due_emulator.bridge import Bridge, seconds_to_ps
from tools.due_emulator.bus import Bus
from tools.due_emulator.cpu import Cpu
from tools.due_emulator.flash_controller import FlashController
from tools.due_emulator.i2c_lines import I2cLines
from tools.due_emulator.machine import PS_PER_US, Machine
from tools.due_emulator.memory_map import Memory
from tools.due_emulator.mpu9250 import Mpu9250
from tools.due_emulator.noise import World
from tools.due_emulator.nvic import Nvic
from tools.due_emulator.peripheral import Peripheral
from tools.due_emulator.pio import Pio
from tools.due_emulator.pmc import Pmc
from tools.due_emulator.register_file import PLAIN, RegisterFile
from tools.due_emulator.reset_controller import ResetController, ResetType
from tools.due_emulator.sensor_socket import SensorSocket
from tools.due_emulator.system_control import SystemControl
from tools.due_emulator.timers import Timer
from tools.due_emulator.trng import Trng
from tools.due_emulator.twi import Twi
from tools.due_emulator.uart import Line, Transmitter
from tools.due_emulator.watchdog import Watchdog

TWD0, TWCK0 = 17, 18
TWD1, TWCK1 = 12, 13
DATA_READY = 25
UTXD = 9
OPENING_PS = 205_000 * PS_PER_US
"""Time for which the bridge between USB and UART holds the board in reset when the host opens the serial
port. The value comes from the hardware notes of the project.
"""
RESET_PS = 100 * PS_PER_US
"""Duration of a reset that the microcontroller itself causes. The value is a round number of at least three
cycles of the slow clock.
"""


class _Nowhere:
    """A pin without a connection."""

    def send(self, byte: int, at_ps: int, baud: float) -> None:
        pass


class _SerialPin:
    """Connection from the UART's output pin UTXD to the bridge between UART and USB.

    The program has to assign this pin to the UART.
    """

    def __init__(self, pio: Pio, line: Line) -> None:
        self._pio = pio
        self._line = line

    def send(self, byte: int, at_ps: int, baud: float) -> None:
        if self._pio.peripheral(UTXD) != "A":
            self._pio.machine.fault("the UART sends, but pin PA9 is not given to it (PIOA_PDR, PIOA_ABSR)")
        self._line.send(byte, at_ps, baud)


# Why more than 12 attributes: each is one part of the board in its circuit diagram.
class Board:
    """A Due that has been connected to power; `run_until` runs it.

    `seed`: seed of all random values; equal seeds give equal runs. `world`: the motion that the sensor
    measures. The bytes that the board sends are passed to `bridge.deliver`.
    """

    def __init__(self, image: bytes, *, seed: int, world: World) -> None:
        self.seed = seed
        self.machine = machine = Machine()
        self.memory = Memory()
        self.memory.program(image)
        self.events: list[str] = []
        """Events of the run that the report shows, such as resets by the watchdog."""
        self.resets = 0
        self.on_reset: Callable[[ResetType], None] = lambda cause: None
        """Function that is called at each start of the chip except the first."""
        self.bridge = Bridge(machine, seed)
        self.socket = SensorSocket(machine, Mpu9250(world))
        self.lines = I2cLines(machine, self.socket)
        uid = hashlib.sha256(f"due {seed}".encode()).digest()[:16]
        self.flash_controllers = [FlashController(machine, n, self.memory, uid) for n in range(2)]
        self.pmc = Pmc(machine, self._check_flash)
        self.watchdog = Watchdog(machine, lambda: self._on_chip_reset(ResetType.WATCHDOG))
        self.reset_controller = ResetController(machine, lambda: self._on_chip_reset(ResetType.SOFTWARE))
        self.pios = {name: Pio(machine, name) for name in ("PIOA", "PIOB", "PIOC", "PIOD")}
        self.uart = Transmitter(machine, "UART", self.memory, _SerialPin(self.pios["PIOA"], self.bridge))
        self.twi = Twi(machine, "TWI1", self.lines, self.pios["PIOB"], (TWD1, TWCK1))
        self.peripherals = self._all_peripherals()
        self._solder()
        bus = Bus(machine)
        for peripheral in self.peripherals:
            bus.add(peripheral)
        nvic = Nvic(machine)
        machine.on_irq = nvic.set_line
        self.system_control = SystemControl(machine, nvic, lambda: self._on_chip_reset(ResetType.SOFTWARE))
        self.cpu = Cpu(machine, self.memory, bus, nvic, self.system_control)
        for controller in self.flash_controllers:
            controller.pc = lambda: self.cpu.pc
        self._powered_up = 0
        self._power_up()

    def _all_peripherals(self) -> list[Peripheral]:
        m, nowhere = self.machine, _Nowhere()
        empty_bus = I2cLines(m, None, pull_ups=False)
        return [
            self.pmc,
            *self.flash_controllers,
            self.watchdog,
            self.reset_controller,
            *self.pios.values(),
            self.uart,
            *(Transmitter(m, f"USART{n}", self.memory, nowhere) for n in range(4)),
            Twi(m, "TWI0", empty_bus, self.pios["PIOA"], (TWD0, TWCK0)),
            self.twi,
            *(Timer(m, f"TC{n}") for n in range(3)),
            Trng(m, self.seed),
            *(RegisterFile(m, name) for name in PLAIN),
        ]

    def _solder(self) -> None:
        pio = self.pios["PIOB"]
        pio.connect(TWD1, self.lines.sda)
        pio.connect(TWCK1, self.lines.scl)
        pio.connect(DATA_READY, self.socket.int_wire)

    def run_until(self, at_s: float) -> None:
        """Run until a point in virtual time [s].

        Raises:
            EmulationFault: the program did what the real board does not tolerate.
        """
        self.cpu.run_until(seconds_to_ps(at_s))

    @property
    def now_s(self) -> float:
        """Virtual time since power-up [s]."""
        return self.machine.now_ps / seconds_to_ps(1)

    def reset(self, cause: ResetType, hold_ps: int = RESET_PS) -> None:
        """Reset the chip; RAM and sensor keep their state."""
        self.resets += 1
        self.on_reset(cause)
        for peripheral in self.peripherals:
            peripheral.reset()
        self.reset_controller.restarted(cause)
        self.system_control.reset()
        self.cpu.restart(hold_ps)

    # Faults: tools.due_emulator.faults calls these methods

    def brown_out(self) -> None:
        """Let the supply voltage sag.

        The processor restarts with random contents of RAM; the sensor keeps running.
        """
        self._power_up()
        self.resets += 1
        self.events.append(f"board brown-out at {self.now_s:.3f} s")

    def reopen_port(self) -> None:
        """Let the host open the serial port, which resets the board as its reset button does."""
        self.bridge.forget()
        self.reset(ResetType.USER, OPENING_PS)

    def starve(self, for_s: float) -> None:
        """Let the program hang for a time [s]; interrupts stay pending meanwhile."""
        self.cpu.hang(seconds_to_ps(for_s))

    def _power_up(self) -> None:
        self.memory.lose_power(self.seed + self._powered_up)
        self._powered_up += 1
        self.reset(ResetType.POWER_UP)
        self.resets -= 1

    def _check_flash(self, mck_hz: int) -> None:
        for controller in self.flash_controllers:
            controller.check(mck_hz)

    def _on_chip_reset(self, cause: ResetType) -> None:
        if cause is ResetType.WATCHDOG:
            self.events.append(f"watchdog: the program did not feed it; reset at {self.now_s:.3f} s")
        self.reset(cause)
