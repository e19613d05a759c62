"""`fltea doctor`: check everything from the sensor to the outputs, and say what to do.

The checks examine the machine only through `fltea.machine.host_system.System`. The command works without a
board and for any user.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from urllib.parse import urlsplit

import msgspec

from fltea.machine.doctor.checks_host import (
    check_clock,
    check_packages,
    check_program,
    check_service,
    check_udev,
)
from fltea.machine.doctor.checks_i2c import check_i2c
from fltea.machine.doctor.checks_iio import check_iio
from fltea.machine.doctor.checks_link import check_serial
from fltea.machine.doctor.checks_outputs import check_outputs
from fltea.machine.doctor.finding import Finding, ok, problem
from fltea.machine.doctor.hearing import HEAR_S
from fltea.machine.host_system import System
from fltea.settings.config import Config


def examine(configs: Sequence[Config], system: System, hear_s: float = HEAR_S) -> Iterator[Finding]:
    """Run all checks, and yield each finding as soon as it is made.

    `configs`: one configuration for each device, from `load_configs`.
    `hear_s`: how long to listen to a board after its HELLO [s].
    """
    program = configs[0]
    yield from check_program()
    yield from check_packages(program, system)
    for config in configs:
        for finding in check_source(config, system, hear_s):
            yield msgspec.structs.replace(finding, device=config.name)
    if not any((config.source or "").startswith("i2c:") for config in configs):
        yield from check_i2c(system, None)
    yield from check_clock(system)
    yield from check_udev(system)
    yield from check_service(system)
    yield from check_outputs(configs, system)


def check_source(config: Config, system: System, hear_s: float) -> Iterator[Finding]:
    """Yield findings on the source at a device's URL."""
    url = config.source
    if url is None:
        yield from check_serial(system, None, config.link.baud, hear_s)
        return
    scheme = urlsplit(url).scheme
    match scheme:
        case "i2c":
            yield from check_i2c(system, url)
        case "iio":
            yield from check_iio(system, url.partition(":")[2])
        case "stdin" | "serial-text":
            yield ok("source", f"{url}: lines of text; 'fltea run' tells what is wrong with them")
        case "synthetic":
            yield ok("source", f"{url}: synthetic noise, nothing to check")
        case "replay":
            yield _recording(Path(url.partition(":")[2]))
        case "" if not url.startswith("/dev/") and Path(url).is_file():
            yield _recording(Path(url))
        case _:
            yield from check_serial(system, url.removeprefix("serial:"), config.link.baud, hear_s)


def _recording(file: Path) -> Finding:
    if file.exists():
        return ok("source", f"{file}: a recording, nothing to check")
    return problem("source", f"{file}: there is no such recording.", "check the name.")
