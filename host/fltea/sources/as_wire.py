"""Encodes the events of a source without a wire protocol as frames, so that they can be recorded."""

import hashlib
import struct
from collections.abc import Callable

import msgspec

from fltea.records import clock
from fltea.records.errors import UsageError
from fltea.records.events import (
    SEQUENCE_WRAP,
    TIME_WRAP_US,
    Break,
    Chunk,
    DeviceSays,
    Event,
    Failed,
    LinkDown,
    Opened,
    RawBlock,
    RawSample,
    Tick,
    TransportEvent,
    Trouble,
    host_ns_of,
)
from fltea.records.records import Hello
from fltea.records.stats import DeviceStatus
from fltea.wire import layout as wire
from fltea.wire.message_events import hello_event
from fltea.wire.messages import encode

SCALES = ("rate_hz", "gyro_lsb_per_dps", "accel_lsb_per_g")
"""The fields of HELLO on which the estimates depend. If a frame cannot hold their exact values, a replay
would give other estimates, so the source cannot be recorded.
"""

U16, U32 = 1 << 16, 1 << 32


class AsWire:
    """Encodes events as frames of fltea's wire protocol.

    A replay of the frames gives the same HELLO, samples in counts, counters of the device, and losses of the
    connection to the device. A field of the HELLO that a frame cannot hold becomes 0. Troubles are not
    encoded as frames. They are recorded only as `error` records.

    `unix_offset_ns`: function that returns the offset [ns] from the source's monotonic clock to Unix time.
    """

    def __init__(self, unix_offset_ns: Callable[[], int] = clock.unix_offset_ns) -> None:
        self._unix_offset_ns = unix_offset_ns
        self._open = False
        self._down: LinkDown | None = None
        self._sequences = dict.fromkeys(wire.MESSAGES, 0)
        self._host_ns = self._device_us = 0

    def encode(self, event: Event) -> list[TransportEvent]:
        """Return the transport events that represent one event of the source.

        Raises:
            UsageError: a frame cannot hold the event, for example because its samples are not whole counts,
                or its rate is not a multiple of 0.001 Hz.
        """
        self._host_ns = host_ns_of(event) or self._host_ns
        if isinstance(event, LinkDown):
            self._down = event
            return []
        found = self._lost(event)
        if isinstance(event, Trouble | Tick):
            return found
        if isinstance(event, Break):
            raise _impossible("frames cannot state that an epoch begins, as this replay does")
        if isinstance(event, DeviceSays):
            raise _impossible("frames of estimates come only from a device on a wire")
        if not self._open:
            self._open = True
            found.append(Opened(self._host_ns, self._unix_offset_ns()))
        if not isinstance(event, RawBlock):
            found.append(Chunk(self._frame(event), self._host_ns, self._unix_offset_ns()))
            return found
        for sample in event.samples():
            found.append(Chunk(self._frame(sample), sample.host_ns, self._unix_offset_ns()))
        return found

    def _lost(self, event: Event) -> list[TransportEvent]:
        """Return the event `Failed` if the source has just lost its device; else return nothing.

        `event`: the event that follows the loss. If it is a `Trouble`, it states the reason for the loss.
        """
        if self._down is None:
            return []
        host_ns, self._down, self._open = self._down.host_ns, None, False
        kind, message = "link_down", "the source lost its device."
        if isinstance(event, Trouble):
            kind, message = event.kind, event.message
        return [Failed(kind, message, host_ns, self._unix_offset_ns())]

    def _frame(self, event: Hello | RawSample | DeviceStatus) -> bytes:
        try:
            match event:
                case Hello():
                    message: wire.Message = _hello(event)
                case RawSample():
                    message = _sample(event)
                    self._sequences[wire.Sample.TYPE] = event.sequence % SEQUENCE_WRAP
                    self._device_us = event.device_us % TIME_WRAP_US
                case DeviceStatus():
                    message = _status(event)
            sequence = self._sequences[message.TYPE]
            self._sequences[message.TYPE] = (sequence + 1) % SEQUENCE_WRAP
            return encode(message, sequence, self._device_us)
        except (struct.error, ValueError) as error:
            raise _impossible(f"{type(event).__name__}: {error}") from error


