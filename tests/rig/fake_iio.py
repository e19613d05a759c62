"""Imitate the kernel's IIO devices by a folder; a FIFO is used in place of the node in /dev."""

import os
import struct
from pathlib import Path

DEVICES = "sys/bus/iio/devices"

IMU = {
    "in_anglvel_scale": "0.001064724",
    "in_accel_scale": "0.000598205",
    "in_anglvel_mount_matrix": "0, 1, 0; -1, 0, 0; 0, 0, 1",
    "sampling_frequency": "200.000000",
    "sampling_frequency_available": "25 50 100 200 400",
    "current_timestamp_clock": "realtime",
    "buffer/enable": "0",
    "buffer/length": "2",
    "buffer/watermark": "1",
    "trigger/current_trigger": "",
}
"""Attributes of a BMI160 at ±2000 deg/s and ±2 g, by file name."""

SCAN = struct.Struct("<6hxxxxq")


class FakeIio:
    """One imitated IIO device.

    `root`: folder that is used in place of /.
    """

    def __init__(self, root: Path, name: str = "bmi160", number: int = 0) -> None:
        self.root, self.id = root, f"iio:device{number}"
        self.folder = root / DEVICES / self.id
        self.node = root / "dev" / self.id
        self.node.parent.mkdir(parents=True, exist_ok=True)
        self.put("name", name)
        os.mkfifo(self.node)

    def put(self, name: str, text: str) -> None:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n", encoding="utf-8")

    def get(self, name: str) -> str:
        return (self.folder / name).read_text(encoding="utf-8").strip()

    def channel(self, name: str, index: int, layout: str = "le:s16/16>>0") -> None:
        for ending, text in (("en", "0"), ("index", str(index)), ("type", layout)):
            self.put(f"scan_elements/in_{name}_{ending}", text)

    def trigger(self, name: str, number: int = 0) -> None:
        folder = self.root / DEVICES / f"trigger{number}"
        folder.mkdir(parents=True)
        (folder / "name").write_text(name + "\n", encoding="utf-8")

    def settings(self) -> dict[str, str]:
        return {
            str(path.relative_to(self.folder)): path.read_text(encoding="utf-8").strip()
            for path in sorted(self.folder.rglob("*"))
            if path.is_file()
        }

    @property
    def url(self) -> str:
        """The source URL of the device, with the folder `root` in it."""
        return f"iio:{self.folder}"


def imu(root: Path) -> FakeIio:
    """Return an imitated BMI160 with its own trigger; one channel that fltea does not need is enabled."""
    device = FakeIio(root)
    for name, text in IMU.items():
        device.put(name, text)
    for index, name in enumerate(
        [f"{kind}_{axis}" for kind in ("anglvel", "accel") for axis in "xyz"] + ["temp"]
    ):
        device.channel(name, index)
    device.channel("timestamp", 7, "le:s64/64>>0")
    device.put("scan_elements/in_temp_en", "1")
    device.trigger("bmi160-dev0")
    return device


def scan(k: int, time_ns: int) -> bytes:
    """Return the bytes of scan `k` of the imitated BMI160: small numbers that are unique to the scan."""
    return SCAN.pack(k % 50, -k % 50, 3, 100, -200, 16000 + k % 3, time_ns)
