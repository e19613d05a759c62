"""Reads one of the chips in `chips.CHIPS` on a Linux I²C bus; its URL is `i2c:///dev/i2c-1?addr=0x68`.

The sensor's FIFO holds samples for `Chip.fifo_s`, so the program may be delayed by this time without a loss.
The FIFO is read every 20 to 30 ms, at random times. If it were read at multiples of the sensor's period, the
delay between a sample and the read would change only slowly, and this change would look like a drift of the
sensor's clock.
"""

import hashlib
import math
import os
import platform
import random
import time
from collections.abc import Callable, Generator, Iterator
from pathlib import Path

from fltea.records import clock
from fltea.records.events import Event, LinkDown, Tick, Trouble, block_of
from fltea.records.records import Hello
from fltea.records.repeat import OnceAMinute
from fltea.records.stats import DeviceStatus, LinkStats
from fltea.records.version import __version__
from fltea.settings.config import Config
from fltea.sources.i2c import bus as i2c_bus
from fltea.sources.i2c.bus import Bus, explain_open_failure
from fltea.sources.i2c.chip import Chip
from fltea.sources.i2c.driver import TRIES, Driver, SensorFault, TransferFailed
from fltea.sources.i2c.fifo_reader import FifoReader, Loss
from fltea.sources.i2c.texts import bus_lost_text, fault_text, loss_text
from fltea.sources.i2c.url import Place, parse_url
from fltea.sources.opening import Named
from fltea.wire.layout import FaultCode
from fltea.wire.sensors import NO_SENSOR, relative_text, sensor_name

POLL_S = (0.02, 0.03)
FRESH_POLL_S = 0.001
SLICE_S = 0.05
SET_UP_S = 1.0
"""If a chip does not keep its settings or is of an unknown kind, it is set up again after this time [s]."""
PROBE_S = 0.1
BACKOFF_S = (0.25, 0.5, 1.0, 2.0, 5.0)
TICK_NS = 500_000_000
STATUS_NS = 1_000_000_000


class SystemClock:
    """Reads this computer's clock, and waits for given times. Tests replace this class."""

    host_ns = staticmethod(clock.host_ns)
    unix_offset_ns = staticmethod(clock.unix_offset_ns)
    sleep = staticmethod(time.sleep)


class _Closed(Exception):
    """Raised inside `I2cSource.events` to end the iteration of events after a call of `close`."""


def lost_polls(chip: Chip) -> int:
    """Return the number of successive failed polls after which the FIFO may have overflowed."""
    return math.ceil(chip.fifo_s / (sum(POLL_S) / 2))


def device_id(path: str, address: int) -> str:
    """Return the device's ID, 32 hexadecimal digits.

    The ID depends only on this computer, the bus and the address, not on the sensor at this address.
    """
    try:
        machine = Path("/etc/machine-id").read_text(encoding="ascii").strip()
    except OSError:
        machine = platform.node()
    return hashlib.sha256(f"fltea i2c {machine} {path} {address}".encode()).hexdigest()[:32]


class Pauses:
    """Waits between two uses of the bus, and yields each `Tick` and `DeviceStatus` that is due meanwhile.

    `status`: function that returns the present status. `closed`: whether to end the iteration of events.
    """

    def __init__(self, host: SystemClock, status: Callable[[], DeviceStatus]) -> None:
        self.closed = False
        self._host, self._status = host, status
        self._random = random.Random(0)
        self._tick_ns = self._status_ns = 0

    def came(self, host_ns: int) -> None:
        """Remember that samples came. A `Tick`, which says that nothing came, is not due for a while then."""
        self._tick_ns = host_ns + TICK_NS

    def poll(self) -> Iterator[Event]:
        """Wait until the sensor is to be read again."""
        return self.wait(self._random.uniform(*POLL_S))

    def wait(self, seconds: float) -> Iterator[Event]:
        """Wait.

        The method sleeps only for short times, so that it soon notices if another thread sets `closed`.
        """
        end_ns = self._host.host_ns() + round(seconds * 1e9)
        while True:
            if self.closed:
                raise _Closed
            now_ns = self._host.host_ns()
            if now_ns >= self._tick_ns:
                self._tick_ns = now_ns + TICK_NS
                yield Tick(now_ns)
            if now_ns >= self._status_ns:
                self._status_ns = now_ns + STATUS_NS
                yield self._status()
            if now_ns >= end_ns:
                return
            self._host.sleep(min(SLICE_S, (end_ns - now_ns) * 1e-9))


