"""Checks of a Raspberry Pi's I²C bus, and of the sensor on the bus."""

import errno
from collections.abc import Iterator

from fltea.diagnostics.asked import AskedSource
from fltea.diagnostics.finding import Finding, ok, problem, warning
from fltea.diagnostics.host_system import System, permission_remedy
from fltea.machine.devices import find_buses, is_raspberry_pi
from fltea.records.errors import UsageError
from fltea.sources.i2c.bus import detect_command
from fltea.sources.i2c.chip import Family
from fltea.sources.i2c.chips import ADDRESSES, CHIPS, ask_identity
from fltea.sources.i2c.url import parse_url
from fltea.wire.sensors import SENSORS, known_sensors, sensor_name

FASTEST_HZ = 400_000
ENABLE = "sudo raspi-config nonint do_i2c 0, then reboot (elsewhere: dtparam=i2c_arm=on in config.txt)."


def check_i2c(system: System, url: str | None) -> Iterator[Finding]:
    """Yield findings on the I²C bus of an `i2c:` URL. If `url` is None, check the buses of a Raspberry Pi."""
    if url is None:
        if is_raspberry_pi(system):
            buses = ", ".join(bus.path for bus in find_buses(system))
            yield ok(
                "i2c", f"buses: {buses}" if buses else f"off, and not asked for; to switch it on: {ENABLE}"
            )
        return
    try:
        bus, address, _ = parse_url(url.removeprefix("i2c:"))
    except UsageError as error:
        yield problem("i2c", str(error))
        return
    if not system.exists(bus):
        others = ", ".join(found.path for found in find_buses(system))
        other = f" There is {others}." if others else ""
        yield problem("i2c", f"there is no bus {bus}.{other}", ENABLE)
        return
    remedy = permission_remedy(system, bus)
    if remedy is not None:
        yield problem("i2c", f"{system.user()} may not open {bus}.", remedy)
        return
    yield from _speed(system, bus)
    yield from _chip(system, bus, address)


def _speed(system: System, bus: str) -> Iterator[Finding]:
    name = bus.rsplit("/", 1)[-1]
    content = system.read(f"/sys/bus/i2c/devices/{name}/of_node/clock-frequency")
    if content is None or len(content) != 4:
        yield ok("i2c", f"{bus} is there and may be used")
        return
    speed_hz = int.from_bytes(content, "big")
    text = f"{bus} is there and may be used; {speed_hz / 1000:g} kHz"
    if speed_hz > FASTEST_HZ:
        remedy = "dtparam=i2c_arm_baudrate=400000 in config.txt, then reboot."
        yield warning("i2c", f"{text}, but the chip allows at most {FASTEST_HZ // 1000}.", remedy)
    else:
        yield ok("i2c", text)


def _who_am_i(system: System, bus: str, address: int) -> int:
    def ask(family: Family) -> int:
        return system.read_i2c_register(bus, address, family.who_am_i & 0xFF)

    return ask_identity(ask, CHIPS.values())[0]


def _chip(system: System, bus: str, address: int) -> Iterator[Finding]:
    answers: dict[int, int] = {}
    for candidate in {address: None, **dict.fromkeys(ADDRESSES)}:
        try:
            answers[candidate] = _who_am_i(system, bus, candidate)
        except OSError as error:
            if error.errno == errno.EBUSY:
                yield ok(
                    "sensor",
                    f"a driver of the kernel uses the chip at 0x{candidate:02X}; fltea did not ask it",
                )
                return
    where = f"{bus}, address 0x{address:02X}"
    if address not in answers:
        elsewhere = next((other for other, who in answers.items() if who in SENSORS), None)
        if elsewhere is not None:
            yield problem(
                "sensor",
                f"no chip answers at {where}, but at 0x{elsewhere:02X}: {sensor_name(answers[elsewhere])}.",
                f"--source 'i2c://{bus}?addr=0x{elsewhere:02X}' ({ADDRESSES[address]} gives address "
                f"0x{address:02X}).",
            )
        else:
            yield problem(
                "sensor",
                f"no chip answers at {where}.",
                "VCC to 3.3 V (pin 1), SDA to GPIO 2 (pin 3), SCL to GPIO 3 (pin 5), GND (pin 6); "
                f"'{detect_command(bus)}' shows what answers.",
            )
        return
    who = answers[address]
    name = f"{sensor_name(who)} answers at {where}"
    sensor = SENSORS.get(who)
    if sensor is None:
        remedy = "another chip, or a bad contact on SDA?"
        yield problem("sensor", f"{name}: no {known_sensors()}.", remedy)
    elif sensor.note:
        yield warning("sensor", f"{name}: {sensor.note}")
    else:
        yield ok("sensor", name)


def check_source(asked: AskedSource) -> Iterator[Finding]:
    """Yield findings on the bus and the chip."""
    return check_i2c(asked.system, asked.url)
