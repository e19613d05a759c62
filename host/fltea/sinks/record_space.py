"""The doctor's check of recordings: whether their folder can be written, and how long its room lasts."""

import itertools
import statistics
from collections.abc import Iterator
from pathlib import Path

from fltea.diagnostics.asked import AskedOutput
from fltea.diagnostics.finding import Finding, ok, warning
from fltea.diagnostics.folders import check_writable

DAYS_LEFT = 7.0
TYPICAL_BYTES_PER_S = 32_000.0
"""Rate at which a recording of one device at 100 Hz with all channels grows [bytes/s], as measured."""


def check_space(asked: AskedOutput) -> Iterator[Finding]:
    """Yield findings on the folder of recordings: whether it can be written, and for how long it has room."""
    devices, folder, system = len(asked.configs), Path(asked.program.record.folder or ""), asked.system
    yield from check_writable("recordings", folder)
    free_bytes, known = system.free_bytes(folder), _recording_rate(folder)
    bytes_per_s = known or TYPICAL_BYTES_PER_S * devices
    days = free_bytes / bytes_per_s / 86400
    source = "as the last recordings grew" if known else f"a guess for {devices} at 100 Hz"
    rate = f"{bytes_per_s * 86400 / 1e9:.2g} GB a day, {source}"
    text = f"{free_bytes / 1e9:.1f} GB free for {folder}: {days:.0f} days ({rate})"
    if days < DAYS_LEFT:
        remedy = "move old recordings away, or record to another disk; recording stops while it is full."
        yield warning("disk", f"only {text}.", remedy)
    else:
        yield ok("disk", text)


def _recording_rate(folder: Path) -> float | None:
    """Return the rate at which the last recordings grew [bytes/s]; None if there are too few recordings."""
    try:
        files = [path.stat() for path in folder.rglob("*.mcap")]
    except OSError:
        return None
    files = sorted(files, key=lambda status: status.st_mtime)[-20:]
    rates = [
        status.st_size / (status.st_mtime - before.st_mtime)
        for before, status in itertools.pairwise(files)
        if status.st_mtime - before.st_mtime > 1.0
    ]
    return statistics.median(rates) if rates else None