class Identity:
    """What a HELLO says of the source and its sensor.

    `starts`: how often the sensor was set up. `who_am_i`: the register that names the sensor's kind.
    """

    def __init__(self, url: str, place: Place) -> None:
        self._url = url
        self._boot_id = int.from_bytes(os.urandom(4), "big")
        self._device_id = device_id(place.path, place.address)
        self.starts = 0
        self.who_am_i = NO_SENSOR

    def hello(self, chip: Chip, host_ns: int) -> Hello:
        """Return the HELLO of a sensor that was just set up."""
        return Hello(
            source=self._url,
            host_ns=host_ns,
            rate_hz=chip.rate_hz,
            sampling_mode="fifo",
            boot_id=self._boot_id,
            device_id=self._device_id,
            firmware_version=f"fltea {__version__} i2c",
            who_am_i=self.who_am_i,
            sensor=sensor_name(self.who_am_i),
            sensor_starts=(self.starts - 1) % 65535 + 1,
            gyro_range_dps=chip.gyro_range_dps,
            gyro_lsb_per_dps=chip.gyro_lsb_per_dps,
            accel_range_g=chip.accel_range_g,
            accel_lsb_per_g=chip.accel_lsb_per_g,
            gyro_dlpf_hz=chip.gyro_dlpf_hz,
        )


class Troubles:
    """Makes the events that report troubles of one sensor, each kind at most once a minute."""

    def __init__(self, url: str, place: Place, host: SystemClock) -> None:
        self._url, self._place, self._host = url, place, host
        self._reported = OnceAMinute()
        self._reported_relative = NO_SENSOR

    def forget(self) -> None:
        """Let every kind of trouble be reported again, even if it was reported in the last minute."""
        self._reported.forget()

    def relative(self, who_am_i: int) -> Iterator[Trouble]:
        """Report once if the sensor is only a relative or a clone of the MPU-9250."""
        text = relative_text(who_am_i)
        if text is not None and who_am_i != self._reported_relative:
            self._reported_relative = who_am_i
            yield Trouble("sensor_relative", f"{self._url}: {text}", self._host.host_ns(), fatal=False)

    def losses(self, losses: list[Loss], fifo_s: float) -> Iterator[Trouble]:
        """Report the losses of samples, and remove them from the list."""
        for cause, missing, doubt in losses:
            kind, text = loss_text(cause, missing, doubt, fifo_s)
            topic = f"{cause} ±" if doubt else cause
            yield from self.report(kind, topic, f"{self._url}: {text}", fatal=False)
        losses.clear()

    def fault(self, code: FaultCode, detail: int, *, fatal: bool = False) -> Iterator[Trouble]:
        """Report a fault of the sensor or of its bus."""
        name = code.name.lower()
        text = f"{self._url}: {name}: {fault_text(code, detail, self._place.path, self._place.address)}"
        yield from self.report("device_fault", name, text, fatal=fatal)

    def report(self, kind: str, topic: str, text: str, *, fatal: bool = True) -> Iterator[Trouble]:
        """Report a trouble, unless its topic was already reported in the last minute."""
        now_ns = self._host.host_ns()
        if self._reported.is_due(topic, now_ns):
            yield Trouble(kind, text, now_ns, fatal)


