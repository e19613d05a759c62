"""Runs slices of a program in C++. A slice is a sequence of instructions that no exception interrupts.

`execution.cpp` explains how.

The structs in this module have the same fields as those of `execution.hpp`.
"""

import ctypes
import hashlib
import mmap
import os
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

import unicorn
from fltea.records.errors import UsageError
from unicorn import arm_const
from unicorn.unicorn_py3.unicorn import uclib

from tools.due_emulator.machine import NEVER_PS, PS_PER_S
from tools.due_emulator.memory_map import FLASH_BASE, FLASH_BYTES, address_of
from tools.due_emulator.quick_reads import QuickReads

SOURCE = Path(__file__).with_suffix(".cpp")
FOLDER = Path(__file__).parents[2] / "build" / "due_emulator"
COMMAND = ("c++", "-std=c++11", "-O2", "-fPIC", "-shared", "-Wall", "-Wextra", "-Wconversion", "-Werror")
NOWHERE = 1
"""An odd number, which stands for "no address", since no instruction can be at an odd address."""
NO_INTERRUPT = (1 << 64) - 1
ACCESS_CYCLES = 4
"""Duration of an access to a peripheral through the bus bridge [cycles]. On the real chip the duration
varies; the value here is a round number.
"""
WAITING_INSTRUCTIONS = 200
"""Largest number of instructions in a slice while an interrupt waits because its priority is too low. They
take 2.4 us at 84 MHz.

The register BASEPRI holds such interrupts back. Any instruction may change it, and Unicorn does not report
this. So slices are short then, and BASEPRI is checked after each slice.
"""
POLL_PCS = 8
POLL_NEAR_PS = 25_000_000
POLL_STEP_PS = 10_000_000
"""Constants of the rules for polls. A poll is a read by which the program only waits, so time may be skipped.

A read is a poll if the same instruction has read the same value shortly before, and if nothing was written in
between. The reads of up to POLL_PCS instructions are remembered for this.

After a poll, time jumps to the next event if this is at most POLL_NEAR_PS away (about the time of a byte on a
wire). Otherwise time advances by POLL_STEP_PS. Waiting is therefore cheap to emulate, and no event on a wire
is delayed.

Some loops count their iterations, for example to give up after 1000. Their reads are no polls: if time were
skipped, 1000 iterations would last too long. Such a loop is recognised because a register changes in each
iteration, although all reads give the same values.
"""
NUMBERS = 16
MOST_AT_ONCE = 8
"""Largest number of registers of the processor that one call reads or sets."""
RegisterNumbers = ctypes.Array[ctypes.c_int32]

REASONS = {
    unicorn.UC_ERR_INSN_INVALID: "undefined instruction",
    unicorn.UC_ERR_READ_UNMAPPED: "read of an address where nothing is",
    unicorn.UC_ERR_WRITE_UNMAPPED: "write to an address where nothing is",
    unicorn.UC_ERR_FETCH_UNMAPPED: "jump to an address where nothing is",
    unicorn.UC_ERR_WRITE_PROT: "write to flash",
    unicorn.UC_ERR_FETCH_PROT: "jump to an address that holds no code (a null pointer?)",
    unicorn.UC_ERR_READ_UNALIGNED: "unaligned read",
    unicorn.UC_ERR_WRITE_UNALIGNED: "unaligned write",
}
"""What Unicorn's errors mean for the emulated program."""
STOPS = {
    2: "SVC instruction: not modelled",
    3: "jump to an address where there must be no code",
    4: "access that the processor refuses (an exclusive one that is not aligned?)",
    7: "BKPT instruction: not modelled",
    17: "instruction of a coprocessor or floating-point unit, which the Cortex-M3 has not",
}
"""For the number of each exception at which Unicorn stops: the cause of the exception."""

REFUSALS = (
    "",
    "unaligned LDM, STM, LDRD, STRD, PUSH, POP, LDREX or STREX: a register holds 0x{:08X}, no multiple of 4",
    "unaligned LDREXH or STREXH: a register holds 0x{:08X}, which is odd",
    "undefined instruction: other processors have it, but the Cortex-M3 does not",
    "division by {}, while CCR.DIV_0_TRP is set",
    "jump to an address without bit 0: the Cortex-M3 runs only Thumb code",
)
"""For each number of the enum `Refusal` in refusals.hpp: the text that says why the run ends."""

