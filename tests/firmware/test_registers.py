"""Compare the definitions of registers that firmware and emulator use with facts typed by hand, and with the
description from which they are generated.

The facts are those that programmers of the chip know from the register mapping tables and reset values in the
SAM3X/SAM3A datasheet: chapters EEFC, PIO, PMC, RSTC, TC, TRNG, TWI, UART, WDT, and 9.1 Peripheral
Identifiers.
"""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.rig.toolchain import missing, run_tool

ROOT = Path(__file__).resolve().parents[2]
HEADER = "firmware/due/sam3x.h"
TABLE = "tools/due_emulator/sam3x_registers.json"
SVD = "build/svd/ATSAM3X8E.svd"

ADDRESSES = {
    "EFC0_FMR": ("ReadWrite", 0x400E0A00),
    "EFC0_FCR": ("WriteOnly", 0x400E0A04),
    "EFC0_FSR": ("ReadOnly", 0x400E0A08),
    "EFC1_FMR": ("ReadWrite", 0x400E0C00),
    "PIOA_PDR": ("WriteOnly", 0x400E0E04),
    "PIOB_PER": ("WriteOnly", 0x400E1000),
    "PIOB_PDSR": ("ReadOnly", 0x400E103C),
    "PIOB_MDER": ("WriteOnly", 0x400E1050),
    "PIOB_ABSR": ("ReadWrite", 0x400E1070),
    "PIOB_REHLSR": ("WriteOnly", 0x400E10D4),
    "PMC_PCER0": ("WriteOnly", 0x400E0610),
    "PMC_CKGR_MOR": ("ReadWrite", 0x400E0620),
    "PMC_CKGR_PLLAR": ("ReadWrite", 0x400E0628),
    "PMC_MCKR": ("ReadWrite", 0x400E0630),
    "PMC_SR": ("ReadOnly", 0x400E0668),
    "PMC_PCER1": ("WriteOnly", 0x400E0700),
    "RSTC_SR": ("ReadOnly", 0x400E1A04),
    "TC0_CCR0": ("WriteOnly", 0x40080000),
    "TC0_CMR0": ("ReadWrite", 0x40080004),
    "TC0_CV0": ("ReadOnly", 0x40080010),
    "TC0_RC0": ("ReadWrite", 0x4008001C),
    "TRNG_ODATA": ("ReadOnly", 0x400BC050),
    "TWI1_CR": ("WriteOnly", 0x40090000),
    "TWI1_CWGR": ("ReadWrite", 0x40090010),
    "TWI1_THR": ("WriteOnly", 0x40090034),
    "UART_CR": ("WriteOnly", 0x400E0800),
    "UART_BRGR": ("ReadWrite", 0x400E0820),
    "UART_TPR": ("ReadWrite", 0x400E0908),
    "UART_PTCR": ("WriteOnly", 0x400E0920),
    "WDT_MR": ("ReadWrite", 0x400E1A54),
}
FIELDS = {
    ("EFC0_FCR", "FCMD_STUI"): "14u << 0",
    ("EFC0_FCR", "FKEY_PASSWD"): "90u << 24",
    ("EFC0_FMR", "FWS"): "Field<8, 4>",
    ("PMC_CKGR_MOR", "KEY"): "Field<16, 8>",
    ("PMC_CKGR_MOR", "MOSCSEL"): "1u << 24",
    ("PMC_MCKR", "CSS_PLLA_CLK"): "2u << 0",
    ("PMC_MCKR", "PRES_CLK_2"): "1u << 4",
    ("RSTC_SR", "RSTTYP"): "Field<8, 3>",
    ("TC0_CMR0", "WAVE"): "1u << 15",
    ("TWI1_MMR", "DADR"): "Field<16, 7>",
    ("TWI1_SR", "NACK"): "1u << 8",
    ("UART_MR", "PAR_NO"): "4u << 9",
    ("WDT_MR", "WDD"): "Field<16, 12>",
}
IDENTIFIERS = {"UART": 8, "PIOA": 11, "PIOB": 12, "TWI1": 23, "TC0": 27, "TRNG": 41}
RESETS = {
    ("WDT", "MR"): 0x3FFF2FFF,
    ("PMC", "CKGR_MOR"): 0x00000001,
    ("PMC", "CKGR_PLLAR"): 0x00003F00,
    ("PMC", "MCKR"): 0x00000001,
    ("PMC", "SR"): 0x00010008,
    ("TWI1", "SR"): 0x0000F009,
    ("EFC0", "FSR"): 0x00000001,
    ("SUPC", "MR"): 0x00005A00,
    ("UART", "CR"): None,
    ("PIOB", "PDSR"): None,
}


