"""The Power Management Controller: oscillators, PLLs, the master clock, peripheral clocks.

Source: SAM3X datasheet, chapter 28. The main oscillator has the board's 12 MHz crystal.
"""

from collections.abc import Callable

from tools.due_emulator.machine import PS_PER_S, SLOW_CLOCK_HZ, Alarm, Machine
from tools.due_emulator.peripheral import Peripheral

CRYSTAL_HZ = 12_000_000
RC_HZ = (4_000_000, 8_000_000, 12_000_000)
CRYSTAL_COUNT, PLLA_COUNT = 8, 0x3F
"""Shortest start-up counts of the board's crystal and of the PLL, from the vendor's code (system_sam3xa.c).

The crystal's count is in units of 8 periods of the slow clock. The PLL's count is in single periods. The true
start-up times differ from board to board.
"""
MCK_MAX_HZ = 84_000_000
PLLA_OUTPUT_HZ = (96_000_000, 192_000_000)
"""Allowed range of the PLL's output (SAM3X datasheet, 45.5, as other texts quote it)."""
UPLL_HZ = 480_000_000
KEY, WP_KEY = 0x37, 0x50_4D43
CLOCKED_IDS = (1 << 45) - (1 << 8)
"""Bits of the peripherals whose clock can be switched: identifiers 8 to 44 (SAM3X datasheet, 9.1, as other
texts quote it).
"""
CSS_SLOW, CSS_MAIN, CSS_PLLA, CSS_UPLL = range(4)
MOSCXTS, LOCKA, MCKRDY, LOCKU, MOSCSELS, MOSCRCS = (1 << bit for bit in (0, 1, 3, 6, 16, 17))
PCKRDY = 0x700
SELECT_PS = 2_000_000
"""Time in which the chip switches to another clock source: a round number, since the datasheet gives none."""
PLLAR_ONE = 1 << 29