ON_READ = ctypes.CFUNCTYPE(ctypes.c_uint64, ctypes.c_uint64, ctypes.c_uint64, ctypes.c_uint64)
ON_WRITE = ctypes.CFUNCTYPE(None, ctypes.c_uint64, ctypes.c_uint64, ctypes.c_uint64, ctypes.c_uint64)
ON_EVENTS = ctypes.CFUNCTYPE(None, ctypes.c_uint64)
ON_LIMIT = ctypes.CFUNCTYPE(None, ctypes.c_uint64, ctypes.c_uint64)
UNICORN = ("mem_read", "emu_start", "emu_stop", "reg_read", "context_save", "context_restore", "ctl")


class Block(ctypes.Structure):
    """Facts about a block of code.

    They are stored in a table that has one entry for each halfword of flash. A block uses the entry of its
    first halfword.
    """

    _fields_ = (
        ("bytes", ctypes.c_uint16),
        ("instructions", ctypes.c_uint16),
        ("aligned", ctypes.c_uint16),
        ("needs_exact", ctypes.c_uint8),
    )


class Space(ctypes.Structure):
    """A range of addresses, and the functions that handle accesses to it."""

    _fields_ = (("execution", ctypes.c_void_p), ("base", ctypes.c_uint64))


def _numbers(names: str) -> list[tuple[str, type]]:
    return [(name, ctypes.c_uint64) for name in names.split()]


def _pointers(names: str) -> list[tuple[str, type]]:
    return [(name, ctypes.c_void_p) for name in names.split()]