def header() -> str:
    return (ROOT / HEADER).read_text()


def table() -> dict[str, Any]:
    return dict(json.loads((ROOT / TABLE).read_text()))


def body(register: str) -> str:
    found = re.search(rf"struct {register} : [^{{]*{{(.*?)}};", header(), re.DOTALL)
    assert found, register
    return found[1]


@pytest.mark.parametrize(("register", "fact"), ADDRESSES.items())
def test_address_and_access_mode(register: str, fact: tuple[str, int]) -> None:
    access, address = fact
    assert f"struct {register} : {access}<0x{address:08X}> {{" in header()


@pytest.mark.parametrize(("field", "fact"), FIELDS.items())
def test_field(field: tuple[str, str], fact: str) -> None:
    register, name = field
    assert f" {name} = {fact};" in body(register)


def test_identifiers() -> None:
    for name, number in IDENTIFIERS.items():
        assert f"constexpr uint32_t {name}_IRQ = {number};" in header()
        assert table()[name]["irq"] == number
    assert table()["TC0"]["irqs"] == [27, 28, 29]
    assert table()["RSTC"]["irq"] is None


def test_nothing_in_the_header_is_unused() -> None:
    sources = [path for path in (ROOT / "firmware/due").iterdir() if path.suffix in {".cpp", ".h"}]
    text = "".join(path.read_text() for path in sources if path.name != "sam3x.h")
    for register in re.findall(r"struct (\w+) :", header()):
        assert re.search(rf"\b{register}\b", text), register
        for field in re.findall(r"(?:uint32_t|using) (\w+) =", body(register)):
            assert f"{register}::{field}" in text, f"{register}::{field}"


def test_reset_values_of_the_table() -> None:
    found = {key: table()[key[0]]["registers"][key[1]]["reset"] for key in RESETS}
    assert found == RESETS


def test_arrays_are_expanded() -> None:
    peripherals = table()
    assert peripherals["PMC"]["registers"]["PCK2"]["offset"] == 0x48
    assert peripherals["GPBR"]["registers"]["GPBR7"]["offset"] == 0x1C
    assert peripherals["ADC"]["registers"]["CDR15"]["offset"] == 0x8C
    assert not [name for p in peripherals.values() for name in p["registers"] if "%" in name or "[" in name]


def test_one_register_an_offset_but_for_alternatives() -> None:
    for name, peripheral in table().items():
        main = [r["offset"] for r in peripheral["registers"].values() if "alternate_of" not in r]
        assert len(main) == len(set(main)), name
        for register in peripheral["registers"].values():
            if "alternate_of" in register:
                assert peripheral["registers"][register["alternate_of"]]["offset"] == register["offset"]
    assert table()["TC0"]["registers"]["CMR0_WAVE_EQ_1"]["alternate_of"] == "CMR0"


@pytest.mark.slow
def test_another_description_is_refused(tmp_path: Path) -> None:
    """A vendor's description is refused if its SHA-256 is wrong; here, one address differs."""
    fetched = run_tool("generated", ROOT, "gen_registers", "--check")
    if "could not fetch" in fetched.stderr:
        missing(fetched.stderr)
    for name in (HEADER, SVD):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, tmp_path / name)
    (tmp_path / SVD).write_bytes((ROOT / SVD).read_bytes().replace(b"0x400E0800", b"0x400E0804"))
    done = run_tool("generated", tmp_path, "gen_registers")
    assert done.returncode == 1
    assert "SHA-256" in done.stderr
    assert SVD in done.stderr
    assert (tmp_path / HEADER).read_text() == header()
