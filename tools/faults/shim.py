"""Runs `fltea` with a clock that can be set and with simulated USB ports; all else is the real program.

FLTEA_SHIM_CLOCK=FILE   FILE holds an integer of eight bytes, which is added to Unix time [ns]
FLTEA_SHIM_PORTS=FILE   FILE holds the USB ports in JSON: a list of [device, description, hardware id]
"""

import json
import mmap
import os
import struct
import threading
import time
from pathlib import Path

from fltea._native import shift_unix_clock
from fltea.cli.app import main
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

SHIFT_S = 0.001
"""Time between two updates of the clock shift in the native code that reads serial ports [s]."""


def set_clock_by(path: Path) -> None:
    """Shift the program's Unix time by the value in a file; other clocks stay unchanged."""
    with path.open("rb") as file:
        step = mmap.mmap(file.fileno(), 8, access=mmap.ACCESS_READ)

    def step_ns() -> int:
        (ns,) = struct.unpack("<q", step[:])
        return int(ns)

    time_ns, time_s = time.time_ns, time.time
    time.time_ns = lambda: time_ns() + step_ns()
    time.time = lambda: time_s() + step_ns() * 1e-9

    # The native code that reads serial ports gets the time from the system itself, so the shift is set there
    # separately.
    def shift() -> None:
        while True:
            shift_unix_clock(step_ns())
            time.sleep(SHIFT_S)

    shift_unix_clock(step_ns())
    threading.Thread(target=shift, daemon=True).start()


def list_ports_of(path: Path) -> None:
    """Let the program find the USB ports in a file instead of those of the machine."""

    def comports(include_links: bool = False) -> list[ListPortInfo]:
        found = []
        for device, description, hwid in json.loads(path.read_text()):
            port = ListPortInfo(device)
            port.description, port.hwid = description, hwid
            found.append(port)
        return found

    list_ports.comports = comports  # type: ignore[assignment]


if __name__ == "__main__":
    if "FLTEA_SHIM_CLOCK" in os.environ:
        set_clock_by(Path(os.environ["FLTEA_SHIM_CLOCK"]))
    if "FLTEA_SHIM_PORTS" in os.environ:
        list_ports_of(Path(os.environ["FLTEA_SHIM_PORTS"]))
    main()
