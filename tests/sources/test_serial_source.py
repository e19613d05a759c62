"""Tests how the serial source diagnoses a device, with simulated transport events and simulated time."""

from typing import Any

import pytest
from fltea.records import clock
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
from fltea.records.records import Hello
from fltea.records.stats import DeviceStatus
from fltea.sources.serial import SerialSource
from fltea.sources.wire_events import SILENCE_S, WireEvents
from fltea.wire import layout as wire
from fltea.wire.messages import encode
from fltea.wire.reader import Reader

from tests.rig.blocks import in_samples
from tests.rig.host_support import WIRE_HELLO as HELLO

S = 10**9
LIMIT = int(SILENCE_S * S)
SAMPLE = wire.Sample(1, -2, 3, 4, -5, 6, 700, 4)


class Script:
    """Feeds transport events to the source's diagnosis one by one."""

    def __init__(self) -> None:
        self.source = WireEvents("/dev/none")
        assert self.at(Opened(0)) == []

    def at(self, item: TransportEvent) -> list[Any]:
        return in_samples(self.source.feed(item, item.host_ns))

    def hears(self, data: bytes, host_ns: int) -> list[Any]:
        return self.at(Chunk(data, host_ns))

    def later(self, host_ns: int) -> list[Event]:
        return [event for event in self.source.feed(None, host_ns) if not isinstance(event, Tick)]


@pytest.fixture
def script() -> Script:
    return Script()


def hello_bytes(sequence: int = 0, **changes: object) -> bytes:
    return encode(HELLO._replace(**changes), sequence, 0)


def names(events: list[Event]) -> list[str]:
    """Return a name for each event: the kind of an error (`Trouble`), the type of any other event."""
    return [event.kind if isinstance(event, Trouble) else type(event).__name__ for event in events]


def test_hello_in_units(script: Script) -> None:
    assert script.hears(b"\0" + hello_bytes(), 1) == [
        Hello(
            source="serial:/dev/none",
            host_ns=1,
            rate_hz=100.0,
            sampling_mode="timer",
            protocol=f"{wire.PROTOCOL_MAJOR}.{wire.PROTOCOL_MINOR}",
            schema_hash=f"0x{wire.SCHEMA_HASH:08X}",
            boot_id=5,
            device_id="000102030405060708090a0b0c0d0e0f",
            firmware_version="1.2.3",
            who_am_i=0x71,
            sensor="MPU-9250",
            sensor_starts=1,
            gyro_range_dps=2000.0,
            gyro_lsb_per_dps=16.4,
            accel_range_g=2.0,
            accel_lsb_per_g=16384.0,
            gyro_dlpf_hz=184.0,
        )
    ]


def test_each_message_becomes_its_event(script: Script) -> None:
    status = wire.Status(1, 2, 3, 4, 5, wire.ResetCause.WATCHDOG, 4321, 700)
    fault = wire.Fault(wire.FaultCode.SENSOR_LOST, 0x10)
    data = hello_bytes() + encode(SAMPLE, 9, 90_000) + encode(status, 0, 0) + encode(fault, 0, 0)
    _, sample, health, trouble = script.hears(data, 3)
    assert sample == RawSample(9, 90_000, 3, (1, -2, 3), (4, -5, 6), 700, 4)
    assert health == DeviceStatus(1, 2, 3, 4, 5, "watchdog", 43.21, 700)
    assert (trouble.kind, trouble.fatal) == ("device_fault", False)
    assert "sensor_lost: the sensor stopped answering (16 errors in a row)" in trouble.message


def test_a_status_that_measured_no_time_says_nothing_of_it(script: Script) -> None:
    """A STATUS frame with zeros in place of time measurements gives None for them. A source that measures no
    times is recorded with such zeros, and gave None in the live run.
    """
    status = wire.Status(1, 2, 3, 4, 5, wire.ResetCause.WATCHDOG, 0, 0)
    *_, health = script.hears(hello_bytes() + encode(status, 0, 0), 3)
    assert health == DeviceStatus(1, 2, 3, 4, 5, "watchdog", None, None)