class I2cSource:
    """Reads the samples of one sensor. Every failure becomes a `Trouble`, and reading is tried again.

    `rest`: the part of the URL after `i2c:`. `open_bus`, `host`: replacements for the bus and the clock in
    tests.
    `unix_offset_ns`: offset from the monotonic clock to Unix time at the last event [ns].
    """

    live = prompt = has_clock = True

    def __init__(
        self,
        rest: str,
        *,
        open_bus: Callable[[str, int], Bus] | None = None,
        host: SystemClock | None = None,
    ) -> None:
        self._place = place = parse_url(rest)
        self.url = f"i2c:{place.path}?addr=0x{place.address:02X}"
        self._open_bus = open_bus or i2c_bus.open_bus
        self._host = host or SystemClock()
        self._driver = Driver(place.address, self._host.host_ns, place.chip)
        self._reader = FifoReader(self._driver, self._host.host_ns)
        self._identity = Identity(self.url, place)
        self._pauses = Pauses(self._host, self._status)
        self._troubles = Troubles(self.url, place, self._host)
        self._unanswered = False
        self._openings = 0
        self.unix_offset_ns = self._host.unix_offset_ns()

    def events(self) -> Iterator[Event]:
        """Yield the sensor's events until `close`."""
        for event in self._events():
            # kept for each event, so that a recording and the outputs give the event the same Unix time
            self.unix_offset_ns = self._host.unix_offset_ns()
            yield event

    def _events(self) -> Iterator[Event]:
        failures = 0
        try:
            while True:
                starts = self._identity.starts
                yield from self._use_bus()
                failures = 0 if self._identity.starts > starts else failures + 1
                yield from self._pauses.wait(BACKOFF_S[min(failures, len(BACKOFF_S) - 1)])
        except _Closed:
            return

    def link_stats(self) -> LinkStats:
        """Return the counts of the connection.

        Each sample counts as a frame, and each restart of the FIFO as a bad frame. Bad frames are counted by
        the cause of the restart.
        """
        return LinkStats(
            bytes=self._reader.samples * self._driver.chip.packet.size,
            frames=self._reader.samples,
            bad_frames=dict(self._reader.restarts.counts),
            reconnects=max(0, self._openings - 1),
        )

    def close(self) -> None:
        """Let the iteration of `events` end, which also releases the bus."""
        self._pauses.closed = True

    def _use_bus(self) -> Iterator[Event]:
        """Open the bus, and read the sensor until the bus is lost."""
        try:
            bus = self._open_bus(self._place.path, self._place.address)
        except OSError as error:
            kind, text = explain_open_failure(self._place.path, self._place.address, error)
            yield from self._troubles.report(kind, kind, text)
            return
        self._driver.bus = bus
        self._openings += 1
        try:
            while True:
                if (yield from self._set_up()):
                    yield from self._read()
        except OSError as error:
            yield LinkDown(self._host.host_ns())
            yield from self._troubles.report("unplugged", "unplugged", bus_lost_text(self._place.path, error))
        finally:
            bus.close()

    def _set_up(self) -> Generator[Event, None, bool]:
        """Find the sensor and set it up. Return whether the sensor now takes samples."""
        driver = self._driver
        try:
            self._identity.who_am_i = driver.identify()
        except SensorFault as fault:
            yield from self._troubles.fault(fault.code, fault.detail, fatal=True)
            yield from self._pauses.wait(SET_UP_S)
            return False
        except TransferFailed as failed:
            code = FaultCode.BUS_HELD if failed.acknowledged else FaultCode.SENSOR_MISSING
            # a missing sensor is reported only at the second attempt, since it may start later than this
            # computer
            if self._unanswered:
                yield from self._troubles.fault(code, self._place.address, fatal=True)
            self._unanswered = True
            yield from self._pauses.wait(PROBE_S)
            return False
        self._unanswered = False
        try:
            driver.start_reset(self._identity.who_am_i)
            yield from self._pauses.wait(driver.chip.reset_s)
            driver.configure()
            yield from self._pauses.wait(driver.chip.settle_s)
            driver.restart_fifo()
        except SensorFault as fault:
            yield from self._troubles.fault(fault.code, fault.detail)
        except TransferFailed:
            yield from self._troubles.fault(FaultCode.SENSOR_LOST, TRIES)
        else:
            return True
        yield from self._pauses.wait(SET_UP_S)
        return False

    def _read(self) -> Iterator[Event]:
        """Read the sensor until it has to be set up again."""
        self._identity.starts += 1
        self._troubles.forget()
        self._reader.begin()
        yield self._identity.hello(self._driver.chip, self._host.host_ns())
        yield from self._troubles.relative(self._identity.who_am_i)
        failing = 0
        while True:
            hurry = self._reader.hurry and not failing
            yield from self._pauses.wait(FRESH_POLL_S) if hurry else self._pauses.poll()
            try:
                samples = self._reader.poll()
                failing = 0
            except SensorFault as fault:
                yield from self._troubles.fault(fault.code, fault.detail)
                return
            except TransferFailed:
                failing += 1
                if failing == lost_polls(self._driver.chip):
                    yield from self._troubles.fault(FaultCode.SENSOR_LOST, TRIES * failing)
                    return
            else:
                if samples:
                    self._pauses.came(samples[-1].host_ns)
                    yield block_of(samples)
            yield from self._troubles.losses(self._reader.losses, self._driver.chip.fifo_s)

    def _status(self) -> DeviceStatus:
        return DeviceStatus(
            i2c_errors=self._driver.i2c_errors,
            bus_recoveries=max(0, self._openings - 1),
            sensor_reinits=max(0, self._identity.starts - 1),
            overruns=self._reader.overruns,
            dropped_frames=0,
            reset_cause="software",
        )


def open_named(named: Named, config: Config) -> I2cSource:
    """Return the source that reads a chip on an I²C bus."""
    return I2cSource(named.place)


def only_reader_of(named: Named) -> str:
    """Return the bus and the address of the sensor."""
    place = parse_url(named.place)
    return f"{os.path.realpath(place.path)} at address 0x{place.address:02X}"
