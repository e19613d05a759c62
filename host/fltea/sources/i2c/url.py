"""Reads the URL of a sensor on an I²C bus: `i2c:///dev/i2c-1?addr=0x68`."""

from typing import NamedTuple
from urllib.parse import parse_qsl, urlsplit

from fltea.records.errors import UsageError
from fltea.sources.i2c.chips import ADDRESSES, CHIPS


class Place(NamedTuple):
    """Parts of the URL: path of the bus, address of the sensor, and the sensor's family.

    The family is "" if the user does not give it.
    """

    path: str
    address: int
    chip: str = ""


def parse_url(rest: str) -> Place:
    """Return bus, address and family of the sensor, from the part of the URL after `i2c:`.

    Raises:
        UsageError: the URL is wrong; the message says where.
    """
    usual = "Give for instance 'i2c:///dev/i2c-1?addr=0x68' (in quotes, for the shell knows '?' too)"
    try:
        parts = urlsplit(rest)
    except ValueError:  # brackets that do not close
        parts = urlsplit("")
    if parts.netloc or not parts.path.startswith("/dev/") or parts.fragment:
        raise UsageError(f"i2c:{rest}: not the path of a bus such as /dev/i2c-1. {usual}.")
    keys = dict(parse_qsl(parts.query, keep_blank_values=True))
    if unknown := sorted(keys.keys() - {"addr", "chip"}):
        raise UsageError(f"i2c:{rest}: there is no key '{unknown[0]}'; it takes addr and chip. {usual}.")
    chip, text = keys.get("chip"), keys.get("addr", "0x68")
    if chip not in (None, *CHIPS):
        raise UsageError(
            f"i2c:{rest}: chip is {' or '.join(CHIPS)}, not '{chip}'. Without the key, the chip is asked."
        )
    try:
        address = int(text, 0)
    except ValueError:
        address = 0
    if address not in ADDRESSES:
        known = " or ".join(f"0x{one:02X} ({how})" for one, how in ADDRESSES.items())
        raise UsageError(f"i2c:{rest}: addr is {known}, not '{text}'. {usual}.")
    return Place(parts.path, address, chip or "")