class Pmc(Peripheral):
    """The clocks of the chip. The program sets them up, and each clock needs some time until it is ready.

    `check_flash`: called with the new master clock before each change; it ends the run if the flash is too
    slow for that clock.
    """

    status = "SR"

    def __init__(self, machine: Machine, check_flash: Callable[[int], None]) -> None:
        self._check_flash = check_flash
        self._events: dict[int, Alarm] = {}
        super().__init__(machine, "PMC")
        self.reset()

    def reset(self) -> None:
        """Select the fast RC oscillator at 4 MHz, and switch all peripheral clocks off."""
        for event in self._events.values():
            event.cancel()
        self._events.clear()
        super().reset()
        self.registers["SR"] |= MOSCRCS
        self.machine.clocked = 0
        self.settle_irq()
        self.machine.set_mck(RC_HZ[0])

    def on_write(self, register: str, value: int) -> None:
        """Write a register. Check first the value's key, the order of writes and the state of the clocks."""
        r = self.registers
        match register:
            case "PCER0" | "PCER1" | "PCDR0" | "PCDR1":
                shift = 32 * int(register[-1])
                if register.startswith("PCER") and value << shift & ~CLOCKED_IDS:
                    self.machine.fault(f"PMC_{register} = 0x{value:08X} names peripherals that do not exist")
                bits = value << shift
                clocked = self.machine.clocked
                self.machine.clocked = clocked | bits if register.startswith("PCER") else clocked & ~bits
                r["PCSR0"], r["PCSR1"] = self.machine.clocked & 0xFFFF_FFFF, self.machine.clocked >> 32
            case "SCER":
                r["SCSR"] |= value
                r["SR"] |= value & PCKRDY
            case "SCDR":
                r["SCSR"] &= ~value | 1
                r["SR"] &= ~(value & PCKRDY)
            case "CKGR_MOR":
                self._set_oscillators(value)
            case "CKGR_PLLAR":
                self._set_plla(value)
            case "CKGR_UCKR":
                self._set_upll(value)
            case "MCKR":
                self._set_master_clock(value)
            case "WPMR" if value >> 8 != WP_KEY:
                self.machine.fault(f"PMC_WPMR = 0x{value:08X} without its key 0x504D43: the chip ignores it")
            case "WPMR" if value & 1:
                self.machine.fault("PMC_WPMR: write protection is not modelled")
            case _:
                super().on_write(register, value)

    def on_read(self, register: str) -> int:
        """Read a register.

        A read of CKGR_MCFR returns the measured frequency of the main clock; the measurement is always ready.
        All other reads return the stored value.
        """
        if register == "CKGR_MCFR":
            return 1 << 16 | self._main_hz() * 16 // SLOW_CLOCK_HZ
        return self.registers[register]

    def _set_oscillators(self, value: int) -> None:
        r, old = self.registers, self.registers["CKGR_MOR"]
        if value >> 16 & 0xFF != KEY:
            self.machine.fault(f"PMC_CKGR_MOR = 0x{value:08X} without its key 0x37: the chip ignores it")
        r["CKGR_MOR"] = value & ~self.mask("CKGR_MOR", "KEY")
        rc_on = bool(self.field("CKGR_MOR", "MOSCRCEN"))
        if not rc_on:
            self._not_ready(MOSCRCS)
        elif (value ^ old) & self.mask("CKGR_MOR", "MOSCRCF") or not (r["SR"] & MOSCRCS):
            self._not_ready(MOSCRCS)
            self._ready_in(MOSCRCS, SELECT_PS, self._take_master_clock)
        if not self.field("CKGR_MOR", "MOSCXTEN"):
            self._not_ready(MOSCXTS)
        elif not r["SR"] & MOSCXTS and MOSCXTS not in self._events:
            self._ready_in(MOSCXTS, self._start_up_ps("CKGR_MOR", "MOSCXTST", CRYSTAL_COUNT, 8))
        select = self.mask("CKGR_MOR", "MOSCSEL")
        if value & select and not r["SR"] & MOSCXTS:
            self.machine.fault("PMC_CKGR_MOR selects the crystal before it is ready: wait for PMC_SR.MOSCXTS")
        if not value & select and not rc_on:
            self.machine.fault("PMC_CKGR_MOR stops the RC oscillator that the chip runs on")
        if (value ^ old) & select:
            self._not_ready(MOSCSELS)
            self._ready_in(MOSCSELS, SELECT_PS, self._take_master_clock)

    def _set_plla(self, value: int) -> None:
        if not value & PLLAR_ONE:
            self.machine.fault(f"PMC_CKGR_PLLAR = 0x{value:08X}: bit 29 has to be 1")
        if self.registers["MCKR"] & 3 == CSS_PLLA:
            self.machine.fault("PMC_CKGR_PLLAR is written while the master clock comes from PLLA")
        self.registers["CKGR_PLLAR"] = value
        self._not_ready(LOCKA)
        hz = self._plla_hz()
        if hz:
            if not PLLA_OUTPUT_HZ[0] <= hz <= PLLA_OUTPUT_HZ[1]:
                self.machine.fault(f"PLLA is set to {hz / 1e6:g} MHz: it gives 96 to 192 MHz")
            self._ready_in(LOCKA, self._start_up_ps("CKGR_PLLAR", "PLLACOUNT", PLLA_COUNT, 1))

    def _start_up_ps(self, register: str, field: str, least: int, cycles: int) -> int:
        count = self.field(register, field)
        if count < least:
            self.machine.fault(
                f"PMC_{register}.{field} is {count}: the clock may seem ready too soon; use at least {least}"
            )
        return count * cycles * PS_PER_S // SLOW_CLOCK_HZ

    def _set_upll(self, value: int) -> None:
        self.registers["CKGR_UCKR"] = value
        self._not_ready(LOCKU)
        if self.field("CKGR_UCKR", "UPLLEN"):
            if not self.registers["SR"] & MOSCXTS:
                self.machine.fault("PMC_CKGR_UCKR starts the USB PLL before the crystal runs")
            cycles = max(1, 8 * self.field("CKGR_UCKR", "UPLLCOUNT"))
            self._ready_in(LOCKU, cycles * PS_PER_S // SLOW_CLOCK_HZ)

    def _set_master_clock(self, value: int) -> None:
        r = self.registers
        if not r["SR"] & MCKRDY:
            self.machine.fault("PMC_MCKR is written before its last change is done: wait for PMC_SR.MCKRDY")
        css, pres = self.mask("MCKR", "CSS"), self.mask("MCKR", "PRES")
        changed = value ^ r["MCKR"]
        if changed & css and changed & pres:
            self.machine.fault(
                f"PMC_MCKR = 0x{value:X} changes CSS and PRES at once: change one, wait for MCKRDY, then the "
                "other"
            )
        needed = {CSS_MAIN: MOSCSELS, CSS_PLLA: LOCKA, CSS_UPLL: LOCKU}.get(value & css, 0)
        if needed and not r["SR"] & needed:
            self.machine.fault(
                f"PMC_MCKR = 0x{value:X} selects a clock that is not ready (PMC_SR = 0x{r['SR']:X})"
            )
        r["MCKR"] = value
        self._check(self._mck_hz())
        self._not_ready(MCKRDY)
        self._ready_in(MCKRDY, SELECT_PS, self._take_master_clock)

    def _take_master_clock(self) -> None:
        hz = self._mck_hz()
        self._check(hz)
        self.machine.set_mck(hz)

    def _check(self, hz: int) -> None:
        if hz > MCK_MAX_HZ:
            self.machine.fault(f"the master clock is set to {hz / 1e6:g} MHz: at most 84 MHz")
        self._check_flash(hz)

    def _main_hz(self) -> int:
        if self.field("CKGR_MOR", "MOSCSEL"):
            return CRYSTAL_HZ
        return RC_HZ[self.field("CKGR_MOR", "MOSCRCF")]

    def _plla_hz(self) -> int:
        mula, diva = self.field("CKGR_PLLAR", "MULA"), self.field("CKGR_PLLAR", "DIVA")
        return self._main_hz() * (mula + 1) // diva if mula and diva else 0

    def _mck_hz(self) -> int:
        source = {
            CSS_SLOW: SLOW_CLOCK_HZ,
            CSS_MAIN: self._main_hz(),
            CSS_PLLA: self._plla_hz() >> self.field("MCKR", "PLLADIV2"),
            CSS_UPLL: UPLL_HZ >> self.field("MCKR", "UPLLDIV2"),
        }[self.field("MCKR", "CSS")]
        pres = self.field("MCKR", "PRES")
        return source // (3 if pres == 7 else 1 << pres)

    def _not_ready(self, flag: int) -> None:
        if flag in self._events:
            self._events.pop(flag).cancel()
        self.flag("SR", flag, False)

    def _ready_in(self, flag: int, delay_ps: int, action: Callable[[], None] = lambda: None) -> None:
        def ready() -> None:
            self._events.pop(flag, None)
            action()
            self.flag("SR", flag, True)

        self._events[flag] = self.machine.schedule(delay_ps, ready)
