"""Tests that forbidden uses of peripherals end a run.

One table has the forbidden uses of the I²C controller (TWI), another those of all other peripherals. A row of
a table can have steps before the forbidden access. A step is a write (peripheral, register, value), a time to
pass in ms, or a function of `machine_support`.
"""

import pytest

from tests.rig.machine_support import (
    FAR,
    MS,
    PLLA_168,
    Bench,
    crystal,
    full_speed,
    peripheral,
    plla,
    wait_states,
)
from tests.rig.sensor_support import MSEN, SCL, SDA, START, SWRST, TWI1_ID, SmallBoard
from tools.due_emulator.machine import EmulationFault

UART_CLOCK = [full_speed, ("PMC", "PCER0", 1 << 8)]
UART_8N1 = [*UART_CLOCK, ("UART", "MR", 4 << 9)]
UART = [*UART_8N1, ("UART", "BRGR", 21), ("UART", "CR", 1 << 6)]
TC = ("PMC", "PCER0", 7 << 27)
WAVE = 1 << 15
HALVED = ("PMC", "MCKR", 0x11)
SLOWEST_RC = [plla, HALVED, 1.0]
PLLA_90 = ("PMC", "CKGR_PLLAR", 1 << 29 | 14 << 16 | 0x3F00 | 1)
UNLOCKED = [wait_states, crystal, ("PMC", "CKGR_PLLAR", PLLA_168), HALVED, 0.5]


def test_the_table_begins_where_nothing_is_refused():
    """The steps that prepare the forbidden access in a row of the tables are allowed.

    Otherwise one of these steps could be refused in place of the forbidden access.
    """
    for steps in (UART, SLOWEST_RC, [TC], [wait_states, *SLOWEST_RC]):
        play(Bench(b"\xff" * 8).board, steps)


def play(board, steps):
    for step in steps:
        match step:
            case (name, register, value):
                peripheral(board, name).write(register, value)
            case float():
                board.machine.advance(round(step * MS))
            case _:
                step(board)


