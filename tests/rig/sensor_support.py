"""Emulate a small board with the sensor on TWI1; tests access its registers by plain calls."""

from tools.due_emulator.i2c_lines import I2cLines
from tools.due_emulator.machine import Machine
from tools.due_emulator.mpu9250 import Mpu9250
from tools.due_emulator.noise import Constant
from tools.due_emulator.pio import Pio
from tools.due_emulator.sensor_socket import SensorSocket
from tools.due_emulator.twi import Twi

US = 1_000_000
"""Picoseconds in a microsecond."""
PIOB_ID, TWI1_ID = 12, 23
SDA_BIT, SCL_BIT, INT_BIT, LED_BIT = 12, 13, 25, 27
SDA, SCL = 1 << SDA_BIT, 1 << SCL_BIT
START, STOP, MSEN, SWRST = 0x01, 0x02, 0x04, 0x80
TXCOMP, RXRDY, TXRDY, NACK = 0x001, 0x002, 0x004, 0x100
SPEED_400K = 101 << 8 | 101


class SmallBoard:
    """An emulated microcontroller with the sensor wired to its peripherals PIOB and TWI1.

    The clocks of the microcontroller run. Nothing else is set up.
    """

    def __init__(self, world=None):
        self.machine = Machine()
        self.machine.set_mck(84_000_000)
        self.machine.clocked = 1 << PIOB_ID | 1 << TWI1_ID
        self.irqs: dict[int, bool] = {}
        self.machine.on_irq = self.irqs.__setitem__
        self.chip = Mpu9250(world or Constant((1.0, -2.0, 3.0)))
        self.socket = SensorSocket(self.machine, self.chip)
        self.lines = I2cLines(self.machine, self.socket)
        self.pio = Pio(self.machine, "PIOB")
        self.pio.connect(SDA_BIT, self.lines.sda)
        self.pio.connect(SCL_BIT, self.lines.scl)
        self.pio.connect(INT_BIT, self.socket.int_wire)
        self.twi = Twi(self.machine, "TWI1", self.lines, self.pio, (SDA_BIT, SCL_BIT))

    def set_up(self):
        """Connect the pins to TWI1 (as "peripheral A" of the pins), and make TWI1 a master at 400 kHz."""
        self.pio.write("PDR", SDA | SCL)
        self.twi.write("CR", SWRST)
        self.twi.write("CR", MSEN)
        self.twi.write("CWGR", SPEED_400K)
        return self

    def wait_us(self, us):
        self.machine.advance(round(us * US))

    def wait_for(self, flag, limit_us=2000):
        """Poll the status register of TWI1 until `flag` is set.

        Return all status flags that were seen meanwhile, or None if `flag` was not set within the limit.
        """
        seen = 0
        for _ in range(limit_us * 2):
            seen |= self.twi.read("SR")
            if seen & flag:
                return seen
            self.wait_us(0.5)
        return None

    def address(self, register, read, device=0x68):
        self.twi.write("MMR", device << 16 | 1 << 8 | read << 12)
        self.twi.write("IADR", register)

    def begin_read(self, register, command, device=0x68):
        self.address(register, True, device)
        self.twi.write("CR", command)

    def begin_write(self, register, value):
        self.address(register, False)
        self.twi.write("THR", value)
        self.twi.write("CR", STOP)

    def read_block(self, register, n):
        """Read n registers as the SAM3X datasheet describes it in section 33.8.5.

        STOP is set after the next-to-last byte.
        """
        self.begin_read(register, START | (STOP if n == 1 else 0))
        data: list[int] = []
        while len(data) < n:
            if (seen := self.wait_for(RXRDY | NACK)) is None or seen & NACK:
                return None
            if len(data) == n - 2:
                self.twi.write("CR", STOP)
            data.append(self.twi.read("RHR"))
        return bytes(data) if self.wait_for(TXCOMP) else None

    def write_register(self, register, value):
        self.begin_write(register, value)
        seen = self.wait_for(TXCOMP)
        return seen is not None and not seen & NACK

    # Bit-banging with open drain: a wire is low when its pin is an output at 0, and high when the pin is an
    # input.

    def take_pins(self):
        self.pio.write("CODR", SDA | SCL)
        self.pio.write("ODR", SDA | SCL)
        self.pio.write("PER", SDA | SCL)

    def line(self, pin, high, us=1.5):
        self.pio.write("ODR" if high else "OER", pin)
        self.wait_us(us)

    def clock(self, us=1.5):
        self.line(SCL, False, us)
        self.line(SCL, True, us)

    def send_stop(self):
        self.line(SCL, False)
        self.line(SDA, False)
        self.line(SCL, True)
        self.line(SDA, True)

    def send_byte(self, byte):
        """Send eight bits; return the acknowledge bit of the sensor."""
        for i in range(8):
            self.line(SCL, False)
            self.line(SDA, bool(byte >> (7 - i) & 1))
            self.line(SCL, True)
        self.line(SCL, False)
        self.line(SDA, True)
        self.line(SCL, True)
        return not self.sda()

    def receive_byte(self, ack):
        byte = 0
        for _ in range(8):
            self.clock()
            byte = byte << 1 | self.sda()
        self.line(SCL, False)
        self.line(SDA, not ack)
        self.line(SCL, True)
        self.line(SCL, False)
        self.line(SDA, True)
        return byte

    def sda(self):
        return bool(self.pio.read("PDSR") & SDA)
