"""Checks of a device on a serial port: presence, permission, and what it sends."""

from collections.abc import Generator, Iterator

from fltea.diagnostics.asked import AskedSource
from fltea.diagnostics.finding import Finding, ok, problem, warning
from fltea.diagnostics.host_system import System, permission_remedy
from fltea.machine.devices import NATIVE, NATIVE_REMEDY, Port, find_ports, stable_name
from fltea.machine.doctor.hearing import HEAR_S, Heard, hear
from fltea.records.plus_minus import within
from fltea.records.version import __version__
from fltea.records.visible import visible
from fltea.wire import layout as wire
from fltea.wire.terminal import NO_PORT
from fltea.wire.transport import ANY_BOARD

RATE_TOLERANCE = 0.015
"""Relative tolerance of the measured sampling rate: 1 % for the sensor's oscillator, and 0.5 % since only few
samples are counted.
"""

DRIFT_PPM = 200.0
"""Largest plausible difference between the rates of two crystal clocks, in parts per million."""

DAMAGED_AT_OPENING = 2
"""Largest number of damaged frames that opening the port can cause. More damaged frames mean a bad cable or a
wrong baud rate.
"""

FLASH = "make flash, in the clone that this fltea is from."


def check_serial(system: System, url: str | None, baud: int, hear_s: float = HEAR_S) -> Iterator[Finding]:
    """Yield findings on the device at a serial URL. A `url` of None means the Due that is plugged in."""
    # such a URL, for instance socket://…, does not name a port of this machine
    if url is not None and not url.startswith("/") and url != ANY_BOARD:
        yield from judge(url, hear(url, baud, hear_s))
        return
    device = yield from find_usable(system, url)
    if device is not None:
        yield from judge(device, hear(device, baud, hear_s))


def find_usable(system: System, url: str | None) -> Generator[Finding, None, str | None]:
    """Yield findings on whether a port of this machine can be used; return it, or None if it cannot.

    A `url` of None means the Due that is plugged in.
    """
    ports = find_ports(system)
    port = _the_board(ports) if url in (None, ANY_BOARD) else _port_at(system, ports, str(url))
    if isinstance(port, Finding):
        yield port
        return None
    stays = (
        "" if port.path == url else f"; a name that stays: {port.path}" if port.path != port.device else ""
    )
    yield ok("port", f"{port.device}: {port.kind}{stays}")
    if port.kind == NATIVE:
        yield problem("port", f"{port.device} is the Due's native port.", NATIVE_REMEDY)
        return None
    if port.remedy is not None:
        yield problem("permission", f"{system.user()} may not open {port.device}.", port.remedy)
        return None
    group = system.group_of(port.device)
    yield ok("permission", f"{system.user()} may open {port.device} (group '{group.name if group else '?'}')")
    if port.holders:
        yield _in_use(port)
        return None
    return port.device


def _the_board(ports: list[Port]) -> Port | Finding:
    boards = [port for port in ports if port.is_board]
    if len(boards) == 1:
        return boards[0]
    if boards:
        names = ", ".join(port.path for port in boards)
        return problem("port", f"several boards are plugged in: {names}.", "choose one with --source.")
    native = next((port for port in ports if port.kind == NATIVE), None)
    if native is not None:
        return problem("port", f"{native.device} is the Due's native port.", NATIVE_REMEDY)
    others = ", ".join(f"{port.path} ({port.kind})" for port in ports)
    return problem(
        "port",
        "no Arduino Due on its programming port (USB id 2341:003d or 2a03:003d). "
        + (f"Other ports: {others}." if others else "This machine has no serial port at all."),
        "use the port beside the power socket, and a cable that carries data (many only charge); 'lsusb' and "
        "'dmesg' tell what the machine sees. Without a board: --source 'synthetic:?alpha=0.3&f=-1.5'.",
    )


def _port_at(system: System, ports: list[Port], path: str) -> Port | Finding:
    real = system.path(path).resolve()
    if not real.exists():
        others = ", ".join(port.path for port in ports) or "none"
        remedy = f"check the cable and the name. Ports that exist: {others}."
        return problem("port", f"there is no port {path}.", remedy)
    for port in ports:
        if system.path(port.device).resolve() == real:
            return port
    if not system.is_terminal(path):
        others = ", ".join(port.path for port in ports) or "none"
        return problem("port", f"{path} is {NO_PORT}.", f"name a port. Ports that exist: {others}.")
    device = f"/{real.relative_to(system.root.resolve())}"
    return Port(
        path=stable_name(system, path),
        device=path,
        kind="no serial port that the machine lists (a pseudo-terminal?)",
        usb_id=None,
        serial_number=None,
        remedy=permission_remedy(system, path),
        holders=system.holders(device),
    )


def _in_use(port: Port) -> Finding:
    holders = ", ".join(map(str, port.holders))
    if all("fltea" in holder.program for holder in port.holders):
        return warning(
            "in use",
            f"{port.device} is in use by {holders}, so it is not opened here; see that program's records.",
            "a second fltea run cannot open it: end the first one, or name another port.",
        )
    pids = " ".join(str(holder.pid) for holder in port.holders)
    return problem(
        "in use", f"{port.device} is in use by {holders}.", f"close it, or end it with: kill {pids}"
    )


