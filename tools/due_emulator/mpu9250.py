"""The register file of the MPU-9250: what a driver sees over I2C, in virtual time.

The model needs no emulated board, so that the simulated bus of a Raspberry Pi can use it, too. Not modelled:
filters (the motion is measured unfiltered), self-test, offset registers, wake on motion, cycle mode, the
auxiliary I2C bus and the magnetometer on it, and the separate rate of an accelerometer with ACCEL_FCHOICE_B.
"""

from collections.abc import Callable

from tools.due_emulator import mpu9250_registers as reg
from tools.due_emulator.chip import MS_NS, PS_PER_NS, Chip
from tools.due_emulator.mpu9250_scaling import OUTPUT_BYTES, output_bytes
from tools.due_emulator.noise import Motion, World

QUIET_NS = 11 * MS_NS
"""Time after power-up in which the chip does not acknowledge: the typical start-up time (MPU-9250 product
specification, 3.4.2).
"""
READY_NS = 95 * MS_NS
"""Time after power-up in which settings that a driver writes are lost.

The limit in the MPU-9250 product specification, 3.4.2, is 100 ms. The model's time is a little shorter,
because a driver may count its 100 ms from an earlier time.
"""
RESET_NS = READY_NS
"""Time after a reset by the bit H_RESET in which settings that a driver writes are lost.

No document gives this time; the vendor's driver waits 100 ms. In this time the chip acknowledges, and the bit
H_RESET reads as 1.
"""
PULSE_NS = 50_000
"""Duration of a pulse of the INT pin if LATCH_INT_EN is 0 (MPU-9250 product specification, 3.4.2)."""

_CLOCKING = {reg.SMPLRT_DIV, reg.CONFIG, reg.GYRO_CONFIG, reg.PWR_MGMT_1}
_SCALING = {reg.CONFIG, reg.GYRO_CONFIG, reg.ACCEL_CONFIG, reg.ACCEL_CONFIG_2, reg.PWR_MGMT_1, reg.PWR_MGMT_2}