# Why more than 12 attributes: each mirrors a variable of the native loop, which is called millions of times.
class Execution(ctypes.Structure):
    """A slice of execution: its progress, its end, and the callbacks for accesses and events.

    Progress:
        `done`: number of instructions that began in this slice.
        `limit`: once `done` reaches it, the slice ends before the next instruction.
        `address`: address of the instruction that began last.
        `slice_ps`: moment when the slice began. `until_ps`: its latest end [ps].
        `longest`: largest number of instructions in the slice.
        `hz`: frequency of the processor's clock.

    State of the machine, which the callbacks keep up to date:
        `next_event_ps`: time of the next event.
        `halted_until_ps`: no instruction runs before this time.
        `waiting`: an interrupt is pending.
        `stops`: the next instruction may not run in this slice.
        `dead`: an error has to be raised.
        `dropped`: an access was not made, because a reset came first.

    Reasons to end the slice:
        `interrupt`: number of the exception that ended it, or NO_INTERRUPT.
        `refusal`: index in REFUSALS of the reason why an instruction was refused, or 0.
        `refused_value`: value of the register because of which it was refused.
        `traps_division`: whether a division by 0 is refused.
        `breakpoint`: on_limit is called before the instruction at this address; or NOWHERE.

    Permissions, which save time and do not change the results:
        `may_be_fast`: Unicorn may run whole blocks of code if nothing has to stop within them.
        `may_be_quick`: C++ may read registers of peripherals without Python.
    """

    _fields_ = (
        *_numbers("done limit address _next _block_end"),
        *_numbers("slice_ps charged_ps hz until_ps longest next_event_ps halted_until_ps"),
        *_numbers("waiting stops dead dropped interrupt"),
        *_numbers("refusal refused_value traps_division"),
        *_numbers(
            "may_be_fast may_be_quick _calm _go_fast breakpoint _fast_block _code_begin _code_end"
            " _recent_count"
        ),
        ("_recent_pcs", ctypes.c_uint64 * POLL_PCS),
        ("_recent_values", ctypes.c_uint64 * POLL_PCS),
        ("_recent_changes", ctypes.c_uint64 * POLL_PCS),
        ("_recent_registers", ctypes.c_uint64 * POLL_PCS),
        *_numbers("_changes"),
        ("_registers", ctypes.c_int32 * NUMBERS),
        *_numbers(
            "_access_cycles _waiting_instructions _poll_near_ps _poll_step_ps _pc_register _epsr_register"
            " _flush_control"
        ),
        *_pointers("_flash"),
        *_numbers("_flash_base _flash_bytes"),
        *_pointers("_quick _blocks _exact _fast _context _fresh"),
        ("_on_read", ON_READ),
        ("_on_write", ON_WRITE),
        ("_on_events", ON_EVENTS),
        ("_on_limit", ON_LIMIT),
        *_pointers(" ".join(f"_{name}" for name in UNICORN)),
    )

    def __init__(
        self,
        flash: mmap.mmap,
        quick: QuickReads,
        *,
        on_read: Callable[[int, int, int], int],
        on_write: Callable[[int, int, int, int], None],
        on_events: Callable[[int], None],
        on_limit: Callable[[int, int], None],
    ) -> None:
        """Set the functions that are called during a slice (instructions that run without an interruption).

        `now_ps`: the virtual time [ps].

        `on_read(now_ps, address, bytes)`, `on_write(now_ps, address, bytes, value)`: accesses to peripherals.
        `on_events(now_ps)`: events are due after an access. `on_limit(now_ps, pc)`: the limit is reached
        before the instruction at `pc`.
        """
        super().__init__()
        self._library = _library()
        self._quick_reads = quick
        self._flash = address_of(flash)
        self._flash_base, self._flash_bytes = FLASH_BASE, FLASH_BYTES
        self._quick = ctypes.addressof(quick)
        self._on_read, self._on_write = ON_READ(on_read), ON_WRITE(on_write)
        self._on_events, self._on_limit = ON_EVENTS(on_events), ON_LIMIT(on_limit)
        self._access_cycles, self._waiting_instructions = ACCESS_CYCLES, WAITING_INSTRUCTIONS
        self._poll_near_ps, self._poll_step_ps = POLL_NEAR_PS, POLL_STEP_PS
        self._pc_register, self._epsr_register = arm_const.UC_ARM_REG_PC, arm_const.UC_ARM_REG_EPSR
        for i in range(NUMBERS):
            self._registers[i] = getattr(arm_const, f"UC_ARM_REG_R{i}")
        self._flush_control = unicorn.UC_CTL_TB_FLUSH | unicorn.UC_CTL_IO_WRITE << 30
        for name in UNICORN:
            setattr(self, f"_{name}", _address_of(getattr(uclib, f"uc_{name}")))
        # Unicorn's Python functions for registers would take ten times as long as these direct calls.
        self._values = (ctypes.c_uint32 * MOST_AT_ONCE)()
        self._first_at = ctypes.byref(self._values)
        places = (ctypes.addressof(self._values) + 4 * i for i in range(MOST_AT_ONCE))
        self._values_at = (ctypes.c_void_p * MOST_AT_ONCE)(*places)
        self.may_be_quick = 1
        self.breakpoint = NOWHERE

    def attach(self, exact: unicorn.Uc, fast: unicorn.Uc, peripherals: dict[int, int]) -> None:
        """Use these two new Unicorn instances, one to run single instructions and one to run whole blocks.

        Both share one memory.

        `peripherals`: size of each range of peripherals, by base address.
        """
        self.forget_reads()
        self._calm = self._code_begin = self._code_end = self.dead = 0
        self._block_table = (Block * (FLASH_BYTES // 2))()
        self._blocks = ctypes.addressof(self._block_table)
        self._processors = (exact, fast)
        self._exact, self._fast = exact._uch, fast._uch
        self._contexts = (exact.context_save(), fast.context_save())
        self._context, self._fresh = (context.context for context in self._contexts)
        functions = self._library
        for uc, kind, function in (
            (exact, unicorn.UC_HOOK_BLOCK, functions.enter_block),
            (exact, unicorn.UC_HOOK_CODE, functions.before_instruction),
            (exact, unicorn.UC_HOOK_INTR, functions.take_interrupt),
            (fast, unicorn.UC_HOOK_BLOCK, functions.enter_block_fast),
            (fast, unicorn.UC_HOOK_INTR, functions.take_interrupt),
        ):
            self._hook(uc, kind, function)
        self._spaces = [Space(ctypes.addressof(self), base) for base in peripherals]
        for space, (base, size) in zip(self._spaces, peripherals.items(), strict=True):
            place, read, write = (
                ctypes.addressof(space),
                functions.read_peripheral,
                functions.write_peripheral,
            )
            _check(
                uclib.uc_mmio_map(exact._uch, base, size, _address_of(read), place, _address_of(write), place)
            )

    def _hook(self, uc: unicorn.Uc, kind: int, function: ctypes._CFuncPtr) -> None:
        # Unicorn's Python method hook_add takes only Python functions, so its C function is called directly.
        handle, everywhere = ctypes.c_size_t(), (ctypes.c_uint64(1), ctypes.c_uint64(0))
        place = ctypes.addressof(self)
        _check(
            uclib.uc_hook_add(uc._uch, ctypes.byref(handle), kind, _address_of(function), place, *everywhere)
        )

    def forget_reads(self) -> None:
        """Forget earlier reads, so that the next read is not taken for one by which the program waits."""
        self._recent_count = 0

    def begin(self, slice_ps: int, hz: int, until_ps: int, longest: int) -> None:
        self._next = self._block_end = 0
        self.begin_again(slice_ps)
        self.hz, self.until_ps, self.longest = hz, min(until_ps, NEVER_PS), longest
        self.address, self.interrupt = NOWHERE, NO_INTERRUPT
        self.dropped = self.refusal = 0

    def begin_again(self, slice_ps: int) -> None:
        """Begin a new slice at the time `slice_ps`: set the count of instructions to 0.

        If native code is running, it goes on.
        """
        self.done, self.slice_ps, self.charged_ps = 0, slice_ps, 0

    def run(self, pc: int) -> int:
        """Run from address `pc` until something ends the slice; return Unicorn's error, or 0."""
        return int(self._library.run(ctypes.byref(self), ctypes.c_uint64(pc)))

    def register(self, number: int) -> int:
        """Return the value of a register of the processor, given Unicorn's number of it."""
        uclib.uc_reg_read(self._exact, number, self._first_at)
        return self._values[0]

    def registers(self, numbers: RegisterNumbers) -> list[int]:
        """Return the values of several registers."""
        uclib.uc_reg_read_batch(self._exact, numbers, self._values_at, len(numbers))
        return self._values[: len(numbers)]

    def set_registers(self, numbers: RegisterNumbers, values: Sequence[int]) -> None:
        """Set several registers, in the order of `numbers`."""
        self._values[: len(values)] = list(values)
        uclib.uc_reg_write_batch(self._exact, numbers, self._values_at, len(numbers))

    def heed_psr(self) -> None:
        """Make the processor notice that its status register XPSR was set.

        Unicorn has a separate note of whether an exception handler runs. Without the right note it does not
        recognise the handler's return. It updates the note only when CPSR is set, so set CPSR to its own
        value.
        """
        uclib.uc_reg_read(self._exact, arm_const.UC_ARM_REG_CPSR, self._first_at)
        uclib.uc_reg_write(self._exact, arm_const.UC_ARM_REG_CPSR, self._first_at)

    def describe_refusal(self) -> str:
        """Return why the processor refused the instruction that ended the slice."""
        return REFUSALS[self.refusal].format(self.refused_value)

    def time_after(self, instructions: int) -> int:
        """Return the virtual time [ps] after this number of instructions of the present slice."""
        return int(self.slice_ps + instructions * PS_PER_S // self.hz + self.charged_ps)


def _check(error: int) -> None:
    if error != unicorn.UC_ERR_OK:
        raise unicorn.UcError(error)


@cache
def _library() -> ctypes.CDLL:
    """Load the native library; compile it first if its sources or the command have changed."""
    text = b"".join(map(Path.read_bytes, sorted(SOURCE.parent.glob("*.[ch]pp")))) + " ".join(COMMAND).encode()
    version = hashlib.sha256(text).hexdigest()[:16]
    library = FOLDER / f"{SOURCE.stem}-{version}.so"
    if not library.exists():
        _compile(library)
    return ctypes.CDLL(str(library))


def _compile(library: Path) -> None:
    library.parent.mkdir(parents=True, exist_ok=True)
    # Another process may compile the library at the same moment, so the finished file is renamed into place.
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        fresh = Path(folder) / library.name
        try:
            subprocess.run([*COMMAND, "-o", fresh, SOURCE], capture_output=True, text=True, check=True)
        except FileNotFoundError as error:
            raise UsageError(f"no C++ compiler '{COMMAND[0]}'; install one (Debian: g++).") from error
        except subprocess.CalledProcessError as error:
            raise UsageError(f"{SOURCE.name} cannot be compiled: {error.stderr}") from error
        os.replace(fresh, library)


def _address_of(function: ctypes._CFuncPtr) -> ctypes.c_void_p:
    return ctypes.cast(function, ctypes.c_void_p)
