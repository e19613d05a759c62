"""Writes logs of PX4 and ArduPilot as the documents of the two describe them."""

import struct
from collections.abc import Iterable
from typing import Any


def ulog(forms: dict[str, str], topics: Iterable[tuple[str, int]], rows: Iterable[tuple[Any, ...]]) -> bytes:
    """Return a log of PX4, as docs.px4.io describes it ("ULog File Format").

    The log has header, flag bits, formats, subscriptions and data.

    `forms`: fields by message name.
    `topics`: message name and sensor number of each topic.
    `rows`: for each message, the index of its topic in `topics`, the types of its fields as letters of
        `struct`, and its values, of which the first is the timestamp.
    """

    def message(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + message("B", bytes(40))
    for name, form in forms.items():
        out += message("F", f"{name}:uint64_t timestamp;{form}".encode())
    for place, (name, number) in enumerate(topics):
        out += message("A", struct.pack("<BH", number, place) + name.encode())
    return out + b"".join(message("D", struct.pack(f"<HQ{code}", place, *row)) for place, code, *row in rows)


IMU_FORM = "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"
DATAFLASH_LETTERS = {"a": "32h", "n": "4s", "N": "16s", "Z": "64s", "M": "B", "c": "h", "C": "H", "L": "i"}


def dataflash(forms: dict[str, tuple[str, str]], rows: Iterable[tuple[Any, ...]]) -> bytes:
    """Return a log of ArduPilot.

    `forms`: format and columns by message name. `rows`: values of each message, of which the first is the
    message name.
    """
    kinds = {"FMT": (0x80, "BBnNZ", "Type,Length,Name,Format,Columns")}
    kinds |= {name: (0x81 + k, *form) for k, (name, form) in enumerate(forms.items())}
    codes = {
        name: struct.Struct("<" + "".join(DATAFLASH_LETTERS.get(letter, letter) for letter in form))
        for name, (_, form, _) in kinds.items()
    }

    def message(name: str, *values: Any) -> bytes:
        return b"\xa3\x95" + bytes([kinds[name][0]]) + codes[name].pack(*values)

    heads = [
        message("FMT", kind, codes[name].size + 3, name.encode(), form.encode(), columns.encode())
        for name, (kind, form, columns) in kinds.items()
    ]
    return b"".join(heads) + b"".join(message(*row) for row in rows)
