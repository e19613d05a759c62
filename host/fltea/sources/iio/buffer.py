"""Sets up and opens a device's triggered buffer in the kernel, and restores its settings at the end."""

import contextlib
import errno
import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from fltea.sources.iio.scan import Element, ScanLayout, parse_element
from fltea.sources.iio.sysfs import Attributes, choose_trigger, triggers

KEPT_S, LATENCY_S = 2.0, 0.02
"""`KEPT_S`: time for which the kernel keeps unread samples [s]. `LATENCY_S`: longest time until the kernel
delivers a sample [s].
"""

CLOCK = "monotonic"
"""Clock that is chosen for the time stamps, if the driver offers a choice. The driver's default clock jumps
when the computer's date is set.
"""

HRTIMER = (
    "make one that ticks by itself: 'sudo modprobe iio-trig-hrtimer; sudo mkdir "
    "/sys/kernel/config/iio/triggers/hrtimer/fltea', set its sampling_frequency, and name it: "
    "'iio:NAME?trigger=fltea'"
)

OWN_TRIGGER = (
    "Some drivers (inv_mpu6050) take only the chip's own trigger: its INT pin has to be wired, and known to "
    "the device tree"
)


class Unusable(Exception):
    """Raised if the buffer cannot be used.

    `kind`: kind of the `error` record about this. The text says why the buffer cannot be used, and what to
    do.
    """

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(text)
        self.kind = kind


class Wishes(NamedTuple):
    """The settings of the device that the user asks for. None leaves a setting unchanged."""

    rate_hz: float | None = None
    trigger: str | None = None


class Buffer:
    """An open triggered buffer with some channels of a device.

    `layout`: layout of a scan (one sample of all channels). `has_time`: whether scans contain time stamps
    [ns].
    `fd`: file descriptor from which scans are read.

    Raises:
        Unusable: the buffer cannot be set up, or another program uses it.
    """

    def __init__(self, root: Path, device: Attributes, channels: Sequence[str], wishes: Wishes) -> None:
        self._root, self._device = root, device
        self._undo: list[tuple[Path, str]] = []
        self.fd = -1
        try:
            self._open(channels, wishes)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Switch the buffer off, and restore every setting that this class changed."""
        for path, before in reversed(self._undo):
            with contextlib.suppress(OSError):  # writing fails if the device was unplugged
                path.write_text(before + "\n", encoding="utf-8")
        self._undo = []
        if self.fd >= 0:
            os.close(self.fd)
            self.fd = -1

    def _open(self, channels: Sequence[str], wishes: Wishes) -> None:
        device = self._device
        try:
            self.fd = os.open(device.node, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise _explain_open(device, error) from error
        enable = f"{device.buffer}/enable"
        # The device's node could be opened, so no other program uses the device. If the device's buffer is
        # on, an earlier program left it on. The buffer has to be off before settings are written.
        self._set(enable, "0", undo=False)
        self._set_trigger(wishes)
        self._set_rate(wishes)
        elements = [self._element(channel) for channel in channels]
        self.has_time = device.has(f"{device.elements}/in_timestamp_en")
        if self.has_time:
            elements.append(self._element("timestamp"))
            if device.has("current_timestamp_clock"):
                # a failure does no harm, since samples can be read whichever clock makes the time stamps
                with contextlib.suppress(Unusable):
                    self._set("current_timestamp_clock", CLOCK)
        wanted = {element.name for element in elements}
        for path in sorted((device.folder / device.elements).glob("in_*_en")):
            name = path.name.removeprefix("in_").removesuffix("_en")
            self._set(f"{device.elements}/{path.name}", "1" if name in wanted else "0")
        self.layout = ScanLayout(elements)
        self._set_length()
        self._set(enable, "1", after="0")

    def _element(self, name: str) -> Element:
        device = self._device
        stem = f"{device.elements}/in_{name}"
        try:
            return parse_element(name, device.text(f"{stem}_index"), device.text(f"{stem}_type"))
        except ValueError as error:
            raise Unusable(
                "open_failed", f"{device.folder}: {error}. Is the driver newer than fltea?"
            ) from error

    def _set_trigger(self, wishes: Wishes) -> None:
        device, file = self._device, "trigger/current_trigger"
        if not device.has(file):
            return  # this device needs no trigger, since the chip's own FIFO fills the buffer
        wanted, known = choose_trigger(self._root, device, wishes.trigger)
        if not wanted or (wishes.trigger is not None and wanted not in known):
            there = f"Triggers that exist: {', '.join(known)}" if known else "This machine has no trigger"
            missing = f"there is no trigger '{wanted}'" if wanted else f"{device.id} has no trigger"
            raise Unusable(
                "no_trigger", f"{missing}, so nothing tells it when to sample. {there}; {HRTIMER}."
            )
        self._set(file, wanted)

    def _set_rate(self, wishes: Wishes) -> None:
        if wishes.rate_hz is None:
            return
        path = rate_path(self._root, self._device)
        if path is None:
            raise Unusable(
                "open_failed", f"{self._device.id} has no rate that can be set: leave rate_hz out."
            )
        text = f"{wishes.rate_hz:g}"
        with contextlib.suppress(ValueError, OSError):
            if float(path.read_text(encoding="ascii")) == wishes.rate_hz:
                return
        try:
            self._write(path, text, undo=True)
        except Unusable as unusable:
            choice = self._device.text(f"{path.name}_available")
            if unusable.kind == "no_permission" or not choice:
                raise
            raise Unusable(
                "open_failed", f"{self._device.id} cannot sample at {text} Hz, but at: {choice}."
            ) from unusable

    def _set_length(self) -> None:
        device = self._device
        rate_hz = rate_of(self._root, device) or 1000.0
        length = max(2, round(rate_hz * KEPT_S), int(device.number(f"{device.buffer}/length") or 0))
        self._set(f"{device.buffer}/length", str(length))
        if device.has(f"{device.buffer}/watermark"):
            # a failure does no harm: without this setting the samples only come later
            with contextlib.suppress(Unusable):
                self._set(f"{device.buffer}/watermark", str(max(1, round(rate_hz * LATENCY_S))))

    def _set(self, name: str, value: str, *, undo: bool = True, after: str | None = None) -> None:
        """Write a setting. If it has this value already, and `after` is None, write nothing.

        `undo`: whether `close` restores the setting. `after`: the value that `close` then writes; if it is
        None, `close` writes the value that the setting has now.
        """
        if after is None and self._device.text(name) == value:
            return
        self._write(self._device.folder / name, value, undo=undo, after=after)

    def _write(self, path: Path, value: str, *, undo: bool, after: str | None = None) -> None:
        try:
            before = path.read_text(encoding="utf-8").strip() if after is None else after
            path.write_text(value + "\n", encoding="utf-8")
        except OSError as error:
            raise _explain_write(self._device, path, value, error) from error
        if undo:
            self._undo.append((path, before))


def rate_path(root: Path, device: Attributes) -> Path | None:
    """Return the file that holds the sampling rate: a file of the device, or of the device's trigger."""
    name = device.rate_file()
    if name is not None:
        return device.folder / name
    current = device.text("trigger/current_trigger")
    for trigger in triggers(root):
        if trigger.name == current and (trigger.folder / "sampling_frequency").exists():
            return trigger.folder / "sampling_frequency"
    return None


