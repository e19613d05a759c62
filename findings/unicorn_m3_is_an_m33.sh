#!/usr/bin/env bash
# library: unicorn 2.1.4
# expected: with UC_MODE_MCLASS and uc_ctl_set_cpu_model(UC_CPU_ARM_CORTEX_M3), the way that the project's issues show
#   (https://github.com/unicorn-engine/unicorn/issues/1786), code runs as on a Cortex-M3. That has no UMAAL and no
#   floating point, and STRD at an address that is no multiple of 4 is a UsageFault, always (ARMv7-M Architecture
#   Reference Manual, section A3.2.1).
# seen: the model reads back as 11, a Cortex-M33, without an error; UMAAL and VLDR run. Without UC_MODE_MCLASS the model
#   is the Cortex-M3, and both are refused; but it takes SMLAD still, and an unaligned STRD with either.
# matters: an image of a sensor's board, built for another processor of the family or with a struct that is not aligned,
#   measures for hours in the emulator and stops at its first sample on the board.
# fltea: its emulated Due asks for the model without the mode, sets CPSR after XPSR (else no exception returns), and
#   looks at such instructions itself (tools/due_emulator/refusals.hpp).
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check unicorn==2.1.4

"$folder/venv/bin/python" - <<'PY'
from unicorn import UC_ARCH_ARM, UC_MODE_MCLASS, UC_MODE_THUMB, Uc, UcError
from unicorn import arm_const as arm
from unicorn.unicorn_const import UC_HOOK_INTR

CODE, RAM = 0x1000, 0x2000_0000
SHOWN = {
    "UMAAL r1, r2, r3, r4": "e3fb6412",
    "VLDR s0, [r0]": "90ed000a",
    "SMLAD r1, r2, r3, r4": "22fb0341",
    "STRD r1, r2, [r0, #0]": "c0e90012",
}


def runs(code, mode, address):
    uc = Uc(UC_ARCH_ARM, mode)
    uc.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M3)
    uc.mem_map(CODE, 0x1000)
    uc.mem_map(RAM, 0x1000)
    uc.mem_write(CODE, code + bytes.fromhex("00bf"))
    uc.reg_write(arm.UC_ARM_REG_R0, address)
    exceptions = []
    uc.hook_add(UC_HOOK_INTR, lambda uc, number, _: (exceptions.append(number), uc.emu_stop()))
    try:
        uc.emu_start(CODE | 1, CODE + len(code))
    except UcError:
        return False, uc.ctl_get_cpu_model()
    return not exceptions, uc.ctl_get_cpu_model()


seen = {}
for name, mode in (("with MCLASS", UC_MODE_THUMB | UC_MODE_MCLASS), ("without", UC_MODE_THUMB)):
    for words, code in SHOWN.items():
        address = RAM + (1 if "STRD" in words else 0)
        ran, model = runs(bytes.fromhex(code), mode, address)
        seen[name, words.split()[0]] = ran
        print(f"{name:12} model {model:2}, r0 = 0x{address:08X}: {words:22} {'runs' if ran else 'is refused'}")
        assert model == (arm.UC_CPU_ARM_CORTEX_M33 if mode & UC_MODE_MCLASS else arm.UC_CPU_ARM_CORTEX_M3), "no longer so"
refused = {key for key, ran in seen.items() if not ran}
assert refused == {("without", "UMAAL"), ("without", "VLDR")}, "no longer so"
PY
