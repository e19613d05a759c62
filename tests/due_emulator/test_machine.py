"""Tests of the emulator's virtual time, and of the registers that all peripherals have in common."""

import pytest

from tools.due_emulator.bus import Bus
from tools.due_emulator.cycle_counter import CycleCounter
from tools.due_emulator.machine import NEVER_PS, PS_PER_S, Alarm, EmulationFault, Machine
from tools.due_emulator.nvic import FIRST_IRQ, Nvic
from tools.due_emulator.peripheral import Peripheral
from tools.due_emulator.register_file import PLAIN, RegisterFile
from tools.due_emulator.register_table import peripherals


def clocked():
    """Return a machine in which the clocks of all peripherals are on."""
    machine = Machine()
    machine.clocked = (1 << 45) - 1
    return machine


def test_events_happen_at_their_moment_in_the_order_of_time_then_of_scheduling():
    machine = Machine()
    seen = []
    for name, delay in (("c", 30), ("a", 10), ("b", 10)):
        machine.schedule(delay, lambda name=name: seen.append((name, machine.now_ps)))
    machine.advance_to(29)
    assert seen == [("a", 10), ("b", 10)]
    machine.advance(1)
    assert seen[-1] == ("c", 30)
    assert machine.next_event_ps == NEVER_PS


def test_an_event_can_schedule_and_cancel_others():
    machine = Machine()
    seen = []
    second = machine.schedule(20, lambda: seen.append("second"))
    machine.schedule(10, lambda: (second.cancel(), machine.schedule(5, lambda: seen.append(machine.now_ps))))
    machine.advance_to(100)
    assert seen == [15]
    assert machine.now_ps == 100


def test_a_quiet_event_stops_no_program_and_happens_at_its_moment_in_its_order():
    machine, seen = Machine(), []
    for name, delay, quiet in (("a", 10, True), ("b", 10, False), ("c", 20, True), ("never", 25, True)):
        alarm = Alarm(machine, lambda name=name: seen.append((name, machine.now_ps)))
        alarm.set(delay, quiet=quiet)
    alarm.cancel()
    assert machine.next_event_ps == 10
    machine.advance_to(10)
    assert machine.next_event_ps == NEVER_PS
    machine.advance_to(30)
    assert seen == [("a", 10), ("b", 10), ("c", 20)]


def test_a_fault_says_where_and_when():
    machine = Machine()
    machine.where = lambda: "at PC 0x00080000"
    machine.advance(PS_PER_S // 2)
    with pytest.raises(EmulationFault, match=r"^oh \(at PC 0x00080000, 0\.500000 s\)$"):
        machine.fault("oh")


@pytest.mark.parametrize("hz", [84_000_000, 32_768, 3])
def test_cycles_are_counted_without_drift_and_told_in_advance(hz):
    machine = Machine()
    counter = CycleCounter(machine, lambda: (hz, 1))
    counter.restart()
    machine.advance(100 * PS_PER_S)
    assert counter.cycles == 100 * hz
    for ahead in (1, 2, 1000):
        until = counter.ps_until(100 * hz + ahead)
        probe = machine.now_ps
        machine.advance_to(probe + until - 1)
        assert counter.cycles == 100 * hz + ahead - 1
        machine.advance(1)
        assert counter.cycles == 100 * hz + ahead
        counter.restart(100 * hz)


def test_registers_exist_where_the_vendor_says_and_nowhere_else():
    machine = clocked()
    bus = Bus(machine)
    table = peripherals()
    for name in table:
        bus.add(RegisterFile(machine, name))
    readable = {t.base + r.offset for t in table.values() for r in t.registers.values() if r.readable}
    writable = {t.base + r.offset for t in table.values() for r in t.registers.values() if r.writable}
    assert len(table) == 38
    for t in table.values():
        for offset in range(0, max(r.offset for r in t.registers.values()) + 8, 4):
            address = t.base + offset
            if address in readable:
                assert bus.read(address, 4) >= 0
            else:
                with pytest.raises(EmulationFault, match=r"unknown register|write-only|no peripheral"):
                    bus.read(address, 4)
            if address not in writable:
                with pytest.raises(EmulationFault, match=r"unknown register|read-only|no peripheral"):
                    bus.write(address, 4, 0)


def test_the_arduino_core_may_read_the_command_register_of_the_twi():
    assert Peripheral(clocked(), "TWI1").read("CR") == 0


@pytest.mark.parametrize("name", PLAIN)
def test_a_register_file_keeps_sets_clears_and_resets(name):
    machine = clocked()
    file = RegisterFile(machine, name)
    before = dict(file.registers)
    for register, entry in file.table.registers.items():
        if entry.readable and entry.writable and name != "UOTGHS":
            key = 0xA5 << 24 if name == "SUPC" else 0
            file.write(register, key | 0x50)
            assert file.read(register) & 0xFF == 0x50
    file.reset()
    assert file.registers == before


def test_set_clear_and_status_registers_belong_together():
    adc = RegisterFile(clocked(), "ADC")
    adc.write("CHER", 0b1101)
    adc.write("CHDR", 0b0100)
    assert adc.read("CHSR") == 0b1001


def test_the_usb_clock_is_usable_once_it_is_on_and_runs():
    usb = RegisterFile(clocked(), "UOTGHS")
    usb.write("CTRL", 1 << 15 | 1 << 14)
    assert not usb.read("SR") & 1 << 14
    usb.write("CTRL", 1 << 15)
    assert usb.read("SR") & 1 << 14


def test_what_only_exists_as_registers_does_not_work_in_secret():
    with pytest.raises(EmulationFault, match="not modelled"):
        RegisterFile(clocked(), "ADC").write("CR", 2)


def test_a_line_pends_when_it_rises_and_again_when_the_handler_returns():
    nvic = Nvic(Machine())
    nvic.enabled |= 1 << FIRST_IRQ + 8
    nvic.set_line(8, True)
    assert nvic.urgent() == FIRST_IRQ + 8
    nvic.enter(FIRST_IRQ + 8)
    assert nvic.urgent() is None
    nvic.set_line(8, True)
    assert not nvic.pending >> FIRST_IRQ + 8 & 1, "a line that stays up is no new request yet"
    nvic.leave()
    assert nvic.urgent() == FIRST_IRQ + 8
    nvic.set_line(8, False)
    assert nvic.urgent() == FIRST_IRQ + 8, "what is pending stays so when the line falls"
    nvic.unpend(FIRST_IRQ + 8)
    assert nvic.urgent() is None
    nvic.set_line(8, True)
    nvic.unpend(FIRST_IRQ + 8)
    assert nvic.urgent() == FIRST_IRQ + 8, "a line that is up cannot be cleared"


def test_priorities_groups_and_basepri_decide():
    nvic = Nvic(Machine())
    low, high = FIRST_IRQ + 3, FIRST_IRQ + 9
    nvic.enabled |= 1 << low | 1 << high
    nvic.priority[low], nvic.priority[high] = 0x50, 0x40
    nvic.pend(low)
    nvic.pend(high)
    assert nvic.urgent() == high
    assert nvic.urgent(base_priority=0x40) is None
    nvic.unpend(high)
    nvic.enter(low)
    nvic.pend(high)
    assert nvic.urgent() == high
    # Only bits 7 to 5 of a priority decide whether one interrupt preempts another, so 0x50 and 0x40 count as
    # equal.
    nvic.priority_group = 4
    assert nvic.urgent() is None
