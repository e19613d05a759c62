"""Tests of the UART as a transmitter, used by polling, by interrupts and by DMA (PDC).

Also tested are the UART's timing, and the forbidden uses that end the run.
"""

import pytest

from tests.rig.machine_support import Bench, reason, run
from tools.due_emulator.machine import PS_PER_S, EmulationFault
from tools.due_emulator.memory_map import RAM_BASE

BYTE_PS = 40_000_000
"""Duration of a byte [ps], which is ten bits at 250,000 baud."""
TXRDY, ENDTX, TXEMPTY, TXBUFE = 1 << 1, 1 << 4, 1 << 9, 1 << 11
UART_ID = 8


class Line:
    """Records the transmitted bytes with their times and baud rates."""

    def __init__(self, board):
        self.board = board
        self.sent = []
        board.uart._line = self

    def send(self, byte, at_ps, baud):
        self.sent.append((byte, at_ps, baud))

    @property
    def bytes(self):
        return bytes(byte for byte, _, _ in self.sent)


@pytest.fixture
def board():
    board = Bench(b"\xff" * 8).board
    board.machine.set_mck(84_000_000)
    board.machine.clocked = 1 << UART_ID
    return board


@pytest.fixture
def taken(board):
    found = []
    board.bridge.deliver = lambda byte: found.append(byte) or True
    return found


@pytest.fixture
def line(board):
    board.uart.write("MR", 4 << 9)
    board.uart.write("BRGR", 21)
    board.uart.write("CR", 1 << 6)
    return Line(board)


def test_a_byte_takes_ten_bits_and_the_next_waits_in_the_holding_register(board, line):
    uart, machine = board.uart, board.machine
    begun_ps = machine.now_ps
    assert uart.read("SR") & (TXRDY | TXEMPTY) == TXRDY | TXEMPTY
    uart.write("THR", 0x55)
    assert uart.read("SR") & (TXRDY | TXEMPTY) == TXRDY
    uart.write("THR", 0x1AA)
    assert uart.read("SR") & (TXRDY | TXEMPTY) == 0
    machine.advance(BYTE_PS)
    assert uart.read("SR") & (TXRDY | TXEMPTY) == TXRDY
    machine.advance(BYTE_PS)
    assert uart.read("SR") & (TXRDY | TXEMPTY) == TXRDY | TXEMPTY
    assert line.sent == [(0x55, begun_ps + BYTE_PS, 250_000), (0xAA, begun_ps + 2 * BYTE_PS, 250_000)]
    assert uart.busy_ps == 2 * BYTE_PS


def test_the_interrupt_follows_txrdy_and_the_mask(board, line):
    lines: dict[int, bool] = {}
    board.machine.on_irq = lines.__setitem__
    board.uart.write("IER", TXRDY)
    assert lines[UART_ID]
    board.uart.write("THR", 1)
    board.uart.write("THR", 2)
    assert not lines[UART_ID]
    board.machine.advance(BYTE_PS)
    assert lines[UART_ID]
    board.uart.write("IDR", TXRDY)
    assert not lines[UART_ID]
    assert board.uart.read("IMR") == 0


def test_the_pdc_sends_a_block_and_the_next_one_behind_it(board, line):
    uart = board.uart
    board.memory.ram[:8] = b"abcdefgh"
    assert uart.read("SR") & (ENDTX | TXBUFE) == ENDTX | TXBUFE
    uart.write("TPR", RAM_BASE)
    uart.write("TCR", 3)
    uart.write("TNPR", RAM_BASE + 5)
    uart.write("TNCR", 2)
    assert not uart.read("SR") & (ENDTX | TXBUFE)
    assert line.bytes == b""
    uart.write("PTCR", 1 << 8)
    assert uart.read("PTSR") & 1 << 8
    board.machine.advance(BYTE_PS)
    # One byte is sent, the second is on the wire, and the third is in the UART's holding register. So the DMA
    # controller (PDC) has handed over all bytes of its first block.
    assert uart.read("SR") & (ENDTX | TXBUFE) == ENDTX
    assert (uart.read("TPR"), uart.read("TCR"), uart.read("TNCR")) == (RAM_BASE + 5, 2, 0)
    board.machine.advance(4 * BYTE_PS)
    assert line.bytes == b"abcfg"
    assert uart.read("SR") & (ENDTX | TXBUFE | TXEMPTY) == ENDTX | TXBUFE | TXEMPTY
    assert line.sent[-1][1] - line.sent[0][1] == 4 * BYTE_PS, "without gaps"