def test_codes_that_this_version_does_not_know_are_named_by_number(script: Script) -> None:
    data = hello_bytes(sampling_mode=77, who_am_i=0x42) + encode(wire.Fault(99, 0), 0, 0)
    hello, sensor, trouble = script.hears(data, 3)
    assert hello.sampling_mode == "unknown (77)"
    assert hello.sensor == "unknown sensor (WHO_AM_I 0x42)"
    assert (sensor.kind, "0x42" in sensor.message) == ("sensor_unknown", True)
    assert "unknown (99)" in trouble.message


def test_silence_is_told_once_and_again_after_speech_or_a_minute(script: Script) -> None:
    assert script.later(LIMIT - 1) == []
    [trouble] = script.later(LIMIT)
    assert isinstance(trouble, Trouble)
    assert (trouble.kind, "programming port" in trouble.message) == ("silent", True)
    assert script.later(LIMIT + 60 * S) == []
    assert names(script.later(LIMIT + 61 * S)) == ["silent"]
    script.hears(hello_bytes(), 70 * S)
    assert names(script.later(76 * S)) == ["silent"]
    # Five seconds with bytes, but without a valid frame, mean a wrong baud rate. A silence does not count.
    assert script.hears(hello_bytes()[:1], 76 * S + 1) == []
    assert names(script.hears(hello_bytes()[1:], 76 * S + 2)) == ["Hello"]


