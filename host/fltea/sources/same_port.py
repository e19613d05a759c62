"""Refuse two sources that would read from the same port or sensor.

The second source could not open the port, or each of the two would get a part of the data.
"""

import os
from collections.abc import Sequence

from fltea.records.errors import UsageError
from fltea.settings.config import Config
from fltea.settings.sources import SERIAL, STDIN
from fltea.sources.open_source import named


def check_apart(configs: Sequence[Config]) -> None:
    """Check that no two sources read from the same port of this machine, standard input or sensor.

    Raises:
        UsageError: two sources do, perhaps by different names of the port.
    """
    found: dict[str, str] = {}
    for config in configs if len(configs) > 1 else ():
        source = config.source or ""
        place = _place(source)
        if place in found:
            raise UsageError(
                f"--source {source}: that is {place}, which --source {found[place]} reads already. Only one "
                "source can read from it: name it once."
            )
        if place:
            found[place] = source


def _place(source: str) -> str:
    """Return what a source alone can read from; "" if there is no such thing, as for recordings."""
    scheme, place = named(source) if source else ("", "")
    if scheme == "i2c":
        from fltea.sources.i2c.source import parse_url  # the library smbus2 is for Linux only

        bus, address, _ = parse_url(place)
        return f"{os.path.realpath(bus)} at address 0x{address:02X}"
    if scheme == "iio":
        return f"iio:{place.partition('?')[0]}"
    if scheme == STDIN and place in ("", "-", "/dev/stdin"):
        return "the standard input"
    if scheme == "serial-text":
        from fltea.sources.text_lines import parse_serial

        place = parse_serial(place)[0]
    # servers of the network may serve several programs
    is_here = scheme in (SERIAL, STDIN, "serial-text") and ("://" not in place or place.startswith("hwgrep:"))
    return os.path.realpath(place) if is_here and "://" not in place else place if is_here else ""
