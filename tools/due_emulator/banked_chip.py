"""The common part of emulated chips whose registers hold plain numbers. The registers may be in banks.

Each kind of chip is a subclass. It defines the facts of its data sheet, and three methods: for reading and
for writing its special registers, and for measuring.
"""

from collections.abc import Mapping

from tools.due_emulator.chip import Chip
from tools.due_emulator.noise import World


# Why more than 12 attributes: each is one fact of a data sheet, or a register that these chips have.
class BankedChip(Chip):
    """A chip that was powered on long before time 0. Its subclass defines these facts of the data sheet.

    `quiet_ns`: time after power-up or reset in which the chip does not acknowledge [ns]. `ready_ns`: time in
    which written settings are lost [ns]. `fifo_bytes`: capacity of the FIFO. `reset_values`: values of
    registers after a reset, if not 0. `writable`: writable bits of each register that can be written.
    `bank_select`, `bank_shift`, `bank_mask`: register that selects the bank, position of the bank's number in
    it, and mask of the number; a chip without banks has a `bank_select` of None. The address of a register is
    its number plus 256 times its bank.

    `world`: object that says how the sensor moves at a given time.
    """

    quiet_ns: int
    ready_ns: int
    fifo_bytes: int
    reset_values: Mapping[int, int]
    writable: Mapping[int, int]
    bank_select: int | None = None
    bank_shift = 0
    bank_mask = 0

    def __init__(
        self, world: World, *, address: int = 0x68, clock_ppm: float = 0.0, fifo_bytes: int | None = None
    ) -> None:
        super().__init__(address, clock_ppm)
        self.world = world
        self.fifo.size = self.fifo_bytes if fifo_bytes is None else fifo_bytes
        self.bank = self._status = 0
        self._output = bytes(14)
        self._registers: dict[int, int] = {}
        self._restore()

    # Methods that a subclass (one for each kind of chip) has to define, as well as `output_hz` of `Chip`

    def _load_special(self, register: int) -> int | None:
        """Return the value of a register that is more than a stored number; None for other registers."""
        raise NotImplementedError

    def _store_special(self, register: int, value: int) -> bool:
        """Do what a write to this register causes (such as a reset), apart from storing the value.

        Return True if the value must not be stored.
        """
        raise NotImplementedError

    def _convert(self, at_ns: int) -> None:
        """Measure the sensor's motion (`_motion`), and write it to the output registers and the FIFO."""
        raise NotImplementedError

    # Time and power

    def advance(self, now_ns: int) -> None:
        if self._ready_at_ns is not None and self._ready_at_ns <= now_ns:
            self._now_ns = self._ready_at_ns
            self._restore()
        self._now_ns = now_ns
        while (at_ns := self._next_update_ns()) is not None and at_ns <= now_ns:
            self._updates += 1
            self._convert(at_ns)

    @property
    def is_up(self) -> bool:
        """Whether the chip has power, and its last reset has ended."""
        return self.powered and self._ready_at_ns is None

    def power_on(self) -> None:
        self.powered = True
        self._reset()

    def _reset(self) -> None:
        self._begin(self.quiet_ns, self.ready_ns)

    def _restore(self) -> None:
        self._ready_at_ns = None
        self._quiet_until_ns = 0
        self._registers = dict(self.reset_values)
        self.bank = self._status = 0
        self.fifo.clear()
        self._output = bytes(14)
        self._selected = False
        self._start_clock()

    # Registers

    def register(self, register: int) -> int:
        return self._registers.get(register, 0)

    def spoil(self, register: int, value: int) -> None:
        self._registers[register] = value

    @property
    def _register(self) -> int:
        return self._pointer if self._pointer == self.bank_select else self.bank << 8 | self._pointer

    def _load(self, register: int) -> int:
        if register == self.bank_select:
            return self.bank << self.bank_shift
        value = self._load_special(register)
        return self.register(register) if value is None else value

    def _store(self, register: int, value: int) -> None:
        if register == self.bank_select:
            self.bank = value >> self.bank_shift & self.bank_mask
        elif not self._store_special(register, value):
            before = self.output_hz
            self._registers[register] = value & self.writable.get(register, 0)
            if self.output_hz != before:
                self._start_clock()