# Why more than 12 attributes: each is one register, latch or deadline of the modelled sensor.
class Mpu9250(Chip):
    """A model of the MPU-9250 or of a related chip that was powered on long before time 0.

    `world`: object that says how the sensor moves at a given time. `on_int(level, at_ns)`: called when the
    INT pin changes.
    """

    fifo_register = reg.FIFO_R_W
    gyro_start_ns = 35 * MS_NS  # MPU-9250 product specification, 3.1; 30 ms for an MPU-6050

    def __init__(
        self, world: World, *, who_am_i: int = 0x71, address: int = 0x68, clock_ppm: float = 0.0
    ) -> None:
        super().__init__(address, clock_ppm)
        self.world = world
        self.on_int: Callable[[bool, int], None] = lambda level, at_ns: None
        self.variant = reg.variant_of(who_am_i)
        self._resetting = False
        self._active = False
        self._level = False
        self._pulse_end_ns: int | None = None
        self._last_update_ns = 0
        self._measured: tuple[Motion, int, int, bytes] | None = None
        self._busy = False
        self._output = self._shown = bytes(OUTPUT_BYTES)
        self._output_ns = -1
        self._status = self._count_latch = 0
        self._restore()

    # Time

    def advance(self, now_ns: int) -> None:
        """Advance time to `now_ns`.

        Raises:
            ValueError: time would run backwards.
        """
        if now_ns < self._now_ns:
            raise ValueError(f"the chip is at {self._now_ns} ns and cannot go back to {now_ns} ns")
        while (at_ns := self._next_internal_ns()) is not None and at_ns <= now_ns:
            self._now_ns = at_ns
            self._happen(at_ns)
        self._now_ns = now_ns
        self._skip_updates()

    def next_event_ns(self) -> int | None:
        """Return when the INT pin will next change without an access to the chip; None if it will not."""
        latched = self._active and bool(self._registers[reg.INT_PIN_CFG] & reg.LATCH_INT_EN)
        update_ns = self._next_update_ns() if self._interrupts() and not latched else None
        return _first(self._pulse_end_ns, update_ns)

    @property
    def clock_ppm(self) -> float:
        """Error of the chip's clock, positive if the clock is too fast [ppm]; may be set at any time."""
        return self._clock_ppm

    @clock_ppm.setter
    def clock_ppm(self, ppm: float) -> None:
        old_ps = self._period_ps or 0
        phase_ps = self._now_ns * PS_PER_NS - self._anchor_ps - self._updates * old_ps
        self._clock_ppm = ppm
        self._start_clock()
        # A change of the clock's rate keeps the fraction of the sample period that has passed.
        if old_ps and self._period_ps:
            self._anchor_ps -= phase_ps * self._period_ps // old_ps

    @property
    def output_hz(self) -> float:
        """Nominal rate of the output registers; 0 when the chip does not convert (registers 25 and 26)."""
        power = self._registers[reg.PWR_MGMT_1]
        if not self.powered or self._ready_at_ns is not None or power & reg.SLEEP:
            return 0.0
        if power & reg.CLKSEL == reg.CLKSEL_STOP:
            return 0.0
        divider = 1 + self._registers[reg.SMPLRT_DIV]
        dlpf = self._registers[reg.CONFIG] & 7
        if self.variant.has_fchoice and self._registers[reg.GYRO_CONFIG] & 3:
            return 32_000.0
        if dlpf in (0, 7):
            return 8000.0 if self.variant.has_fchoice else 8000.0 / divider
        return 1000.0 / divider

    def register(self, register: int) -> int:
        """Return the contents of a register without using the bus."""
        return self._registers[register]

    def spoil(self, register: int, value: int) -> None:
        """Change a register without the driver's knowledge, for tests of what the driver notices."""
        self._store(register, value)

    # Power supply

    def power_on(self, who_am_i: int | None = None) -> None:
        """Power up the chip, or another chip in its place."""
        if who_am_i is not None:
            self.variant = reg.variant_of(who_am_i)
        self.powered = True
        self._begin(QUIET_NS, READY_NS)

    def become(self, who_am_i: int) -> None:
        """Become another chip, as if that chip had been there from the beginning.

        This method must be called before any other.
        """
        self.variant = reg.variant_of(who_am_i)
        self._restore()

    # Bus

    def start(self, address: int, read: bool) -> bool:
        """Receive a START or repeated START with an address; return whether the chip acknowledges.

        From the START to the STOP, the output registers show the values of one instant. Only while the bus is
        idle does the chip copy its newest measurement to the registers that can be read (MPU-6000 register
        map, 4.17).
        """
        self._selected = super().start(address, read) and not (
            self._registers[reg.USER_CTRL] & reg.I2C_IF_DIS
        )
        if not self._selected:
            return False
        if not self._busy:
            self._busy = True
            self._refresh_output()
            self._shown = self._output
        return True

    def stop(self) -> None:
        super().stop()
        self._busy = False

    # Registers

    def _load(self, register: int) -> int:
        if register == reg.INT_STATUS:
            value = self._status
            self._clear_status()
            return value
        if self._registers[reg.INT_PIN_CFG] & reg.INT_ANYRD_2CLEAR:
            self._clear_status()
        if reg.ACCEL_XOUT_H <= register <= reg.GYRO_ZOUT_L:
            return self._shown[register - reg.ACCEL_XOUT_H]
        match register:
            case reg.WHO_AM_I:
                return self.variant.who_am_i
            # Reading this register stores both bytes of the FIFO's count, so that they belong together
            # (MPU-9250 register map, 114 and 115).
            case reg.FIFO_COUNTH:
                self._count_latch = len(self.fifo)
                return self._count_latch >> 8
            case reg.FIFO_COUNTL:
                return self._count_latch & 0xFF
            case reg.FIFO_R_W:
                return self.fifo.pop()
            case reg.PWR_MGMT_1 if self._resetting:
                return self._registers[register] | reg.H_RESET
        return self._registers[register]

    def _store(self, register: int, value: int) -> None:
        if register == reg.PWR_MGMT_1 and value & reg.H_RESET:
            self._begin(0, RESET_NS)
            self._resetting = True
            return
        if register == reg.FIFO_R_W:
            self._push_fifo(bytes([value]))
            return
        if register in _SCALING:
            # Store the present counts before the range changes: values that were measured earlier keep the
            # old scale.
            self._refresh_output()
        before = self.output_hz
        self._registers[register] = value & self.variant.writable.get(register, 0)
        if register == reg.USER_CTRL and value & reg.FIFO_RST:
            if not (self.variant.fifo_reset_needs_off and value & reg.USER_FIFO_EN):
                self.fifo.clear()
        elif register in (reg.INT_PIN_CFG, reg.INT_ENABLE):
            self._settle_pin()
        elif register in _CLOCKING and self.output_hz != before:
            self._start_clock()

    # Reset

    def _restore(self) -> None:
        """Restore reset values. Restart the sampling clock, unless the chip sleeps with these values."""
        self._ready_at_ns, self._quiet_until_ns, self._resetting = None, 0, False
        self._registers = bytearray(128)
        for register, value in self.variant.reset.items():
            self._registers[register] = value
        self.fifo.clear()
        self.fifo.size = self.variant.fifo_bytes
        self._status = self._count_latch = 0
        self._output = self._shown = bytes(OUTPUT_BYTES)
        self._output_ns = self._last_update_ns
        self._selected = self._busy = False
        self._pulse_end_ns = None
        self._set_pin(False)
        self._start_clock()

    # Conversions

    def _next_internal_ns(self) -> int | None:
        """Return the time of the next internal event; None if there is none.

        An update of the output registers is an event only if the FIFO or an interrupt needs it.
        """
        is_followed = self._interrupts() or self._fills_fifo()
        update_ns = self._next_update_ns() if is_followed else None
        return _first(_first(self._pulse_end_ns, self._ready_at_ns), update_ns)

    def _happen(self, at_ns: int) -> None:
        if at_ns == self._ready_at_ns:
            self._restore()
        elif at_ns == self._pulse_end_ns:
            self._pulse_end_ns = None
            self._set_pin(False)
        else:
            self._updates += 1
            self._update(at_ns)

    def _skip_updates(self) -> None:
        """Make up for skipped updates of the output registers: perform only the last of them.

        Updates are skipped while neither the FIFO nor an interrupt needs them.
        """
        if self._period_ps is None:
            return
        updates = (self._now_ns * PS_PER_NS - self._anchor_ps) // self._period_ps
        if updates > self._updates:
            self._updates = updates
            self._update(-(-(self._anchor_ps + updates * self._period_ps) // PS_PER_NS))

    def _update(self, at_ns: int) -> None:
        self._last_update_ns = at_ns
        self._status |= reg.RAW_DATA_RDY
        causes = reg.RAW_DATA_RDY
        if self._fills_fifo():
            self._refresh_output()
            sources = self._registers[reg.FIFO_EN]
            data = b"".join(self._output[a:b] for bit, a, b in reg.FIFO_SOURCES if sources & bit)
            if self._push_fifo(data):
                causes |= reg.FIFO_OFLOW
        if self._interrupts() & causes:
            if not self._registers[reg.INT_PIN_CFG] & reg.LATCH_INT_EN:
                self._pulse_end_ns = at_ns + PULSE_NS
            self._set_pin(True)

    def _fills_fifo(self) -> bool:
        enabled = self._registers[reg.USER_CTRL] & reg.USER_FIFO_EN
        return bool(enabled and self._registers[reg.FIFO_EN] & 0xF8)

    def _interrupts(self) -> int:
        return self._registers[reg.INT_ENABLE] & (reg.FIFO_OFLOW | reg.RAW_DATA_RDY)

    def _push_fifo(self, data: bytes) -> bool:
        overflow = self.fifo.push(data, bool(self._registers[reg.CONFIG] & reg.FIFO_MODE_STOP))
        if overflow:
            self._status |= reg.FIFO_OFLOW
        return overflow

    def _refresh_output(self) -> None:
        """Compute the contents of the internal output registers at the time of their last update."""
        if self._output_ns != self._last_update_ns:
            self._output_ns = self._last_update_ns
            self._output = self._measure(self._motion(self._output_ns))

    def _measure(self, motion: Motion) -> bytes:
        """Return the counts of a motion at the configured ranges.

        Axes that are switched off keep their last counts (MPU-9250 register map, 108).
        """
        gyro_fs = self._registers[reg.GYRO_CONFIG] >> 3 & 3
        accel_fs = self._registers[reg.ACCEL_CONFIG] >> 3 & 3
        off = self._registers[reg.PWR_MGMT_2] & 0x3F
        known = self._measured
        if not off and known is not None and known[0] is motion and known[1:3] == (gyro_fs, accel_fs):
            return known[3]
        data = bytearray(output_bytes(motion, gyro_fs, accel_fs, self.variant.who_am_i))
        # Bits 0 to 5 of PWR_MGMT_2 switch off z, y, x of the gyroscope, then z, y, x of the accelerometer.
        for bit, place in enumerate((12, 10, 8, 4, 2, 0)):
            if off >> bit & 1:
                data[place : place + 2] = self._output[place : place + 2]
        self._measured = None if off else (motion, gyro_fs, accel_fs, bytes(data))
        return bytes(data)

    # Interrupt pin

    def _clear_status(self) -> None:
        self._status = 0
        self._settle_pin()

    def _settle_pin(self) -> None:
        """Set the INT pin after a change of settings or flags.

        A latched pin is active while an enabled status flag is set.
        """
        if self._registers[reg.INT_PIN_CFG] & reg.LATCH_INT_EN:
            self._pulse_end_ns = None
            self._set_pin(bool(self._status & self._registers[reg.INT_ENABLE]))
        else:
            self._set_pin(self._pulse_end_ns is not None)

    def _set_pin(self, active: bool) -> None:
        self._active = active
        level = active != bool(self._registers[reg.INT_PIN_CFG] & reg.ACTIVE_LOW)
        if level != self._level:
            self._level = level
            self.on_int(level, self._now_ns)


def _first(one_ns: int | None, other_ns: int | None) -> int | None:
    """Return the earlier of two times, either of which may be None."""
    if one_ns is None or (other_ns is not None and other_ns < one_ns):
        return other_ns
    return one_ns
