"""IIO devices as the kernel shows them: folders of small files in /sys, and a node in /dev.

The kernel's own files are read, not Debian's libiio: its Python binding of Debian 12 (0.24) belongs to the
system's Python and cannot be in an environment of its own, PyPI's (1.0) does not fit Debian's library, and
neither can be pointed at another folder, so nothing here could be tested. The files are a stable interface
(Documentation/ABI/testing/sysfs-bus-iio).
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
    """Reads the files of a device. folder: its folder; node: its character device."""

    def __init__(self, folder: Path, node: Path) -> None:
        self.folder, self.node = folder, node

    def text(self, name: str) -> str:
        """Return the content of a file without the white space round it; "" if it cannot be read."""
        try:
            return (self.folder / name).read_bytes()[:4096].decode("utf-8", "replace").strip("\0 \t\r\n")
        except OSError:
            return ""

    def number(self, *names: str) -> float | None:
        """Return the number in the first of these files that has one."""
        for name in names:
            try:
                value = float(self.text(name))
            except ValueError:
                continue
            if math.isfinite(value):
                return value
        return None

    def has(self, name: str) -> bool:
        """Return whether there is such a file."""
        return (self.folder / name).exists()

    @property
    def id(self) -> str:
        """The id of the device, such as `iio:device0`."""
        return self.folder.name

    @property
    def name(self) -> str:
        """The name that the driver gives to the chip."""
        return self.text("name") or self.id

    @property
    def buffer(self) -> str:
        """The folder of the buffer's settings."""
        return "buffer" if self.has("buffer") else "buffer0"

    @property
    def elements(self) -> str:
        """The folder of the channels that the buffer may hold."""
        return "scan_elements" if self.has("scan_elements") else "buffer0"

    def channels(self, kind: str) -> list[str]:
        """Return a sensor's channels that the buffer may hold: `anglvel_x` …, or `anglvel` of one axis."""
        names = [*(f"{kind}_{axis}" for axis in AXES), kind]
        return [name for name in names if self.has(f"{self.elements}/in_{name}_en")]

    def of_channel(self, channel: str, what: str) -> float | None:
        """Return a number that a channel has by itself or shares with its kind: scale, offset."""
        kind = channel.partition("_")[0]
        return self.number(f"in_{channel}_{what}", f"in_{kind}_{what}")

    def mount_matrix(self, kind: str) -> str:
        """Return the matrix that turns a sensor's axes: its own, of all inputs, or of the device; or ""."""
        names = (f"in_{kind}_mount_matrix", "in_mount_matrix", "mount_matrix")
        return next((text for name in names if (text := self.text(name))), "")

    @property
    def driver(self) -> str:
        """The driver's name, such as `inv-mpu6050-i2c`; "" if it cannot be told."""
        link = self.folder.resolve().parent / "driver"
        return link.resolve().name if link.is_symlink() else ""

    def rate_file(self) -> str | None:
        """Return the file that holds the rate of samples, or None: then its trigger may have one."""
        names = (f"in_{GYRO}_sampling_frequency", f"in_{GYRO}_x_sampling_frequency", "sampling_frequency")
        return next((name for name in names if self.has(name)), None)

    @property
    def is_imu(self) -> bool:
        """Whether it has a gyroscope or an accelerometer that a buffer may hold."""
        return bool(self.channels(GYRO) or self.channels(ACCEL))


class Trigger(NamedTuple):
    """A trigger, which tells a device when to take a sample. folder: in /sys."""

    name: str
    folder: Path


def devices(root: Path) -> list[Attributes]:
    """Return the IIO devices of a machine, by their numbers."""
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
    """Return the trigger for a device and all that exist: the wished one, its present one, or the chip's own.

    It is "" if there is none of these; a wished or present one may not exist.
    """
    known = [trigger.name for trigger in triggers(root)]
    own = next((name for name in known if name.startswith(device.name)), "")
    return wish or device.text("trigger/current_trigger") or own, known


def find(root: Path, what: str) -> list[Attributes]:
    """Return the devices that a user means by a name, a label, `iio:device0`, or a path in /dev or /sys."""
    last = os.path.basename(what.rstrip("/")).removeprefix("iio:")
    return [
        one
        for one in devices(root)
        if one.id == f"iio:{last}" or what in (one.text("name"), one.text("label"))
    ]


def root_of(what: str) -> Path:
    """Return the folder that stands for /, which a path within the /sys of another tree states."""
    before, found, _ = what.partition(f"/{DEVICES}/")
    return Path(before or "/") if found else Path("/")