def judge(port: str, heard: Heard) -> Iterator[Finding]:
    """Yield findings on what the device sent: frames, firmware, sensor, samples and clock."""
    failure = heard.failure
    if not heard.opened:
        text = failure.message if failure else f"{port} did not open in time."
        yield problem("port", text)
        return
    yield _bytes(heard)
    if failure is not None:
        yield problem("firmware", failure.message, FLASH if failure.kind == "version" else None)
    if heard.hello is None:
        return
    yield _firmware(heard)
    yield from _sensor(heard)
    yield from _samples(heard)
    if heard.drift is not None:
        ppm, std_ppm = heard.drift
        text = f"the device's clock against this machine's: {ppm:+.0f} {within(std_ppm, ' ppm')}"
        if abs(ppm) > DRIFT_PPM + 3 * std_ppm:
            yield warning(
                "clock drift",
                f"{text}; two crystals differ by at most {DRIFT_PPM:g} ppm.",
                "listen again; if it stays, the firmware was built for another crystal, or this machine's "
                "clock is being adjusted.",
            )
        else:
            yield ok("clock drift", text)


def _bytes(heard: Heard) -> Finding:
    link = heard.link
    text = f"{link.bytes} bytes, {link.frames} valid frames"
    bad = link.damaged
    if sum(bad.values()) <= DAMAGED_AT_OPENING:
        return ok("frames", text) if link.frames else problem("frames", f"{text}.")
    reasons = ", ".join(f"{n} {reason}" for reason, n in bad.items())
    tell = warning if link.frames else problem
    return tell(
        "frames",
        f"{text}, and damaged ones: {reasons}.",
        f"is the baud rate that of the firmware ({wire.BAUD})? Try another cable, and no hub; nothing else "
        "may write to the port.",
    )


def _firmware(heard: Heard) -> Finding:
    hello = heard.hello
    assert hello is not None
    firmware = visible(hello.firmware_version or "")
    same = hello.schema_hash == f"0x{wire.SCHEMA_HASH:08X}"
    beside = "as this program" if same else "which is not this program's: fltea ignores what it does not know"
    text = f"{firmware}, protocol {hello.protocol}, schema {hello.schema_hash}, {beside}"
    version = firmware.split(" ", 1)[0]
    if version != __version__:
        return warning(
            "firmware", f"{text}; but it is version {version}, and this fltea {__version__}.", FLASH
        )
    return ok("firmware", text)


def _sensor(heard: Heard) -> Iterator[Finding]:
    hello = heard.hello
    assert hello is not None
    reported = [trouble for trouble in heard.troubles if not trouble.fatal]
    for trouble in reported:
        tell = problem if trouble.kind == "device_fault" else warning
        yield tell("sensor", trouble.message)
    if not reported and hello.who_am_i:
        scale = f"±{hello.gyro_range_dps:g} deg/s, {hello.gyro_lsb_per_dps:g} LSB per deg/s"
        yield ok("sensor", f"{hello.sensor} (WHO_AM_I 0x{hello.who_am_i:02X}), {scale}")
    elif not reported:
        yield problem(
            "sensor",
            "the board has found no sensor.",
            "check the sensor's wires: firmware/README.md, Wiring.",
        )


def _samples(heard: Heard) -> Iterator[Finding]:
    hello, status, rate_hz = heard.hello, heard.status, heard.rate_hz
    assert hello is not None
    if rate_hz is None:
        yield problem(
            "samples", "HELLO came, but no samples.", "is the sensor wired up? 'fltea inspect' shows frames."
        )
        return
    rates = f"{rate_hz:.2f} Hz ({hello.rate_hz:g} stated)"
    text = f"{heard.delivered} in {heard.seconds:.1f} s, {rates}, {heard.lost} lost"
    if abs(rate_hz / hello.rate_hz - 1) > RATE_TOLERANCE:
        yield warning(
            "samples",
            f"{text}.",
            "the sensor's clock is wrong (a clone?), or settings.h states another rate.",
        )
    elif heard.lost:
        remedy = "is this machine overloaded, or the board behind a slow hub?"
        yield warning("samples", f"{text}.", remedy)
    else:
        yield ok("samples", text)
    if status is None:
        return
    counts = {
        "dropped frames": status.dropped_frames,
        "overruns": status.overruns,
        "I²C errors": status.i2c_errors,
        "bus recoveries": status.bus_recoveries,
    }
    found = ", ".join(f"{n} {what}" for what, n in counts.items() if n)
    since = f"since its start (reset cause: {status.reset_cause})"
    if found:
        yield warning(
            "board", f"{found} {since}.", "what each means: firmware/README.md; most often a loose wire."
        )
    else:
        yield ok("board", f"no dropped frames, no overruns, no I²C errors {since}")


def check_source(asked: AskedSource) -> Iterator[Finding]:
    """Yield findings on the board at a port, or on the Due that is plugged in."""
    # a URL of pyserial and the path of a port are their own places
    place = None if asked.url is None else asked.place
    yield from check_serial(asked.system, place, asked.config.link.baud, asked.hear_s)