def test_a_block_stops_the_program_where_a_flag_changes_and_each_byte_has_its_moment(board, line):
    uart, machine = board.uart, board.machine
    begun_ps = machine.now_ps
    uart.write("TPR", RAM_BASE)
    uart.write("TCR", 5)
    uart.write("PTCR", 1 << 8)
    # The UART has room for two bytes in its registers. So the DMA controller (PDC) fetches the fifth byte
    # when the third has been sent.
    assert machine.next_event_ps == begun_ps + 3 * BYTE_PS
    machine.advance(BYTE_PS)
    uart.write("TCR", 2)
    assert machine.next_event_ps == begun_ps + 3 * BYTE_PS
    uart.write("TCR", 1)
    assert machine.next_event_ps == begun_ps + 2 * BYTE_PS
    machine.advance(PS_PER_S)
    assert [at_ps - begun_ps for _, at_ps, _ in line.sent] == [k * BYTE_PS for k in (1, 2, 3, 4)]


def test_the_pdc_stops_when_it_is_told_to(board, line):
    board.uart.write("TPR", RAM_BASE)
    board.uart.write("TCR", 50)
    board.uart.write("PTCR", 1 << 8)
    board.machine.advance(3 * BYTE_PS)
    board.uart.write("PTCR", 1 << 9)
    left = board.uart.read("TCR")
    board.machine.advance(10 * BYTE_PS)
    assert board.uart.read("TCR") == left > 0
    assert len(line.bytes) + left == 50


def test_the_baud_rate_is_that_of_the_divider_and_the_clock(board, line):
    board.uart.write("BRGR", 45)
    assert board.uart.baud == pytest.approx(116_666.7, abs=0.1)
    usart = next(p for p in board.peripherals if p.name == "USART0")
    board.machine.clocked |= 1 << 17
    usart.write("BRGR", 5 << 16 | 20)
    assert usart.baud == pytest.approx(84e6 / 16 / 20.625)
    usart.write("MR", 1 << 19)
    assert usart.baud == pytest.approx(84e6 / 8 / 20.625)


def test_the_bridge_forgives_two_percent(board, line):
    bridge = board.bridge
    bridge.send(1, 0, 254_900)
    assert "245000 baud" in reason(bridge.send, 1, 0, 245_000 - 0.1)


def test_a_wrong_baud_rate_on_the_port_gives_garbage(board, taken):
    bridge = board.bridge
    bridge.strict_baud = False
    bridge.host_baud = 115_200
    for byte in range(100):
        bridge.send(byte, 0, 250_000)
    assert bridge.garbled == len(taken) == 100
    assert sum(a == b for a, b in zip(taken, range(100), strict=True)) < 5


def test_a_host_that_does_not_read_costs_what_the_ring_cannot_hold(board, taken):
    bridge = board.bridge
    bridge.stop_reading(PS_PER_S)
    for byte in range(200):
        bridge.send(byte, board.machine.now_ps, 250_000)
    assert (taken, bridge.lost_in_bridge) == ([], 72)
    board.machine.advance(PS_PER_S)
    assert taken == list(range(128))
    assert bridge.delivered == 128


def test_bytes_are_lost_by_number_or_by_chance(board, taken):
    bridge = board.bridge
    bridge.lose_next(3)
    for byte in range(5):
        bridge.send(byte, 0, 250_000)
    assert taken == [3, 4]
    bridge.lose_randomly(0.5, PS_PER_S)
    for _ in range(1000):
        bridge.send(7, 1, 250_000)
    assert 400 < bridge.lost_by_fault < 600
    assert bridge.lost_by_fault + bridge.delivered == 1005


SEND = """
  full_speed
  uart_on {divider}
  store 0x400E081C, 0x41
  wait 0x400E0814, 0x200
  wait_forever
"""


def test_a_byte_goes_all_the_way_to_the_host():
    assert run(SEND.format(divider=21)).received == b"A"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (SEND.format(divider=22), "sends at 238636 baud; the host listens at 250000"),
        (
            SEND.format(divider=21).replace("store 0x400E081C", "store 0x400E0E00, 0x200\n store 0x400E081C"),
            "PA9",
        ),
    ],
)
def test_a_wrong_divider_or_a_pin_that_is_not_given_ends_the_run(text, reason):
    with pytest.raises(EmulationFault, match=reason):
        run(text)
