"""Reads the files in which the kernel shows IIO devices.

A device has a folder of small files in /sys, and a node in /dev.

The kernel's files are read without the library libiio. The Python binding of libiio in Debian 12 (0.24) is
installed for the system's Python only, and the binding on PyPI (1.0) does not fit Debian's library. Both
bindings read the files in /sys only, so tests could not use copies of these files in another folder. The
kernel's files are a stable interface (Documentation/ABI/testing/sysfs-bus-iio).
"""

import math
import os
from pathlib import Path
from typing import NamedTuple

DEVICES = "sys/bus/iio/devices"
GYRO, ACCEL = "anglvel", "accel"
SENSORS = {GYRO: "gyroscope", ACCEL: "accelerometer"}
AXES = ("x", "y", "z")


class Attributes:
    """Reads the small files of a device.

    `folder`: folder with these files in /sys. `node`: the device's node in /dev.
    """

    def __init__(self, folder: Path, node: Path) -> None:
        self.folder, self.node = folder, node

    def text(self, name: str) -> str:
        """Return the content of a file without surrounding white space; "" if it cannot be read."""
        try:
            return (self.folder / name).read_bytes()[:4096].decode("utf-8", "replace").strip("\0 \t\r\n")
        except OSError:
            return ""

    def number(self, *names: str) -> float | None:
        """Return the number in the first of the named files that holds a number; None if no file does."""
        for name in names:
            try:
                value = float(self.text(name))
            except ValueError:
                continue
            if math.isfinite(value):
                return value
        return None

    def has(self, name: str) -> bool:
        return (self.folder / name).exists()

    @property
    def id(self) -> str:
        """ID of the device, such as `iio:device0`."""
        return self.folder.name

    @property
    def name(self) -> str:
        """Name that the driver gives to the chip."""
        return self.text("name") or self.id

    @property
    def buffer(self) -> str:
        """Name of the folder with the buffer's settings."""
        return "buffer" if self.has("buffer") else "buffer0"

    @property
    def elements(self) -> str:
        """Name of the folder that describes the channels that the buffer can contain."""
        return "scan_elements" if self.has("scan_elements") else "buffer0"

    def channels(self, kind: str) -> list[str]:
        """Return the names of a sensor's channels that the buffer can contain.

        The names are `anglvel_x` and so on, or only `anglvel` for a sensor of one axis.
        """
        names = [*(f"{kind}_{axis}" for axis in AXES), kind]
        return [name for name in names if self.has(f"{self.elements}/in_{name}_en")]

    def of_channel(self, channel: str, what: str) -> float | None:
        """Return a number that describes a channel, such as its scale or offset.

        If the channel has no such number of its own, the result is the number for all channels of its kind.
        """
        kind = channel.partition("_")[0]
        return self.number(f"in_{channel}_{what}", f"in_{kind}_{what}")

    def mount_matrix(self, kind: str) -> str:
        """Return the text of a sensor's mount matrix.

        If the sensor has no matrix of its own, the result is the matrix for all inputs. If there is none
        either, it is the matrix of the device, or "" if the device has none.
        """
        names = (f"in_{kind}_mount_matrix", "in_mount_matrix", "mount_matrix")
        return next((text for name in names if (text := self.text(name))), "")

    @property
    def driver(self) -> str:
        """Name of the driver, such as `inv-mpu6050-i2c`; "" if it is not known."""
        link = self.folder.resolve().parent / "driver"
        return link.resolve().name if link.is_symlink() else ""

    def rate_file(self) -> str | None:
        """Return the file with the sampling rate.

        The result is None if the device has no such file. Then the device's trigger may have one.
        """
        names = (f"in_{GYRO}_sampling_frequency", f"in_{GYRO}_x_sampling_frequency", "sampling_frequency")
        return next((name for name in names if self.has(name)), None)

    @property
    def is_imu(self) -> bool:
        """Whether the buffer can contain channels of a gyroscope or an accelerometer."""
        return bool(self.channels(GYRO) or self.channels(ACCEL))


class Trigger(NamedTuple):
    """A trigger of the kernel, which makes a device take a sample.

    `folder`: folder of the trigger in /sys.
    """

    name: str
    folder: Path


def devices(root: Path) -> list[Attributes]:
    """Return the IIO devices of a machine, sorted by number."""
    folders = (root / DEVICES).glob("iio:device*")
    return [
        Attributes(folder, root / "dev" / folder.name)
        for folder in sorted(folders, key=lambda folder: (len(folder.name), folder.name))
    ]


def triggers(root: Path) -> list[Trigger]:
    """Return the triggers of a machine."""
    folders = sorted((root / DEVICES).glob("trigger*"))
    return [Trigger(Attributes(folder, folder).text("name"), folder) for folder in folders]


def choose_trigger(root: Path, device: Attributes, wish: str | None) -> tuple[str, list[str]]:
    """Return the name of the trigger to use for a device, and the names of all triggers of the machine.

    The trigger to use is the one that the user names. If the user names none, it is the device's present
    trigger. If the device has none, it is the chip's own trigger, or "" if there is none. It is not checked
    whether the named or present trigger exists on this machine.
    """
    known = [trigger.name for trigger in triggers(root)]
    own = next((name for name in known if name.startswith(device.name)), "")
    return wish or device.text("trigger/current_trigger") or own, known


def find(root: Path, what: str) -> list[Attributes]:
    """Return the devices that `what` names.

    `what` is a device's name, its label, its ID such as `iio:device0`, or its path in /dev or /sys.
    """
    last = os.path.basename(what.rstrip("/")).removeprefix("iio:")
    return [
        one
        for one in devices(root)
        if one.id == f"iio:{last}" or what in (one.text("name"), one.text("label"))
    ]


def root_of(what: str) -> Path:
    """Return the folder that contains the folder `sys` in which the device is looked for. Usually this is /.

    `what`: what the user names. Only the path to a device in a copy of /sys gives another folder:
    /copy/sys/bus/iio/devices/iio:device0 gives /copy.
    """
    before, found, _ = what.partition(f"/{DEVICES}/")
    return Path(before or "/") if found else Path("/")
