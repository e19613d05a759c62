"""Checks of the machine: the program and its packages, the clock, udev, ModemManager, the service."""

import platform
from collections.abc import Iterator

from fltea.diagnostics.finding import Finding, ok, problem, warning
from fltea.diagnostics.host_system import System
from fltea.machine.devices import find_ports
from fltea.records.version import __version__
from fltea.settings.config import Config
from fltea.settings.extras import how_to_install
from fltea.settings.outputs import OUTPUTS
from fltea.wire import layout as wire

RULE = "70-fltea.rules"
RULE_FOLDERS = ("/etc/udev/rules.d", "/run/udev/rules.d", "/usr/lib/udev/rules.d", "/lib/udev/rules.d")
INSTALL_RULE = "sudo make install-udev, in a clone of fltea; then plug the board in again."
UNIT = "fltea.service"
PACKAGES = {output.extra: output.library for output in OUTPUTS if output.extra}
"""Library that each optional dependency ("extra") of fltea's package installs, by the extra's name."""


def check_program() -> Iterator[Finding]:
    """Yield findings on the program's version, and on the native module."""
    yield ok(
        "program",
        f"fltea {__version__}, protocol {wire.PROTOCOL_MAJOR}.{wire.PROTOCOL_MINOR}, Python "
        f"{platform.python_version()} on {platform.machine()}",
    )
    try:
        from fltea import _native
    except ImportError as error:
        remedy = "install fltea again: make setup in a clone."
        yield problem("native", f"the estimator's native module cannot be loaded ({error}).", remedy)
        return
    if wire.SCHEMA_HASH != _native.SCHEMA_HASH:
        remedy = "build it again: make setup in a clone."
        yield problem("native", "the native module was built from another version of the protocol.", remedy)
        return
    yield ok("native", f"the estimator's native module uses {_native.instruction_sets()[0]}")


def check_packages(config: Config, system: System) -> Iterator[Finding]:
    """Yield a finding on the Python packages that outputs need.

    A missing package is a problem if an output that needs it is switched on.
    """
    asked = {output.extra for output in OUTPUTS if output.is_on(config)}
    missing = [extra for extra, module in PACKAGES.items() if not system.has_module(module)]
    needed = [extra for extra in missing if extra in asked]
    if needed:
        yield problem(
            "packages",
            f"the configuration needs what is not installed: {', '.join(needed)}.",
            f"{how_to_install(*needed)}.",
        )
    elif missing:
        yield ok(
            "packages",
            f"not installed, and not asked for: {', '.join(missing)} ({how_to_install('outputs')})",
        )
    else:
        yield ok("packages", f"all outputs can be used: {', '.join(PACKAGES)}")


def check_clock(system: System) -> Iterator[Finding]:
    """Yield a finding on the machine's clock, which has to be synchronised for correct time stamps."""
    match system.clock_is_kept():
        case True:
            yield ok("clock", "this machine's clock is synchronised")
        case False:
            yield warning(
                "clock",
                "this machine's clock is not synchronised: time stamps may be wrong, and jump once it is "
                "set. α and f are not affected.",
                "sudo timedatectl set-ntp true.",
            )


def check_udev(system: System) -> Iterator[Finding]:
    """Yield findings on fltea's udev rule and on ModemManager.

    ModemManager writes `AT` to ports of possible modems, so perhaps to a board.
    """
    installed = any(system.exists(f"{folder}/{RULE}") for folder in RULE_FOLDERS)
    if installed:
        yield ok("udev rule", f"{RULE} is installed: a board is /dev/fltea-SERIALNUMBER")
    else:
        yield ok("udev rule", f"{RULE} is not installed; it gives boards names of their own: {INSTALL_RULE}")
    if not system.is_running("ModemManager"):
        yield ok("ModemManager", "does not run")
        return
    boards = [port for port in find_ports(system) if port.is_board]
    if not boards and installed:
        yield ok("ModemManager", f"runs, and {RULE} will keep it away from a Due")
    elif not boards:
        yield warning(
            "ModemManager", "runs, and may write 'AT' to a board when it is plugged in.", INSTALL_RULE
        )
    for port in boards:
        properties = (
            system.run("udevadm", "info", "--query=property", f"--name={port.device}") or ""
        ).split()
        if {"ID_MM_DEVICE_IGNORE=1", "ID_MM_PORT_IGNORE=1"} & set(properties):
            yield ok("ModemManager", f"runs, and is told to leave {port.device} alone")
        else:
            yield warning(
                "ModemManager",
                f"runs, and nothing tells it to leave {port.device} alone: it may write 'AT' to the board "
                "whenever it is plugged in, and hold the port for half a minute.",
                INSTALL_RULE,
            )


def check_service(system: System) -> Iterator[Finding]:
    """Yield a finding on fltea's systemd unit, if there is one."""
    wanted = "LoadState,ActiveState,SubState,Result,NRestarts,UnitFileState"
    output = system.run("systemctl", "show", UNIT, f"--property={wanted}") or ""
    state = dict(line.split("=", 1) for line in output.splitlines() if "=" in line)
    if not state:
        return  # this machine has no systemd
    if state.get("LoadState") != "loaded":
        yield ok("service", "not installed (sudo make install-service, in a clone)")
        return
    restarts = int(state.get("NRestarts") or 0)
    if state.get("ActiveState") == "failed":
        reason = state.get("Result", "unknown")
        yield problem("service", f"{UNIT} failed ({reason}).", "journalctl -u fltea -n 50 tells why.")
    elif restarts:
        yield warning(
            "service",
            f"{UNIT} is {state.get('ActiveState')}, and was restarted {restarts} times since it was started.",
            "journalctl -u fltea tells why.",
        )
    else:
        yield ok("service", f"{UNIT} is {state.get('ActiveState')} ({state.get('SubState')})")
    if state.get("UnitFileState") == "disabled":
        yield warning("service", f"{UNIT} will not start with the machine.", "sudo systemctl enable fltea")
