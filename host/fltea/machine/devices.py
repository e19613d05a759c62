"""List the devices of this machine: serial ports, I²C buses, and sensors with a kernel driver (IIO)."""

import os

import msgspec
from serial.tools.list_ports_common import ListPortInfo

from fltea.diagnostics.host_system import Holder, System, permission_remedy
from fltea.records.records import Hello
from fltea.sources.iio import sysfs as iio
from fltea.sources.iio.buffer import rate_of
from fltea.wire.transport import DUE_NATIVE_PORT, DUE_PROGRAMMING_PORT, DUE_VENDORS

STABLE = (("/dev", "fltea-*"), ("/dev/serial/by-id", "*"), ("/dev/serial/by-path", "*"))
"""Folders of udev's stable links to serial ports, and patterns of their names. Links that fltea's own udev
rule makes come first.
"""

PROGRAMMING, NATIVE = "Arduino Due, programming port", "Arduino Due, native port"
NATIVE_REMEDY = (
    "the firmware speaks on the programming port, the one beside the power socket: plug the cable in there."
)


class Port(msgspec.Struct, frozen=True, tag_field="class", tag="port"):
    """A serial port.

    `path`: name to use, which is a stable link if there is one. `device`: name of the port in /dev. `remedy`:
    how this user gets permission to use the port; null if the user has it. `holders`: programs that have the
    port open. `hello`, `trouble`: the board's HELLO, or why none came; both are null if the program did not
    listen to the board.
    """

    path: str
    device: str
    kind: str
    usb_id: str | None
    serial_number: str | None
    remedy: str | None
    holders: list[Holder]
    hello: Hello | None = None
    trouble: str | None = None

    @property
    def is_board(self) -> bool:
        """Whether the port is a Due's programming port."""
        return self.kind == PROGRAMMING


class Bus(msgspec.Struct, frozen=True, tag_field="class", tag="i2c_bus"):
    """An I²C bus. `driver`: name of its adapter.

    `remedy`: how this user gets permission to use the bus; null if the user has it.
    """

    path: str
    driver: str
    remedy: str | None


class IioDevice(msgspec.Struct, frozen=True, tag_field="class", tag="iio_device"):
    """A gyroscope or IMU that the kernel has a driver for.

    `path`: node of the device in /dev. `name`: name of the device in a URL. `sensors`: kinds of sensors in
    the device, such as `gyroscope`. `rate_hz`: sampling rate that the driver states [Hz]; null if it states
    none. `trigger`: name of the device's trigger; "" if it has none, null if the chip needs none. `remedy`:
    how this user gets permission to use the device; null if the user has it. `holders`: programs that read
    the device. `mount_matrix`: matrix by which the driver says that the axes of the gyroscope are to be
    rotated (of the accelerometer, if there is no gyroscope); "" if the driver states none.
    """

    path: str
    name: str
    sensors: list[str]
    rate_hz: float | None
    trigger: str | None
    remedy: str | None
    holders: list[Holder]
    mount_matrix: str


def find_iio(system: System) -> list[IioDevice]:
    """Return the gyroscopes and IMUs with a kernel driver that can buffer their samples."""
    imus = [device for device in iio.devices(system.root) if device.is_imu]
    names = [imu.name for imu in imus]
    return [
        IioDevice(
            path=f"/dev/{imu.id}",
            name=imu.name if names.count(imu.name) == 1 else imu.id,
            sensors=[text for kind, text in iio.SENSORS.items() if imu.channels(kind)],
            rate_hz=rate_of(system.root, imu),
            trigger=imu.text("trigger/current_trigger") if imu.has("trigger/current_trigger") else None,
            remedy=permission_remedy(system, f"/dev/{imu.id}"),
            holders=system.holders(f"/dev/{imu.id}"),
            mount_matrix=imu.mount_matrix(iio.GYRO if imu.channels(iio.GYRO) else iio.ACCEL),
        )
        for imu in imus
    ]


def find_ports(system: System) -> list[Port]:
    """Return the serial ports of this machine, those of Arduino Dues first."""
    ports = [_describe(system, port) for port in system.serial_ports()]
    return sorted(
        ports, key=lambda port: (not port.is_board, port.kind != NATIVE, port.usb_id is None, port.path)
    )


def find_buses(system: System) -> list[Bus]:
    """Return the I²C buses of this machine that programs can use."""
    return [
        Bus(
            name,
            system.text(f"/sys/class/i2c-dev/{os.path.basename(name)}/name"),
            permission_remedy(system, name),
        )
        for name in system.names("/dev", "i2c-*")
    ]


def is_raspberry_pi(system: System) -> bool:
    """Return whether this machine is a Raspberry Pi, which its device tree says."""
    return "Raspberry Pi" in system.text("/proc/device-tree/model")


def stable_name(system: System, device: str) -> str:
    """Return udev's stable link to a device, which survives a reboot, or the device if there is no link."""
    target = system.path(device).resolve()
    for folder, pattern in STABLE:
        for link in system.names(folder, pattern):
            if system.path(link).resolve() == target:
                return link
    return device


def _describe(system: System, port: ListPortInfo) -> Port:
    usb_id = None if port.vid is None or port.pid is None else f"{port.vid:04x}:{port.pid:04x}"
    if port.vid in DUE_VENDORS and port.pid in (DUE_PROGRAMMING_PORT, DUE_NATIVE_PORT):
        kind = PROGRAMMING if port.pid == DUE_PROGRAMMING_PORT else NATIVE
    else:
        text = port.description if port.description not in ("", "n/a") else ""
        kind = text or ("USB serial port" if usb_id else "serial port")
    return Port(
        path=stable_name(system, port.device),
        device=port.device,
        kind=kind,
        usb_id=usb_id,
        serial_number=port.serial_number,
        remedy=permission_remedy(system, port.device),
        holders=system.holders(port.device),
    )