def rate_of(root: Path, device: Attributes) -> float | None:
    """Return the sampling rate that the driver states [Hz]; None if the driver states no rate."""
    path = rate_path(root, device)
    rate_hz = None if path is None else Attributes(path.parent, path).number(path.name)
    return rate_hz if rate_hz is not None and rate_hz > 0 else None


def _explain_open(device: Attributes, error: OSError) -> Unusable:
    match error.errno:
        case errno.EBUSY:
            return Unusable(
                "port_busy",
                f"another program reads {device.id} ({device.name}). End it; 'sudo fuser {device.node}' "
                "names it (often iio-sensor-proxy of a desktop: 'sudo systemctl stop iio-sensor-proxy').",
            )
        case errno.EACCES | errno.EPERM:
            return Unusable("no_permission", f"no permission to open {device.node}. {PERMISSION}")
        case errno.ENOENT | errno.ENXIO | errno.ENODEV:
            return Unusable(
                "no_port",
                f"{device.id} ({device.name}) has no node {device.node}: its driver has no buffer. "
                "'sudo modprobe industrialio-triggered-buffer' may help, or a newer kernel.",
            )
    return Unusable("open_failed", f"cannot open {device.node}: {error}.")


PERMISSION = (
    "Run fltea as root, or install the udev rule, which gives the sensor's files to the group 'dialout' "
    "(sudo make install-udev, or the Debian package)."
)


def _explain_write(device: Attributes, path: Path, value: str, error: OSError) -> Unusable:
    what = f"cannot write '{value}' to {path}"
    match error.errno:
        case errno.EACCES | errno.EPERM | errno.EROFS:
            return Unusable("no_permission", f"no permission: {what}. {PERMISSION}")
        case errno.EBUSY:
            text = (
                f"{what}: {device.id} ({device.name}) is busy. Another program uses it, or a driver; end it."
            )
            return Unusable("port_busy", text)
        case errno.ENODEV:
            return Unusable("unplugged", f"{what}: the device is gone.")
    if path.name == "current_trigger":
        return Unusable("no_trigger", f"{what}: the driver of {device.id} refuses it. {OWN_TRIGGER}.")
    return Unusable("open_failed", f"{what}: {error.strerror}. The driver refuses it; 'dmesg' may say why.")
