"""Tests of the emulated Due in extreme cases: interrupts at every instruction, clocks that wrap, and limits
of time and memory.

These tests find functions and variables of the program by their names, so they need its ELF file.
"""

import subprocess
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import pytest
import unicorn
from fltea.wire import layout as wire

from tests.rig.due_support import IMAGE, NOISE, PERIOD_US, DueRun, build, image
from tests.rig.tiers import long_but
from tests.rig.toolchain import needed
from tools.due_emulator.machine import PS_PER_S, PS_PER_US
from tools.due_emulator.memory_map import RAM_BASE
from tools.due_emulator.timers import Timer
from tools.due_emulator.uart import BITS_PER_BYTE

pytestmark = pytest.mark.slow

WRAP = 1 << 32
TICK_COUNTS = PERIOD_US * 42
LED_BIT = 27
HALF_BLINK_US = 1 << 19


class Symbol(NamedTuple):
    """Address and size of a function or variable."""

    address: int
    size: int


@pytest.fixture(scope="module")
def symbols(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Symbol]:
    """Return the functions and variables of the image, by name without namespaces."""
    elf = IMAGE.with_suffix(".elf")
    if not elf.exists():
        folder = tmp_path_factory.mktemp("image")
        assert build("timer", folder) == image(), "the image is not that of the sources"
        elf = folder / "fltea_due.elf"
    return symbols_of(elf)


def symbols_of(elf: Path) -> dict[str, Symbol]:
    nm = needed("arm-none-eabi-nm", "binutils-arm-none-eabi")
    text = subprocess.run([nm, "-CS", elf], capture_output=True, text=True, check=True).stdout
    found = {}
    for line in text.splitlines():
        address, size, kind, name = (*line.split(maxsplit=3), "", "")[:4]
        if len(kind) == 1:
            short = name.replace("(anonymous namespace)::", "").partition("(")[0].removeprefix("fltea::due::")
            found[short] = Symbol(int(address, 16), int(size, 16))
    return found


def variable(run: DueRun, symbol: Symbol) -> memoryview:
    begin = symbol.address - RAM_BASE
    return memoryview(run.board.memory.ram)[begin : begin + 4]


def timer(run: DueRun) -> Timer:
    return next(one for one in run.board.peripherals if isinstance(one, Timer) and one.name == "TC0")


def to_next_tick_ps(run: DueRun) -> int:
    """Return the time until the next tick of the timer, which starts a sample [ps].

    In the first tenth of the period after a tick, return 0, since the program may still have to take that
    tick's sample.
    """
    passed = timer(run).channels[0].value % TICK_COUNTS
    return (TICK_COUNTS - passed) * PS_PER_S // 42_000_000 + PS_PER_US if passed > TICK_COUNTS // 10 else 0


def end_of_transfer_ps(run: DueRun) -> int:
    """Return the time until the UART's DMA controller (PDC) has sent all its bytes [ps]; 0 if it has none."""
    left = run.board.uart.registers["TCR"]
    return (left + 2) * BITS_PER_BYTE * PS_PER_S // wire.BAUD if left else 0


def between_transfers(time_ps: Callable[[DueRun], int]) -> Callable[[DueRun], int]:
    """Return a function that returns the same as `time_ps`, but 0 during a transfer on the I²C bus.

    So no interrupt comes during a transfer. It would make the transfer take longer than is allowed.
    """
    return lambda run: time_ps(run) if run.board.twi.field("SR", "TXCOMP") else 0


class Stretch(NamedTuple):
    """How a test delays one function of the program before each of its instructions.

    `takes_ps`: function that returns the length of the delay [ps]; 0 means no delay now. The delay is as long
    as interrupt handlers would run, or lasts until an interrupt whose handler shares data with the function.
    `times`: largest number of delays before each instruction. `for_s`: longest time that the test waits for
    the program to come to the instruction [s].
    """

    takes_ps: Callable[[DueRun], int]
    times: int = 1
    for_s: float = 0.02


STRETCHES = {
    "DeviceClock::now_us": Stretch(between_transfers(to_next_tick_ps), for_s=0.012),
    # 30 us are longer than a byte takes on the bus, so the program is late for the next byte.
    "Twi::receive": Stretch(lambda _: 30 * PS_PER_US, times=40),
    "Twi::read": Stretch(lambda _: 20 * PS_PER_US, times=4),
    "Uart::room": Stretch(end_of_transfer_ps, for_s=0.11),
    "Uart::write": Stretch(end_of_transfer_ps, for_s=0.11),
    "wake::sleep_unless_signalled": Stretch(to_next_tick_ps),
}