@pytest.mark.parametrize(
    ("before", "name", "register", "value", "text"),
    [
        # Rows about the oscillators and the PLL
        ([], "PMC", "CKGR_MOR", 0x809, "without its key"),
        ([], "PMC", "CKGR_MOR", 0x0037_0801, "stops the RC oscillator"),
        ([("PMC", "CKGR_MOR", FAR)], "PMC", "CKGR_MOR", FAR | 1 << 24, "before it is ready"),
        ([crystal], "PMC", "CKGR_PLLAR", PLLA_168 & ~(1 << 29), "bit 29"),
        ([crystal], "PMC", "CKGR_PLLAR", 1 << 29 | 16 << 16 | 0x3F00 | 1, "204 MHz"),
        ([full_speed], "PMC", "CKGR_PLLAR", PLLA_168, "comes from PLLA"),
        # Rows about the master clock
        (UNLOCKED, "PMC", "MCKR", 0x12, "not ready"),
        ([wait_states, plla], "PMC", "MCKR", 0x12, "CSS and PRES at once"),
        ([wait_states, plla, HALVED], "PMC", "MCKR", 0x12, "before its last change is done"),
        ([wait_states, crystal, PLLA_90, 2.0, HALVED, 1.0], "PMC", "MCKR", 0x12, "90 MHz: at most 84"),
        *(
            (
                [("EFC0", "FMR", first << 8), ("EFC1", "FMR", second << 8), *SLOWEST_RC],
                "PMC",
                "MCKR",
                0x12,
                f"EFC{int(first == 4)}_FMR.FWS is",
            )
            for first, second in ((3, 4), (4, 3), (0, 4), (4, 0))
        ),
        ([full_speed], "EFC0", "FMR", 1 << 8, "FWS is 1, good for 34 MHz"),
        # Rows about the clocks of peripherals, and about the keys that protect registers from writing
        ([("PMC", "PCDR0", 1 << 7)], "PMC", "PCER0", 1 << 7, "do not exist"),
        ([("PMC", "PCDR0", 1 << 2)], "PMC", "PCER0", 1 << 2, "do not exist"),
        ([("PMC", "PCDR1", 1 << 13)], "PMC", "PCER1", 1 << 13, "do not exist"),
        ([("PMC", "WPMR", 0x504D_4300)], "PMC", "WPMR", 0, "without its key"),
        ([], "EFC0", "FCR", 0x0000000E, "without its key"),
        ([], "EFC0", "FCR", 0x5A000003, "not modelled"),
        ([], "WDT", "MR", 1 << 13, "WDV = 0"),
        # Rows about the UART
        (UART_CLOCK, "UART", "THR", 1, "transmitter is off"),
        ([*UART, ("UART", "THR", 1), ("UART", "THR", 2)], "UART", "THR", 3, "TXRDY is 0"),
        ([*UART, ("UART", "THR", 1)], "UART", "BRGR", 20, "while a byte is on the line"),
        ([*UART_CLOCK, ("UART", "BRGR", 21)], "UART", "CR", 1 << 6, "8N1"),
        ([*UART_CLOCK, ("UART", "MR", 4 << 9 | 2 << 14)], "UART", "CR", 1 << 6, "8N1"),
        ([*UART_8N1, ("UART", "CR", 1 << 6)], "UART", "THR", 1, "no clock"),
        ([*UART, ("UART", "TPR", 0x30000000), ("UART", "TCR", 1)], "UART", "PTCR", 1 << 8, "no memory"),
        (UART, "UART", "TNCR", 4, "TCR is 0"),
        (UART, "UART", "PTCR", 1, "receiving is not modelled"),
        # Rows about the timers
        *(
            ([TC], "TC0", register, value, "modelled")
            for register, value in (
                ("CMR0", WAVE | 1 << 13),
                ("CMR0", 5),
                ("CMR0", WAVE | 1 << 6),
                ("CMR0", 1 << 3),
                ("IER0", 1 << 2),
                ("BMR", 1),
            )
        ),
    ],
)
def test_a_write_that_ends_the_run(before, name, register, value, text):
    board = Bench(b"\xff" * 8).board
    play(board, before)
    with pytest.raises(EmulationFault) as caught:
        peripheral(board, name).write(register, value)
    assert text in caught.value.reason


def begin(board):
    board.begin_read(0x75, START)


@pytest.mark.parametrize(
    ("before", "action", "text"),
    [
        ([begin], ("CR", START), "START while a transfer"),
        ([begin], ("IADR", 0), "TWI1_IADR is written while"),
        ([lambda board: board.address(0x19, False), ("THR", 1)], ("THR", 2), "TXRDY is 0"),
        ([lambda board: board.address(0x19, True)], ("THR", 1), "MREAD"),
        ([("CR", SWRST), ("CWGR", 101 << 8 | 101)], begin, "without MSEN"),
        ([("CWGR", 0)], begin, "400 kHz"),
        ([("CWGR", 98 << 8 | 98)], begin, "400 kHz"),
        ([lambda board: board.pio.write("PER", SDA)], begin, "PB12 is not assigned to peripheral A"),
        ([lambda board: board.pio.write("PER", SCL)], begin, "PB13 is not assigned to peripheral A"),
        ([lambda board: board.pio.write("ABSR", SCL)], begin, "PB13 is not assigned to peripheral A"),
        (
            [lambda board: setattr(board.machine, "clocked", board.machine.clocked & ~(1 << TWI1_ID))],
            lambda board: board.twi.read("SR"),
            "TWI1_SR without its clock",
        ),
        ([], ("CR", 0x40), "not modelled"),
        ([], ("PTCR", 0x1), "not modelled"),
        ([("CR", 0x10)], begin, "SVEN"),
        ([("CR", 0x10), ("CR", 0x20), ("CR", MSEN), begin], ("CR", START), "START while a transfer"),
    ],
)
def test_what_the_twi_does_not_forgive(before, action, text):
    board = SmallBoard().set_up()
    for step in before:
        step(board) if callable(step) else board.twi.write(*step)
    with pytest.raises(EmulationFault, match=text):
        action(board) if callable(action) else board.twi.write(*action)
