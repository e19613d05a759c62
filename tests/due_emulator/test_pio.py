"""Tests of the PIO controllers: outputs, open drain, inputs, interrupts and the assignment of pins to
peripherals.

The expected behaviour is that of the SAM3X datasheet, chapter 31.
"""

import pytest

from tests.rig.sensor_support import INT_BIT, LED_BIT, PIOB_ID, SCL, SDA, SDA_BIT, SmallBoard
from tools.due_emulator.machine import EmulationFault

INT, LED = 1 << INT_BIT, 1 << LED_BIT


def test_after_reset_all_pins_are_inputs_with_pull_ups():
    pio = SmallBoard().pio
    assert pio.read("PSR") == 0xFFFFFFFF
    assert pio.read("OSR") == 0
    assert pio.read("PUSR") == 0
    assert pio.peripheral(SDA_BIT) is None
    assert pio.read("PDSR") & LED


def test_pins_go_to_a_or_b():
    pio = SmallBoard().pio
    pio.write("PDR", SDA | SCL)
    pio.write("ABSR", SCL)
    assert [pio.peripheral(b) for b in (12, 13, 14)] == ["A", "B", None]
    pio.write("PER", SCL)
    assert pio.peripheral(13) is None


def test_output_levels():
    pio = SmallBoard().pio
    seen = []
    pio.on_output = lambda bit, level: seen.append((bit, level))
    pio.write("SODR", LED)
    assert seen == []  # The pin is not an output yet.
    pio.write("OER", LED)
    assert pio.read("PDSR") & LED
    pio.write("CODR", LED)
    assert not pio.read("PDSR") & LED
    pio.write("ODSR", LED)  # The register OWSR (output write status) does not permit this write.
    assert not pio.read("ODSR") & LED
    pio.write("OWER", LED)
    pio.write("ODSR", 0xFFFFFFFF)
    assert pio.read("ODSR") == LED
    assert seen == [(LED_BIT, True), (LED_BIT, False), (LED_BIT, True)]


def test_open_drain_lets_go_at_1():
    board = SmallBoard()
    board.pio.write("MDER", SDA)
    board.pio.write("OER", SDA)
    assert not board.lines.sda.level
    board.pio.write("SODR", SDA)
    assert board.lines.sda.level
    board.lines.hold_sda()
    assert not board.sda()
    board.pio.write("PDR", SDA)
    board.lines.release_sda()
    assert board.lines.sda.level


def test_a_pin_of_a_peripheral_is_not_driven_from_here():
    board = SmallBoard()
    board.pio.write("PDR", SDA)
    board.pio.write("OER", SDA | SCL)
    assert board.lines.sda.level
    assert not board.lines.scl.level
    board.pio.write("PER", SDA)
    assert not board.lines.sda.level


def test_pull_ups_can_be_switched_off():
    pio = SmallBoard().pio
    pio.write("PUDR", LED)
    assert pio.read("PUSR") == LED
    assert not pio.read("PDSR") & LED
    pio.write("PUER", LED)
    assert pio.read("PDSR") & LED


@pytest.mark.parametrize("register", ["PDSR", "ISR"])
def test_sampling_needs_the_clock(register):
    board = SmallBoard()
    board.machine.clocked = 0
    # The port controller needs no clock for this write, which gives the pin to a peripheral.
    board.pio.write("PDR", SDA)
    with pytest.raises(EmulationFault, match=rf"PIOB_{register} without its clock: bit 12 of PMC_PCER0"):
        board.pio.read(register)
    with pytest.raises(EmulationFault, match="PIOB_IER without its clock"):
        board.pio.write("IER", INT)


def pulse(board):
    """Send a pulse to the INT pin. Return whether its rising edge is detected, and whether its falling edge
    is.
    """
    board.socket.int_wire.drive("sensor", True)
    rising = bool(board.pio.read("ISR") & INT)
    board.socket.int_wire.drive("sensor", False)
    return rising, bool(board.pio.read("ISR") & INT)


@pytest.mark.parametrize(
    ("writes", "seen"),
    [
        ([], (True, True)),
        ([("AIMER", INT), ("ESR", INT), ("REHLSR", INT)], (True, False)),
        ([("AIMER", INT), ("ESR", INT), ("FELLSR", INT)], (False, True)),
        ([("AIMER", INT), ("REHLSR", INT), ("FELLSR", INT)], (False, True)),
        ([("AIMER", INT), ("REHLSR", INT), ("AIMDR", INT)], (True, True)),
    ],
)
def test_edges(writes, seen):
    board = SmallBoard()
    board.pio.write("PUDR", INT)
    for register, value in writes:
        board.pio.write(register, value)
    assert pulse(board) == seen


def test_interrupt_is_raised_if_enabled_and_cleared_by_isr():
    board = SmallBoard()
    board.socket.int_wire.drive("sensor", True)
    assert not board.irqs[PIOB_ID]
    board.pio.write("IER", INT)
    assert board.irqs[PIOB_ID]
    assert board.pio.read("ISR") == INT
    assert not board.irqs[PIOB_ID]
    assert board.pio.read("ISR") == 0
    board.socket.int_wire.drive("sensor", False)
    assert board.irqs[PIOB_ID]
    board.pio.write("IDR", INT)
    assert not board.irqs[PIOB_ID]


def test_edges_without_a_clock_are_missed():
    board = SmallBoard()
    board.machine.clocked = 0
    board.socket.int_wire.drive("sensor", True)
    board.machine.clocked = 1 << PIOB_ID
    assert board.pio.read("ISR") == 0


def test_data_ready_pin_of_the_sensor_arrives():
    board = SmallBoard()
    for register in ("AIMER", "ESR", "REHLSR", "IER"):
        board.pio.write(register, INT)
    board.chip.write_register(0x19, 9, 1)
    board.chip.write_register(0x38, 1)
    board.socket.settle()
    times_us = []
    for _ in range(35_000):
        board.wait_us(1)
        if board.irqs[PIOB_ID]:
            times_us.append(board.machine.now_ps // 1_000_000)
            board.pio.read("ISR")
    assert times_us == [10_000, 20_000, 30_000]


def test_pin_of_an_unplugged_sensor_floats():
    board = SmallBoard()
    assert not board.pio.level(INT_BIT)
    board.lines.unplug()
    assert board.pio.level(INT_BIT)  # The pull-up of the pin keeps it high.
    board.socket.plug()
    assert not board.pio.level(INT_BIT)


def test_write_protection():
    pio = SmallBoard().pio
    with pytest.raises(EmulationFault, match="without its key"):
        pio.write("WPMR", 0x1)
    pio.write("PDR", SDA)
    pio.write("WPMR", 0x50494F01)
    pio.write("SODR", SDA)
    with pytest.raises(EmulationFault, match="WPMR"):
        pio.write("PDR", SCL)
    pio.write("WPMR", 0x50494F00)
    pio.write("PDR", SCL)
