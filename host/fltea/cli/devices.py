"""The commands `fltea devices` and `fltea doctor`."""

from typing import TYPE_CHECKING, Annotated, Any

import msgspec
import typer

from fltea.cli.output import escaped, print_lines
from fltea.cli.setting_flags import ConfigFile, Sources, takes_settings
from fltea.records.visible import visible, visible_lines

if TYPE_CHECKING:
    from fltea.diagnostics.finding import Finding
    from fltea.machine.devices import Bus, IioDevice, Port

COLOURS = {"ok": typer.colors.GREEN, "warning": typer.colors.YELLOW, "problem": typer.colors.RED}
INDENT = " " * 4
CHECK_WIDTH = 13


def devices(
    probe: Annotated[
        bool,
        typer.Option(
            "--probe",
            help="Ask each free Due for its HELLO. This resets the board.",
        ),
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object per line.")] = False,
) -> None:
    """List boards, serial ports, I²C buses and IIO sensors, who uses them, and whether you may open them.

    For example:

        fltea devices

        fltea devices --probe --json
    """
    from fltea.diagnostics.host_system import System
    from fltea.machine import devices as found

    system = System()
    ports, buses, sensors = found.find_ports(system), found.find_buses(system), found.find_iio(system)
    if probe:
        ports = [_probed(port) for port in ports]
    if json:
        for entry in [*ports, *buses, *sensors]:
            print(escaped(msgspec.json.encode(entry).decode()))
        return
    found_lines = [*map(_port_lines, ports), *map(_bus_lines, buses), *map(_iio_lines, sensors)]
    for lines in found_lines:
        print_lines("\n".join(map(visible, lines)))
    if not any(port.is_board for port in ports):
        print(
            "No Arduino Due on its programming port (the one beside the power socket). Is the cable in, and "
            "does it carry data?\n"
            "'lsusb' and 'dmesg' tell what the machine sees; 'fltea doctor' checks more."
        )


def _probed(port: "Port") -> "Port":
    from fltea.machine.doctor.hearing import hear

    if not port.is_board or port.holders or port.remedy is not None:
        return port
    heard = hear(port.device, hear_s=0.0)
    failure = heard.failure
    return msgspec.structs.replace(port, hello=heard.hello, trouble=failure.message if failure else None)


def _port_lines(port: "Port") -> list[str]:
    facts = [port.kind]
    facts += [port.device] if port.device != port.path else []
    facts += [f"USB {port.usb_id}"] if port.usb_id else []
    facts += [f"serial number {port.serial_number}"] if port.serial_number else []
    lines = [port.path, INDENT + ", ".join(facts), *_in_the_way(port)]
    if port.hello is not None:
        hello = port.hello
        lines.append(f"{INDENT}says HELLO: {hello.firmware_version}, {hello.sensor}, {hello.rate_hz:g} Hz")
    if port.trouble is not None:
        lines.append(f"{INDENT}{port.trouble}")
    if port.is_board and port.remedy is None and not port.holders:
        lines.append(f"{INDENT}fltea run --source serial:{port.path}")
    return lines


def _bus_lines(bus: "Bus") -> list[str]:
    return [bus.path, f"{INDENT}I²C bus{f', {bus.driver}' if bus.driver else ''}", *_in_the_way(bus)]


def _iio_lines(sensor: "IioDevice") -> list[str]:
    facts = [f"{sensor.name}: {' and '.join(sensor.sensors)}, by a driver of the kernel (IIO)"]
    facts += [f"{sensor.rate_hz:g} Hz"] if sensor.rate_hz is not None else []
    facts += [f"trigger {sensor.trigger or 'none'}"] if sensor.trigger is not None else []
    facts += [f"mount matrix {sensor.mount_matrix}"] if sensor.mount_matrix else []
    lines = [sensor.path, INDENT + ", ".join(facts), *_in_the_way(sensor)]
    if sensor.remedy is None and not sensor.holders and "gyroscope" in sensor.sensors:
        lines.append(f"{INDENT}fltea run --source iio:{sensor.name}")
    return lines


def _in_the_way(found: "Port | Bus | IioDevice") -> list[str]:
    """Return lines of text that say why the device cannot be used now."""
    holders = ", ".join(map(str, getattr(found, "holders", ())))
    lines = [] if found.remedy is None else [f"{INDENT}no permission: {found.remedy}"]
    return [*lines, f"{INDENT}in use by {holders}"] if holders else lines


@takes_settings(["record.folder"])
def doctor(
    settings: dict[str, Any],
    source: Sources = None,
    config: ConfigFile = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object per line.")] = False,
) -> None:
    """Check everything from the sensor to the outputs, and say what to do about each problem.

    A port that nobody uses is opened and listened to for some seconds, which resets a Due. Exit code 0 if
    there is no problem (warnings may remain), 1 if there is one.

    For example:

        fltea doctor

        fltea doctor --source serial:/dev/ttyACM0 --record recordings

        fltea doctor --config /etc/fltea/fltea.toml
    """
    from fltea.diagnostics.host_system import System
    from fltea.machine.doctor.diagnosis import examine
    from fltea.settings.config import load_configs

    configs = load_configs(config, settings, source or ())
    problems = warnings = 0
    for finding in examine(configs, System()):
        problems += finding.level == "problem"
        warnings += finding.level == "warning"
        if json:
            print(escaped(msgspec.json.encode(finding).decode()), flush=True)
        else:
            _show(finding, several=len(configs) > 1)
    if not json:
        typer.echo(_summary(problems, warnings))
    if problems:
        raise typer.Exit(1)


def _show(finding: "Finding", several: bool) -> None:
    level = typer.style(f"{finding.level:8}", fg=COLOURS[finding.level], bold=finding.level != "ok")
    name = f"{finding.device}: " if several and finding.device else ""
    typer.echo(f"{level} {finding.check:{CHECK_WIDTH}} {name}{visible_lines(finding.message)}")
    if finding.remedy is not None:
        typer.echo(f"{'':8} {'→':>{CHECK_WIDTH}} {visible_lines(finding.remedy)}")


def _summary(problems: int, warnings: int) -> str:
    if not problems and not warnings:
        return "All is well."
    parts = [
        f"{n} {what}{'s' if n > 1 else ''}" for n, what in ((problems, "problem"), (warnings, "warning")) if n
    ]
    return ", ".join(parts) + "."