def _impossible(why: str) -> UsageError:
    return UsageError(
        f"this source cannot be recorded as frames: {why}. Write its samples instead: fltea run --samples."
    )


def as_stated(hello: Hello) -> Hello:
    """Return the HELLO with the fields of the device's identity as a replay of its recording gives them.

    They may differ from the source's, since a frame cannot hold all their values.

    Raises:
        UsageError: a frame cannot hold the HELLO.
    """
    try:
        stated = hello_event(_hello(hello), hello.source, hello.host_ns)
    except (struct.error, ValueError) as error:
        raise _impossible(f"Hello: {error}") from error
    names = {name: getattr(stated, name) for name in ("boot_id", "device_id", "who_am_i", "sensor_starts")}
    return msgspec.structs.replace(hello, **names)


def _hello(hello: Hello) -> wire.Hello:
    message = wire.Hello(
        wire.PROTOCOL_MAJOR,
        wire.PROTOCOL_MINOR,
        wire.SCHEMA_HASH,
        boot_id=(hello.boot_id or 0) % U32,
        device_id=_device_id(hello.device_id),
        firmware_version=(hello.firmware_version or "").encode("ascii", "replace").decode()[:24],
        who_am_i=hello.who_am_i or 0,
        sensor_starts=(hello.sensor_starts or 0) % U16,
        sample_rate=round(hello.rate_hz / wire.Hello.SCALE["sample_rate"]),
        gyro_range=round(hello.gyro_range_dps or 0),
        gyro_lsb=round((hello.gyro_lsb_per_dps or 0) / wire.Hello.SCALE["gyro_lsb"]),
        accel_range=round(hello.accel_range_g or 0),
        accel_lsb=round(hello.accel_lsb_per_g or 0),
        gyro_dlpf=round(hello.gyro_dlpf_hz or 0),
        sampling_mode=_number(wire.SamplingMode, hello.sampling_mode),
    )
    # `pack` raises an error if a value does not fit into a frame. Below it is checked that the values that
    # fit are also exact.
    message.pack()
    if hello.gyro_lsb_per_dps is None:
        raise ValueError("its samples are in deg/s, not in counts")
    stated = hello_event(message, "", 0)
    for name in SCALES:
        asked, got = getattr(hello, name) or 0.0, getattr(stated, name)
        if asked != got:
            raise ValueError(f"{name} {asked:g} can only be stated as {got:g}")
    return message


def _device_id(text: str | None) -> bytes:
    """Return sixteen bytes that identify the device.

    The bytes are the device's ID if this has sixteen bytes, and otherwise a digest of the ID.
    """
    if text is None:
        return bytes(16)
    try:
        data = bytes.fromhex(text)
    except ValueError:
        data = b""
    return data if len(data) == 16 else hashlib.sha256(text.encode()).digest()[:16]


def _sample(raw: RawSample) -> wire.Sample:
    if len(raw.gyro) != 3:
        raise ValueError(f"{len(raw.gyro)} axes of angular rate; a frame has three")
    accel = raw.accel or (0, 0, 0)
    return wire.Sample._make(map(_count, (*raw.gyro, *accel, raw.temperature or 0, raw.flags)))


def _count(value: float) -> int:
    if value != int(value):
        raise ValueError(f"{value:g} is not a whole count")
    return int(value)


def _status(status: DeviceStatus) -> wire.Status:
    return wire.Status(
        status.i2c_errors % U32,
        status.bus_recoveries % U32,
        status.sensor_reinits % U32,
        status.overruns % U32,
        status.dropped_frames % U32,
        _number(wire.ResetCause, status.reset_cause),
        cpu_share=0,  # a source without a wire protocol does not know the load of the device's processor
        longest_step=0,
    )


def _number(enum: type[wire.SamplingMode | wire.ResetCause], name: str) -> int:
    """Return the value of the enum's member whose name in lower case is `name`; 255 for an unknown name."""
    return next((int(member) for member in enum if member.name.lower() == name), 255)
