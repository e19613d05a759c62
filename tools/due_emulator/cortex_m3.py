"""The Cortex-M3 that Unicorn emulates: numbers of its registers, and new instances on the chip's memory."""

import ctypes

import unicorn
from unicorn import arm_const

from tools.due_emulator import memory_map
from tools.due_emulator.execution import RegisterNumbers
from tools.due_emulator.memory_map import Memory, address_of

THUMB = 1


def _numbers(names: str) -> RegisterNumbers:
    """Return Unicorn's numbers of the registers with these names, which are separated by spaces."""
    found = [getattr(arm_const, f"UC_ARM_REG_{name}") for name in names.split()]
    return (ctypes.c_int32 * len(found))(*found)


STACKED = _numbers("R0 R1 R2 R3 R12 LR PC XPSR")
UNSTACKED = _numbers("R0 R1 R2 R3 R12 LR SP XPSR")
ENTERED = _numbers("SP LR XPSR")
PC, SP, LR, PRIMASK, BASEPRI, FAULTMASK, CONTROL = _numbers("PC SP LR PRIMASK BASEPRI FAULTMASK CONTROL")


def fresh_processor(memory: Memory) -> unicorn.Uc:
    """Return a new instance of the processor on the chip's memory."""
    # With UC_MODE_MCLASS, Unicorn emulates a Cortex-M33 whatever model is set, including its instructions
    # for signal processing and floating point.
    uc = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB)
    uc.ctl_set_cpu_model(arm_const.UC_CPU_ARM_CORTEX_M3)
    _map(uc, memory)
    return uc


def _map(uc: unicorn.Uc, memory: Memory) -> None:
    code, data = unicorn.UC_PROT_READ | unicorn.UC_PROT_EXEC, unicorn.UC_PROT_ALL
    m = memory_map
    flash, ram = address_of(memory.flash), address_of(memory.ram)
    uc.mem_map_ptr(0, m.BANK_BYTES, unicorn.UC_PROT_READ, flash)
    uc.mem_map_ptr(m.FLASH_BASE, m.FLASH_BYTES, code, flash)
    uc.mem_map_ptr(m.SRAM0_BASE, m.SRAM0_BYTES, data, ram)
    uc.mem_map_ptr(m.RAM_BASE, m.RAM_BYTES, data, ram)