def test_rubbish_for_five_seconds_is_a_wrong_baud_rate(script: Script) -> None:
    *before, found = [script.hears(b"\x55\xaa" * 50, t * S // 2) for t in range(1, 12)]
    assert before == [[]] * 10
    [trouble] = found
    assert trouble.kind == "no_valid_frame"
    assert "1100 bytes" in trouble.message
    assert "baud" in trouble.message


def read(source: SerialSource, monkeypatch: pytest.MonkeyPatch, items: Any) -> Any:
    """Return the events of a serial source whose reading thread yields these items."""
    monkeypatch.setattr(Reader, "events", lambda reader, timeout_s: iter(items))
    monkeypatch.setattr(Reader, "start", lambda reader: None)
    return source.events()


def test_being_held_up_ourselves_proves_nothing(monkeypatch) -> None:
    """The program was stopped for eight seconds, so a device must not count as silent for this time."""
    now_ns = [S]
    monkeypatch.setattr(clock, "host_ns", lambda: now_ns[0])

    def stream():
        yield Opened(S)
        yield Chunk(hello_bytes(), S)
        now_ns[0] += 8 * S
        yield None
        now_ns[0] += LIMIT
        yield None

    assert names(list(read(SerialSource("/dev/none", 250000), monkeypatch, stream()))) == [
        "Hello",
        "Tick",
        "Tick",
    ]


def test_the_tap_gets_everything_before_it_is_interpreted(monkeypatch) -> None:
    source = SerialSource("/dev/none", 250000)
    items = [Opened(S, 7), Chunk(hello_bytes(), S, 8), None, Failed("unplugged", "gone", 2 * S, 9)]
    seen: list[object] = []
    monkeypatch.setattr(clock, "host_ns", lambda: 2 * S)
    source.tap = seen.append
    offsets = []
    for event in read(source, monkeypatch, items):
        seen.append(type(event).__name__)
        offsets.append(source.unix_offset_ns)
    assert seen == [items[0], items[1], "Hello", "Tick", "Tick", items[3], "LinkDown", "Trouble"]
    assert offsets == [8, 8, 8, 9, 9]


@pytest.mark.parametrize("zero", ["sample_rate", "gyro_lsb"])
def test_a_hello_without_rate_or_scale_is_refused(zero: str, script: Script) -> None:
    assert names(script.hears(hello_bytes(**{zero: 0}) + encode(SAMPLE, 0, 0), 1)) == [
        "LinkDown",
        "bad_hello",
    ]
    assert names(script.hears(hello_bytes() + encode(SAMPLE, 1, 0), 2)) == ["Hello", "RawSample"]


def test_frames_without_hello(script: Script) -> None:
    for k in range(10):
        assert names(script.hears(encode(SAMPLE, k, k), k * S // 2)) == ["RawSample"]
    assert names(script.hears(encode(SAMPLE, 10, 10), LIMIT)) == ["RawSample", "no_hello"]


def test_another_version_is_told_once_and_its_samples_are_not_believed(script: Script) -> None:
    other = hello_bytes(protocol_major=wire.PROTOCOL_MAJOR + 1)
    assert names(script.hears(other + encode(SAMPLE, 0, 0), 1)) == ["LinkDown", "version"]
    assert script.hears(other + encode(SAMPLE, 1, 0), S) == [LinkDown(S)]
    assert script.source.link_stats().refused == 4
    assert names(script.hears(hello_bytes() + encode(SAMPLE, 2, 0), 2 * S)) == ["Hello", "RawSample"]


def test_a_lost_port_is_link_down_and_reset(script: Script) -> None:
    script.hears(hello_bytes() + encode(SAMPLE, 0, 0)[:10], 1)
    assert script.at(Failed("unplugged", "text", 2)) == [LinkDown(2), Trouble("unplugged", "text", 2)]
    assert script.later(10 * LIMIT) == [], "a port that is not open is not silent"
    assert script.at(Failed("no_port", "text", 3)) == [LinkDown(3), Trouble("no_port", "text", 3)]
    assert script.at(Failed("no_port", "text", 4)) == [LinkDown(4)]
    script.at(Opened(5))
    assert names(script.hears(hello_bytes(), 6)) == ["Hello"]
    stats = script.source.link_stats()
    assert (stats.reconnects, stats.frames, stats.bad_frames) == (1, 2, {})


def test_damage_is_counted_by_reason(script: Script) -> None:
    broken = bytearray(encode(SAMPLE, 0, 0))
    broken[-4] ^= 0x40
    script.hears(b"\0" + bytes(broken) + b"\x05\x01\0" + hello_bytes(), 1)
    stats = script.source.link_stats()
    assert stats.bad_frames == {"crc": 1, "cobs": 1}
    assert stats.frames == 1
    assert stats.bytes == 1 + len(broken) + 3 + len(hello_bytes())


def test_nothing_for_a_while_is_a_tick() -> None:
    assert list(WireEvents("port").feed(None, 5)) == [Tick(5)]


@pytest.mark.parametrize(("who_am_i", "name"), [(0x70, "MPU-6500"), (0x68, "MPU-6050"), (0x75, "clone")])
def test_a_relative_is_warned_of_once_and_used(who_am_i: int, name: str, script: Script) -> None:
    found = script.hears(hello_bytes(who_am_i=who_am_i) + encode(SAMPLE, 0, 0), 1)
    assert names(found) == ["Hello", "sensor_relative", "RawSample"]
    assert (found[1].fatal, name in found[1].message) == (False, True)
    assert names(script.hears(hello_bytes(who_am_i=who_am_i, boot_id=6, sensor_starts=2), 2)) == ["Hello"]


@pytest.mark.parametrize("who_am_i", [0x71, 0x73, 0])
def test_the_right_sensor_and_none_yet_are_nothing_peculiar(who_am_i: int, script: Script) -> None:
    [hello] = script.hears(hello_bytes(who_am_i=who_am_i), 1)
    assert "unknown" not in hello.sensor
    assert (hello.sensor == "no sensor") == (who_am_i == 0)


def test_the_same_fault_is_told_once_a_minute_and_anew_after_a_start_of_the_sensor(script: Script) -> None:
    missing = encode(wire.Fault(wire.FaultCode.SENSOR_MISSING, 0x68), 0, 0)
    held = encode(wire.Fault(wire.FaultCode.BUS_HELD, 1), 0, 0)
    script.hears(hello_bytes(), 0)
    told = [names(script.hears(missing + hello_bytes(), t * S)) for t in range(63)]
    assert [t for t, found in enumerate(told) if "device_fault" in found] == [0, 60]
    assert names(script.hears(held, 63 * S)) == ["device_fault"]
    script.hears(hello_bytes(sensor_starts=2), 64 * S)
    assert names(script.hears(missing, 64 * S)) == ["device_fault"]
