"""Checks of a sensor with a kernel driver (IIO)."""

import os
from collections.abc import Iterator

from fltea.diagnostics.asked import AskedSource
from fltea.diagnostics.finding import Finding, ok, problem, warning
from fltea.diagnostics.host_system import System, permission_remedy
from fltea.machine.devices import find_iio
from fltea.records.errors import UsageError
from fltea.sources.iio.buffer import HRTIMER, OWN_TRIGGER, PERMISSION, Unusable, rate_of
from fltea.sources.iio.source import conversion_of, parse_url
from fltea.sources.iio.sysfs import ACCEL, DEVICES, GYRO, Attributes, choose_trigger, find

NO_DRIVER = (
    "is the driver's module loaded (lsmod), and does the machine know that the chip is there? On a Raspberry "
    "Pi a line dtoverlay=… in config.txt tells it; 'dmesg | grep iio' may say more."
)
MPU_DRIVER = "inv-mpu6050"


def check_iio(system: System, rest: str) -> Iterator[Finding]:
    """Yield findings on the device of an `iio:` URL. `rest`: part of the URL after the colon."""
    try:
        place = parse_url(rest)
    except UsageError as error:
        yield problem("iio", str(error))
        return
    found = find(system.root, place.device)
    if len(found) != 1:
        yield _not_one(system, place.device, found)
        return
    device, node = found[0], f"/dev/{found[0].id}"
    if not device.channels(GYRO):
        yield problem(
            "iio",
            f"{device.id} ({device.name}) has no gyroscope whose samples can be buffered.",
            "another device of the same chip may have it: 'fltea devices' lists them; a driver without a "
            "buffer needs a newer kernel.",
        )
        return
    yield ok("iio", f"{device.id}: {device.name}, channels {', '.join(device.channels(GYRO))}")
    yield from _permission(system, device, node)
    yield from _in_use(system, device, node)
    yield _trigger(system, device, place.wishes.trigger)
    yield _rate(system, device, place.wishes.rate_hz)
    yield from _axes(device, place.mount)
    if device.driver.startswith(MPU_DRIVER):
        yield ok(
            "low-pass",
            "inv_mpu6050 sets the chip's low-pass to half the rate at most: noise near half the rate is "
            "shaped by the filter, so to judge the noise of one rate, sample at twice that rate",
        )
    if not device.has(f"{device.elements}/in_timestamp_en"):
        yield warning(
            "time stamps",
            f"{device.id} has none, so lost samples cannot be seen.",
            "another driver, or kernel.",
        )


def _not_one(system: System, what: str, found: list[Attributes]) -> Finding:
    if found:
        names = ", ".join(one.id for one in found)
        return problem("iio", f"several devices are called '{what}': {names}.", "name one: iio:iio:device0.")
    there = ", ".join(f"{one.name} ({one.path})" for one in find_iio(system))
    if there:
        return problem("iio", f"there is no device '{what}'. There is {there}.", "check the name.")
    if not system.exists(f"/{DEVICES}"):
        text = "the kernel's module industrialio is not loaded, so no driver of a sensor is either"
    else:
        text = "the kernel has no driver running for a gyroscope or IMU"
    return problem("iio", f"there is no device '{what}': {text}.", NO_DRIVER)


def _permission(system: System, device: Attributes, node: str) -> Iterator[Finding]:
    if not system.exists(node):
        yield problem(
            "permission",
            f"{device.id} has no node {node}: its driver offers no buffer.",
            "sudo modprobe industrialio-triggered-buffer, or a newer kernel.",
        )
        return
    remedy = permission_remedy(system, node)
    if remedy is not None:
        yield problem("permission", f"{system.user()} may not open {node}.", PERMISSION)
    elif not os.access(device.folder / device.buffer / "enable", os.W_OK):
        yield problem("permission", f"{system.user()} may not switch {device.id}'s buffer on.", PERMISSION)
    else:
        yield ok("permission", f"{system.user()} may open {node} and switch its buffer on")


def _in_use(system: System, device: Attributes, node: str) -> Iterator[Finding]:
    holders = ", ".join(map(str, system.holders(node)))
    if holders:
        yield problem(
            "in use", f"{node} is in use by {holders}.", "end it: only one program can read a device."
        )
    elif device.text(f"{device.buffer}/enable") == "1":
        yield warning(
            "in use",
            f"{device.id}'s buffer is on, and no reader of it can be seen.",
            "a program of another user has it (sudo fuser names it), or left it on: then fltea takes it.",
        )


def _trigger(system: System, device: Attributes, wanted: str | None) -> Finding:
    if not device.has("trigger/current_trigger"):
        return ok("trigger", f"{device.id} needs none: the chip itself fills the buffer")
    name, known = choose_trigger(system.root, device, wanted)
    if name in known and device.driver.startswith(MPU_DRIVER) and not name.startswith(device.name):
        return problem("trigger", f"inv_mpu6050 refuses the trigger {name}.", f"{OWN_TRIGGER}.")
    if name in known and not (wanted or device.text("trigger/current_trigger")):
        return ok("trigger", f"none is chosen; fltea will take the chip's own, {name}")
    if name in known:
        return ok("trigger", f"{name} tells {device.id} when to sample")
    there = f"there is {', '.join(known)}" if known else "this machine has none"
    text = f"there is no trigger '{name}'" if name else f"nothing tells {device.id} when to sample"
    return problem("trigger", f"{text}; {there}.", f"{HRTIMER}.")


def _axes(device: Attributes, mounted: bool) -> Iterator[Finding]:
    try:
        for kind in (GYRO, ACCEL):
            channels = device.channels(kind)
            if kind == GYRO or len(channels) == 3:
                conversion_of(device, kind, channels, mounted)
    except Unusable as unusable:
        yield problem("axes", str(unusable))
        return
    if matrix := device.mount_matrix(GYRO):
        how = "turned" if mounted else "not turned (mount=off)"
        yield ok("axes", f"{how} by the driver's mount matrix: {matrix}")


def _rate(system: System, device: Attributes, wanted_hz: float | None) -> Finding:
    rate_hz = wanted_hz or rate_of(system.root, device)
    if rate_hz is None:
        return warning(
            "rate",
            f"the driver of {device.id} states no rate, or the rate 0, so it may give no samples.",
            "set one: --source 'iio:NAME?rate_hz=200'.",
        )
    return ok("rate", f"{rate_hz:g} Hz, as its driver says it")


def check_source(asked: AskedSource) -> Iterator[Finding]:
    """Yield findings on the device of the kernel."""
    return check_iio(asked.system, asked.place)
