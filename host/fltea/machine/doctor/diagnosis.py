"""`fltea doctor`: check everything from the sensor to the outputs, and say what to do.

The checks examine the machine only through `fltea.diagnostics.host_system.System`. The command works
without a board and for any user.
"""

from collections.abc import Iterator, Sequence

import msgspec

from fltea.diagnostics.finding import Finding, refused
from fltea.diagnostics.host_system import System
from fltea.machine.doctor.checks_host import (
    check_clock,
    check_packages,
    check_program,
    check_service,
    check_udev,
)
from fltea.machine.doctor.checks_i2c import check_i2c
from fltea.machine.doctor.checks_outputs import check_outputs
from fltea.machine.doctor.checks_sources import check_source
from fltea.machine.doctor.hearing import HEAR_S
from fltea.service.checks import check_settings
from fltea.settings.config import Config


def examine(configs: Sequence[Config], system: System, hear_s: float = HEAR_S) -> Iterator[Finding]:
    """Run all checks, and yield each finding as soon as it is made.

    `configs`: one configuration for each device, from `load_configs`.
    `hear_s`: how long to listen to a board after its HELLO [s].
    """
    program = configs[0]
    yield from check_program()
    yield from check_packages(program, system)
    yield from refused("settings", lambda: check_settings(configs))
    for config in configs:
        for finding in check_source(config, system, hear_s):
            yield msgspec.structs.replace(finding, device=config.name)
    if not any((config.source or "").startswith("i2c:") for config in configs):
        yield from check_i2c(system, None)
    yield from check_clock(system)
    yield from check_udev(system)
    yield from check_service(system)
    yield from check_outputs(configs, system)
