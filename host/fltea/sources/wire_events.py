"""What came over a wire, as events: framing and messages put together, and watched over.

It does not know where the bytes come from: a port (`fltea.sources.serial`) or a recording of one.
"""

from collections.abc import Iterator

from fltea.records.events import (
    Chunk,
    Event,
    Failed,
    LinkDown,
    Opened,
    RawSample,
    Tick,
    TransportEvent,
    Trouble,
)
from fltea.records.records import LinkStats
from fltea.wire import layout as wire
from fltea.wire.faults import fault_text
from fltea.wire.message_events import axis_event, estimator_event, hello_event, name_of, status_event
from fltea.wire.messages import Frame, FrameReader, Refused
from fltea.wire.sensors import NO_SENSOR, RELATIVES, SENSORS, sensor_name

SILENCE_S = 5.0
"""A device that says nothing, or nothing that can be read, for this long is reported."""

LIMIT_NS = int(SILENCE_S * 1e9)
STALL_S = 2.0
"""If the program itself was held up for this long, by whatever, silence proves nothing."""

REPEAT_S = 60.0
"""The same trouble is told again after this long."""


class WireEvents:
    """Transport events in, events out; every failure is a `Trouble`.

    url: what the texts call the port. `unix_offset_ns` is that of the last transport event.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self.unix_offset_ns = 0
        self._before_ns: int | None = None
        self._frames = FrameReader()
        self._connected = False
        self._refused = False
        self._heard_hello = False
        self._opened_ns = self._byte_ns = 0
        self._unread_since_ns: int | None = None
        self._unread_bytes = 0
        self._told: tuple[str, int] | None = None
        self._sensor: tuple[int, int] | None = None
        self._told_sensors = {NO_SENSOR}
        self._told_faults: dict[int, int] = {}
        self._connections = 0
        self._refused_frames = 0

    def feed(self, item: TransportEvent | None, now_ns: int) -> Iterator[Event]:
        """Yield what one transport event leads to; None says that nothing came for a while.

        now_ns: the monotonic clock as of now; in a recording, that of the event.
        """
        if self._before_ns is not None and now_ns - self._before_ns > STALL_S * 1e9:
            self._forgive(now_ns)
        if item is None:
            yield Tick(now_ns)
        else:
            self.unix_offset_ns = item.unix_offset_ns
            yield from self._on_transport(item)
        yield from self._watch(item.host_ns if item else now_ns)

    def resume(self, now_ns: int) -> None:
        """Say when the program came back for the next event: only what is longer was a stall of its own."""
        self._before_ns = now_ns

    def link_stats(self, overflow_bytes: int = 0) -> LinkStats:
        """Count what arrived and what was lost on the way."""
        counts = dict(self._frames.counts)
        return LinkStats(
            bytes=self._frames.bytes_in,
            frames=counts.pop("frames", 0),
            unknown_type=counts.pop("unknown_type", 0),
            refused=self._refused_frames,
            bad_frames={reason: n for reason, n in counts.items() if n},
            overflow_bytes=overflow_bytes,
            reconnects=max(0, self._connections - 1),
        )

    def _on_transport(self, item: TransportEvent) -> Iterator[Event]:
        match item:
            case Opened(host_ns, _):
                self._connected, self._refused, self._heard_hello = True, False, False
                self._connections += 1
                self._forgive(host_ns)
                self._frames.reset()
            case Failed(kind, message, host_ns, _):
                self._connected = False
                yield LinkDown(host_ns)
                yield from self._tell(Trouble(kind, message, host_ns))
            case Chunk(data, host_ns, _):
                if self._unread_since_ns is None or host_ns - self._byte_ns >= LIMIT_NS:
                    self._unread_since_ns, self._unread_bytes = host_ns, 0
                self._byte_ns = host_ns
                self._unread_bytes += len(data)
                for frame in self._frames.feed(data):
                    yield from self._on_frame(frame, host_ns)

    def _on_frame(self, frame: Frame | Refused, host_ns: int) -> Iterator[Event]:
        self._unread_since_ns = None
        if isinstance(frame, Refused):
            self._refused = True
            self._refused_frames += 1
            yield LinkDown(host_ns)
            text = f"{self.url}: {frame.message}. Flash the firmware that belongs to this program."
            yield from self._tell(Trouble("version", text, host_ns))
            return
        if self._refused and not isinstance(frame.message, wire.Hello):
            self._refused_frames += 1
            return
        match frame.message:
            case wire.Hello() as hello if problem := hello_problem(hello):
                self._refused = True
                yield LinkDown(host_ns)
                yield from self._tell(Trouble("bad_hello", f"{self.url}: {problem}", host_ns))
            case wire.Hello() as hello:
                self._refused, self._heard_hello, self._told = False, True, None
                yield hello_event(hello, f"serial:{self.url}", host_ns)
                yield from self._on_sensor(hello, host_ns)
            case wire.Sample() as s:
                yield RawSample(
                    frame.sequence,
                    frame.device_us,
                    host_ns,
                    (s.gyro_x, s.gyro_y, s.gyro_z),
                    (s.accel_x, s.accel_y, s.accel_z),
                    s.temperature,
                    s.flags,
                )
            case wire.Status() as s:
                yield status_event(s)
            case wire.Estimate() as e:
                yield axis_event(e, frame.sequence, host_ns)
            case wire.Estimator() as e:
                yield estimator_event(e, host_ns)
            case wire.Fault(code, detail):
                told_ns = self._told_faults.get(code)
                if told_ns is None or host_ns - told_ns > REPEAT_S * 1e9:
                    self._told_faults[code] = host_ns
                    text = f"the device reports {name_of(wire.FaultCode, code)}: {fault_text(code, detail)}"
                    yield Trouble("device_fault", f"{self.url}: {text}", host_ns, fatal=False)

    def _on_sensor(self, hello: wire.Hello, host_ns: int) -> Iterator[Trouble]:
        """Tell once what is peculiar about a chip; after another start of the sensor its faults are news."""
        sensor, who = (hello.boot_id, hello.sensor_starts), hello.who_am_i
        if sensor != self._sensor:
            self._sensor = sensor
            self._told_faults.clear()
        if who in self._told_sensors:
            return
        self._told_sensors.add(who)
        if who in RELATIVES:
            text = f"the sensor is no MPU-9250 but {sensor_name(who)}, {RELATIVES[who]}"
            yield Trouble("sensor_relative", f"{self.url}: {text}", host_ns, fatal=False)
        elif who not in SENSORS:
            text = (
                f"{sensor_name(who)}: no MPU-9250, and none of its known relatives. Do not trust its scales; "
                "another sensor, or a bad contact on SDA?"
            )
            yield Trouble("sensor_unknown", f"{self.url}: {text}", host_ns, fatal=False)

    def _forgive(self, now_ns: int) -> None:
        """Begin all waiting anew: the port was just opened, or we ourselves were not listening."""
        self._opened_ns = self._byte_ns = now_ns
        self._unread_since_ns = None

    def _watch(self, now_ns: int) -> Iterator[Trouble]:
        if not self._connected:
            return
        waits_for_hello = self._unread_since_ns is None and not (self._heard_hello or self._refused)
        if now_ns - self._byte_ns >= LIMIT_NS:
            text = (
                f"{self.url} is open but has said nothing for {SILENCE_S:g} s. Is the firmware flashed, and "
                "is this the programming port (the one beside the power socket)?"
            )
            yield from self._tell(Trouble("silent", text, now_ns))
        elif self._unread_since_ns is not None and now_ns - self._unread_since_ns >= LIMIT_NS:
            text = (
                f"{self.url}: {self._unread_bytes} bytes in {SILENCE_S:g} s, and no valid frame among them. "
                "The baud rate is wrong, or the device does not run the firmware of fltea."
            )
            yield from self._tell(Trouble("no_valid_frame", text, now_ns))
        elif waits_for_hello and now_ns - self._opened_ns >= LIMIT_NS:
            text = f"{self.url}: valid frames, but no HELLO in {SILENCE_S:g} s; samples cannot be scaled."
            yield from self._tell(Trouble("no_hello", text, now_ns))

    def _tell(self, trouble: Trouble) -> Iterator[Trouble]:
        """Pass a trouble on unless it is the one told last."""
        told = self._told
        news = told is None or told[0] != trouble.kind or trouble.host_ns - told[1] > REPEAT_S * 1e9
        if news:
            self._told = (trouble.kind, trouble.host_ns)
            yield trouble


def hello_problem(hello: wire.Hello) -> str | None:
    """Why samples after this HELLO could not be used; None if they can."""
    if not hello.sample_rate or not hello.gyro_lsb:
        return (
            f"its HELLO states a rate of {hello.sample_rate} mHz and {hello.gyro_lsb} tenths of an LSB per "
            "deg/s; neither can be 0. The firmware's settings are wrong."
        )
    return None