def interrupted(run: DueRun, address: int, stretch: Stretch) -> int:
    """Let interrupts come before the instruction at an address, and return how often they came."""
    cpu, came, end_s = run.board.cpu, 0, run.board.now_s + stretch.for_s

    def come() -> None:
        nonlocal came, end_s
        # While interrupts are disabled (PRIMASK), none can come before this instruction. The code that
        # disables interrupts is tested separately.
        if not cpu.masked and came < stretch.times and (takes_ps := stretch.takes_ps(run)):
            came, end_s = came + 1, run.board.now_s + takes_ps / PS_PER_S
            cpu.hang(takes_ps)

    cpu.breakpoint(address, come)
    while end_s - run.board.now_s > 1e-6:
        run.board.run_until(min(end_s, run.board.now_s + 0.002))
    run.board.run_until(end_s + 0.001)
    return came


def lengths_of_reads(run: DueRun, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list to which each transfer from now on appends the number of bytes that the sensor gave."""
    lines, lengths, bytes_read = run.board.lines, [], [0]
    read, stop = lines.read, lines.stop

    def count(ack: bool) -> int:
        bytes_read[0] += 1
        return read(ack)

    def note() -> None:
        lengths.append(bytes_read[0])
        bytes_read[0] = 0
        stop()

    monkeypatch.setattr(lines, "read", count)
    monkeypatch.setattr(lines, "stop", note)
    return lengths


@pytest.mark.parametrize("name", long_but(list(STRETCHES)[::3], STRETCHES))
def test_an_interrupt_may_come_at_any_instruction(
    name: str, symbols: dict[str, Symbol], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = DueRun(image(), noise=NOISE).run_until(0.4)
    lengths = lengths_of_reads(run, monkeypatch)
    symbol, came = symbols[name], 0
    for address in range(symbol.address, symbol.address + symbol.size, 2):
        came += interrupted(run, address, STRETCHES[name])
        if not run.board.uart.registers["TCR"] and run.board.uart.field("SR", "TXEMPTY"):
            waiting = bytes(variable(run, symbols["written"])) != bytes(variable(run, symbols["sent"]))
            assert not waiting, f"0x{address:08X}: bytes wait, and the line is idle"
    run.board.cpu.breakpoint(None)
    run.run_until(run.board.now_s + 1.5)
    assert came > 0, "nothing was interrupted"
    assert run.check() is None
    assert (run.gaps, run.epochs, run.faults, run.status.i2c_errors) == ([], ["start"], [], 0)
    assert set(lengths) == {5, 14}, "more was read than is needed"
    assert all(abs(b.device_us - a.device_us - PERIOD_US) < 900 for a, b in pairwise(run.samples))


SHARED = {
    "tick_us": unicorn.UC_HOOK_MEM_READ,
    "tick_count": unicorn.UC_HOOK_MEM_READ,
    "sent": unicorn.UC_HOOK_MEM_READ,
    "in_flight": unicorn.UC_HOOK_MEM_READ,
    "written": unicorn.UC_HOOK_MEM_WRITE,
}
"""Variables that interrupt handlers and the main loop share. For each variable, the kind of access (read or
write) that the main loop may make only while interrupts are disabled (under a lock).
"""


@pytest.mark.parametrize("name", SHARED)
def test_what_is_shared_with_a_handler_is_used_under_a_lock(name: str, symbols: dict[str, Symbol]) -> None:
    run = DueRun(image()).run_until(0.4)
    cpu, uses, unlocked = run.board.cpu, [0], []

    def on_use(pc: int) -> None:
        uses[0] += 1
        if not cpu.active_exceptions and not cpu.masked:
            unlocked.append(f"0x{pc:08X}")

    cpu.watch_data(symbols[name].address, SHARED[name], on_use)
    run.run_until(0.6)
    assert run.error is None
    assert uses[0] > 20
    assert unlocked == []


class Wrap(NamedTuple):
    """A number of the program that a test lets wrap at 2^32 soon after the start.

    `variables`: new values of variables, which they get when the program begins. `counter`: whether the
    timer's counter wraps, too. If the clock wraps within 3 s, the counter wraps together with the clock,
    otherwise 2.4 s after the start.
    """

    variables: dict[str, int]
    counter: bool = False


CLOCK = {"tick_us": WRAP // PERIOD_US * PERIOD_US - 2_900_000}
WRAPS = {
    "the counter, every 102 s": Wrap({}, counter=True),
    "the clock, every 71.6 minutes": Wrap(CLOCK),
    "bytes, after 8 days": Wrap({"written": WRAP - 9000, "sent": WRAP - 9000}),
    # After 2^32 ms, the clock in microseconds wraps for the thousandth time and the timer's counter for the
    # 42,000th time. The program has no other variable that could wrap at that time.
    "milliseconds, after 49.7 days": Wrap(CLOCK, counter=True),
    "signals, after 16 months": Wrap({"wake::count": WRAP - 300}),
}


def begin_before(wrap: Wrap, run: DueRun, symbols: dict[str, Symbol]) -> None:
    def set_variables() -> None:
        for name, value in wrap.variables.items():
            variable(run, symbols[name])[:] = value.to_bytes(4, "little")
        run.board.cpu.breakpoint(None)

    run.board.cpu.breakpoint(symbols["main"].address, set_variables)
    if wrap.counter:
        run.run_until(0.4)
        left_us = WRAP - int.from_bytes(variable(run, symbols["tick_us"]), "little")
        advance_counter(run, symbols, left_us if left_us < PS_PER_S // PS_PER_US * 3 else 2_000_300)


def advance_counter(run: DueRun, symbols: dict[str, Symbol], left_us: int) -> None:
    """Advance the timer's counter so that it wraps `left_us` [us] after the last tick of the timer.

    The count of the last tick, which the program keeps, and the count of the next tick (register RC0) are
    advanced by as much, so that the program does not notice.
    """
    channel, registers = timer(run).channels[0], timer(run).registers
    count = variable(run, symbols["tick_count"])
    ahead = (WRAP - left_us * 42 - int.from_bytes(count, "little")) % WRAP
    count[:] = (WRAP - left_us * 42).to_bytes(4, "little")
    registers["RC0"] = (registers["RC0"] + ahead) % WRAP
    channel._counter.restart(channel.value + ahead)
    channel.compare_changed()


@pytest.mark.parametrize("wrap", long_but(list(WRAPS)[::3], WRAPS))
def test_a_number_that_wraps_changes_nothing(wrap: str, symbols: dict[str, Symbol]) -> None:
    run = DueRun(image(), noise=NOISE)
    begin_before(WRAPS[wrap], run, symbols)
    run.run_until(6)
    assert (run.error, run.gaps, run.epochs, run.faults) == (None, [], ["start"], [])
    for name in [*WRAPS[wrap].variables, *["tick_count"] * WRAPS[wrap].counter]:
        assert int.from_bytes(variable(run, symbols[name]), "little") < WRAP // 16, f"{name} did not wrap"
    stats = run.stats.sample_counts
    assert (stats.delivered, stats.lost) == (run.boots[0].due, 0)
    assert all(abs(b.device_us - a.device_us - PERIOD_US) <= 50 for a, b in pairwise(run.samples))
    assert all(sample.flags == 0 for sample in run.samples)
    for kind in (wire.Hello, wire.Status):
        arrivals = run.of(kind)[2:]
        assert len(arrivals) >= 3
        assert all(0.98 < b.at_s - a.at_s < 1.02 for a, b in pairwise(arrivals))
    arrivals = run.of(wire.Sample)
    for a, b in pairwise(arrivals):
        assert b.at_s - a.at_s == pytest.approx(
            (b.frame.device_us - a.frame.device_us) % WRAP * 1e-6, abs=5e-3
        )


@cache
def with_fits() -> tuple[DueRun, list[tuple[float, int]]]:
    """Return a run with noise fits in its last seconds, and all changes of the pins of controller PIOB with
    their times.
    """
    run, changes = DueRun(image(), noise=NOISE), []
    run.board.pios["PIOB"].on_output = lambda bit, _: changes.append((run.board.now_s, bit))
    return run.run_until(18), changes


@pytest.mark.long
def test_the_stack_keeps_clear_of_its_limit() -> None:
    """The memory of the stack has room for three things: its deepest use in a run, a handler's frames on top
    of that, and a reserve.
    """
    run, _ = with_fits()
    assert run.error is None
    reserved = int.from_bytes(image()[:4], "little") - RAM_BASE
    assert run.board.memory.stack_depth_bytes() + 256 <= reserved


def test_the_led_on_pin_13_blinks_and_no_other_pin_is_driven() -> None:
    run, changes = with_fits()
    # At boot, the program drives the two pins of the I2C bus to free the bus, so the first 0.1 s are left
    # out.
    later = [(at_s, bit) for at_s, bit in changes if at_s > 0.1]
    assert {bit for _, bit in later} == {LED_BIT}
    assert len(later) == pytest.approx(run.board.now_s * 1e6 / HALF_BLINK_US, abs=2)
    assert all(abs(b - a - HALF_BLINK_US * 1e-6) < 0.011 for (a, _), (b, _) in pairwise(later))


def test_the_bus_keeps_the_times_of_fast_mode() -> None:
    """NXP UM10204, table 10, demands that SCL is low for at least 1.3 us and high for at least 0.6 us.

    The clock of the bus has the full rate of 400 kHz.
    """
    twi = with_fits()[0].board.twi
    low_s, high_s = twi.half_bits_s
    assert low_s >= 1.3e-6
    assert high_s >= 0.6e-6
    assert twi.scl_hz == pytest.approx(400_000, rel=1e-3)


def test_the_flash_reads_ahead_again_once_the_identifier_is_known() -> None:
    """SCOD is a bit of the flash controller's register FMR that disables the optimised reading of sequential
    code, so the program runs more slowly while it is set. The program sets SCOD to read the chip's unique
    identifier, and has to clear it afterwards.
    """
    assert with_fits()[0].board.flash_controllers[0].field("FMR", "SCOD") == 0
