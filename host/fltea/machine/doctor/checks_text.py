"""Checks of a pipe or a port that sends lines of text."""

import os
from collections.abc import Iterator
from pathlib import Path

from fltea.diagnostics.asked import AskedSource
from fltea.diagnostics.finding import Finding, ok, problem
from fltea.machine.doctor.checks_link import find_usable
from fltea.settings.sources import SERIAL_TEXT, kind_of
from fltea.sources.text_lines import parse_serial


def check_source(asked: AskedSource) -> Iterator[Finding]:
    """Yield whether the pipe or the port can be read. Its lines are not read."""
    path, kind = Path(asked.place), kind_of(asked.url)
    if kind is not None and SERIAL_TEXT in kind.schemes:
        port, _ = parse_serial(asked.place)
        if "://" not in port and (yield from find_usable(asked.system, port)) is None:
            return
    elif path.is_fifo() and not os.access(path, os.R_OK):
        yield problem("source", f"{asked.system.user()} may not read {path}.", f"chmod u+r {path}")
        return
    yield ok("source", f"{asked.url}: lines of text; 'fltea run' tells what is wrong with them")
