"""The serial source's judgement, with transport events made up and time under control."""

import pytest
from blocks import in_samples
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
from fltea.records.records import DeviceStatus, Hello
from fltea.sources.serial import SerialSource
from fltea.sources.wire_events import SILENCE_S, WireEvents
from fltea.wire import layout as wire
from fltea.wire.messages import encode
from fltea.wire.transport import Reader
from host_support import WIRE_HELLO as HELLO

S = 10**9
LIMIT = int(SILENCE_S * S)
SAMPLE = wire.Sample(1, -2, 3, 4, -5, 6, 700, 4)


class Script:
    """Drives the judgement of a wire, event by event."""

    def __init__(self) -> None:
        self.source = WireEvents("/dev/none")

    def at(self, item: TransportEvent) -> list[Event]:
        return in_samples(self.source.feed(item, item.host_ns))

    def later(self, host_ns: int) -> list[Trouble]:
        return [event for event in self.source.feed(None, host_ns) if isinstance(event, Trouble)]


@pytest.fixture
def script() -> Script:
    script = Script()
    assert script.at(Opened(0)) == []
    return script


def hello_bytes(sequence: int = 0, **changes: object) -> bytes:
    return encode(HELLO._replace(**changes), sequence, 0)


def test_hello_in_units(script: Script) -> None:
    events = script.at(Chunk(b"\0" + hello_bytes(), 1))
    assert events == [
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
    _, sample, health, trouble = script.at(Chunk(data, 3))
    assert sample == RawSample(9, 90_000, 3, (1, -2, 3), (4, -5, 6), 700, 4)
    assert health == DeviceStatus(1, 2, 3, 4, 5, "watchdog", 43.21, 700)
    assert isinstance(trouble, Trouble)
    assert trouble.kind == "device_fault"
    assert "sensor_lost: the sensor stopped answering (16 errors in a row)" in trouble.message
    assert not trouble.fatal


def test_a_status_that_measured_no_time_says_nothing_of_it(script: Script) -> None:
    """So a recording of a source that has no such thing replays as it was."""
    status = wire.Status(1, 2, 3, 4, 5, wire.ResetCause.WATCHDOG, 0, 0)
    *_, health = script.at(Chunk(hello_bytes() + encode(status, 0, 0), 3))
    assert health == DeviceStatus(1, 2, 3, 4, 5, "watchdog", None, None)


def test_codes_that_this_version_does_not_know_are_named_by_number(script: Script) -> None:
    data = hello_bytes(sampling_mode=77, who_am_i=0x42) + encode(wire.Fault(99, 0), 0, 0)
    hello, sensor, trouble = script.at(Chunk(data, 3))
    assert isinstance(hello, Hello)
    assert hello.sampling_mode == "unknown (77)"
    assert hello.sensor == "unknown sensor (WHO_AM_I 0x42)"
    assert isinstance(sensor, Trouble)
    assert sensor.kind == "sensor_unknown"
    assert "0x42" in sensor.message
    assert isinstance(trouble, Trouble)
    assert "unknown (99)" in trouble.message


def test_silence_is_told_once_and_again_after_speech(script: Script) -> None:
    assert script.later(LIMIT - 1) == []
    [trouble] = script.later(LIMIT)
    assert trouble.kind == "silent"
    assert "programming port" in trouble.message
    assert script.later(2 * LIMIT) == []
    script.at(Chunk(hello_bytes(), 3 * LIMIT))
    assert [t.kind for t in script.later(4 * LIMIT)] == ["silent"]


def test_the_same_trouble_is_told_again_after_a_minute(script: Script) -> None:
    assert [t.kind for t in script.later(LIMIT)] == ["silent"]
    assert script.later(LIMIT + 60 * S) == []
    assert [t.kind for t in script.later(LIMIT + 61 * S)] == ["silent"]


def test_rubbish_for_five_seconds_is_a_wrong_baud_rate(script: Script) -> None:
    events = [script.at(Chunk(b"\x55\xaa" * 50, t * S // 2)) for t in range(1, 12)]
    assert events[:10] == [[]] * 10
    [trouble] = events[10]
    assert isinstance(trouble, Trouble)
    assert trouble.kind == "no_valid_frame"
    assert "1100 bytes" in trouble.message
    assert "baud" in trouble.message


def test_the_first_byte_after_a_silence_is_not_five_seconds_of_rubbish(script: Script) -> None:
    data = hello_bytes()
    script.at(Chunk(data, 1))
    assert [t.kind for t in script.later(7 * S)] == ["silent"]
    assert script.at(Chunk(data[:1], 7 * S + 1)) == []
    assert [type(e) for e in script.at(Chunk(data[1:], 7 * S + 2))] == [Hello]


def test_being_held_up_ourselves_proves_nothing(monkeypatch) -> None:
    """Stopped for eight seconds: the device is not judged by what we did not hear."""
    now_ns = [S]
    monkeypatch.setattr(clock, "host_ns", lambda: now_ns[0])
    source = SerialSource("/dev/none", 250000)

    def stream(timeout_s: float):
        yield Opened(S)
        yield Chunk(hello_bytes(), S)
        now_ns[0] += 8 * S
        yield None
        now_ns[0] += LIMIT
        yield None

    monkeypatch.setattr(Reader, "events", lambda reader, timeout_s: stream(timeout_s))
    monkeypatch.setattr(Reader, "start", lambda reader: None)
    assert [type(e).__name__ for e in source.events()] == ["Hello", "Tick", "Tick"]


def test_the_tap_gets_everything_before_it_is_interpreted(monkeypatch) -> None:
    source = SerialSource("/dev/none", 250000)
    items = [Opened(S, 7), Chunk(hello_bytes(), S, 8), None, Failed("unplugged", "gone", 2 * S, 9)]
    seen: list[object] = []
    monkeypatch.setattr(clock, "host_ns", lambda: 2 * S)
    monkeypatch.setattr(Reader, "events", lambda reader, timeout_s: iter(items))
    monkeypatch.setattr(Reader, "start", lambda reader: None)
    source.tap = seen.append
    offsets = []
    for event in source.events():
        seen.append(type(event).__name__)
        offsets.append(source.unix_offset_ns)
    assert seen == [items[0], items[1], "Hello", "Tick", items[3], "LinkDown", "Trouble"]
    assert offsets == [8, 8, 9, 9]


@pytest.mark.parametrize("zero", ["sample_rate", "gyro_lsb"])
def test_a_hello_without_rate_or_scale_is_refused(zero: str, script: Script) -> None:
    down, trouble = script.at(Chunk(hello_bytes(**{zero: 0}) + encode(SAMPLE, 0, 0), 1))
    assert down == LinkDown(1)
    assert isinstance(trouble, Trouble)
    assert trouble.kind == "bad_hello"
    assert [type(e) for e in script.at(Chunk(hello_bytes() + encode(SAMPLE, 1, 0), 2))] == [Hello, RawSample]


def test_frames_without_hello(script: Script) -> None:
    for k in range(10):
        assert [type(e) for e in script.at(Chunk(encode(SAMPLE, k, k), k * S // 2))] == [RawSample]
    _, trouble = script.at(Chunk(encode(SAMPLE, 10, 10), LIMIT))
    assert isinstance(trouble, Trouble)
    assert trouble.kind == "no_hello"


def test_another_version_is_told_once_and_its_samples_are_not_believed(script: Script) -> None:
    other = hello_bytes(protocol_major=wire.PROTOCOL_MAJOR + 1)
    down, trouble = script.at(Chunk(other + encode(SAMPLE, 0, 0), 1))
    assert down == LinkDown(1)
    assert isinstance(trouble, Trouble)
    assert trouble.kind == "version"
    assert script.at(Chunk(other + encode(SAMPLE, 1, 0), S)) == [LinkDown(S)]
    assert script.source.link_stats().refused == 4
    events = script.at(Chunk(hello_bytes() + encode(SAMPLE, 2, 0), 2 * S))
    assert [type(e) for e in events] == [Hello, RawSample]


def test_a_lost_port_is_link_down_and_reset(script: Script) -> None:
    script.at(Chunk(hello_bytes() + encode(SAMPLE, 0, 0)[:10], 1))
    assert script.at(Failed("unplugged", "text", 2)) == [LinkDown(2), Trouble("unplugged", "text", 2)]
    assert script.later(10 * LIMIT) == [], "a port that is not open is not silent"
    assert script.at(Failed("no_port", "text", 3)) == [LinkDown(3), Trouble("no_port", "text", 3)]
    assert script.at(Failed("no_port", "text", 4)) == [LinkDown(4)]
    script.at(Opened(5))
    assert [type(e) for e in script.at(Chunk(hello_bytes(), 6))] == [Hello]
    stats = script.source.link_stats()
    assert (stats.reconnects, stats.frames, stats.bad_frames) == (1, 2, {})


def test_damage_is_counted_by_reason(script: Script) -> None:
    broken = bytearray(encode(SAMPLE, 0, 0))
    broken[-4] ^= 0x40
    script.at(Chunk(b"\0" + bytes(broken) + b"\x05\x01\0" + hello_bytes(), 1))
    stats = script.source.link_stats()
    assert stats.bad_frames == {"crc": 1, "cobs": 1}
    assert stats.frames == 1
    assert stats.bytes == 1 + len(broken) + 3 + len(hello_bytes())


def test_nothing_for_a_while_is_a_tick() -> None:
    [event] = WireEvents("port").feed(None, 5)
    assert event == Tick(5)


@pytest.mark.parametrize(("who_am_i", "name"), [(0x70, "MPU-6500"), (0x68, "MPU-6050"), (0x75, "clone")])
def test_a_relative_is_warned_of_once_and_used(who_am_i: int, name: str, script: Script) -> None:
    hello, trouble, sample = script.at(Chunk(hello_bytes(who_am_i=who_am_i) + encode(SAMPLE, 0, 0), 1))
    assert isinstance(hello, Hello)
    assert isinstance(trouble, Trouble)
    assert isinstance(sample, RawSample)
    assert (trouble.kind, trouble.fatal) == ("sensor_relative", False)
    assert name in trouble.message
    again = script.at(Chunk(hello_bytes(who_am_i=who_am_i, boot_id=6, sensor_starts=2), 2))
    assert [type(e) for e in again] == [Hello]


@pytest.mark.parametrize("who_am_i", [0x71, 0x73, 0])
def test_the_right_sensor_and_none_yet_are_nothing_peculiar(who_am_i: int, script: Script) -> None:
    [hello] = script.at(Chunk(hello_bytes(who_am_i=who_am_i), 1))
    assert isinstance(hello, Hello)
    assert "unknown" not in str(hello.sensor)
    assert (hello.sensor == "no sensor") == (who_am_i == 0)


def faults(events: list[Event]) -> list[str]:
    return [e.message for e in events if isinstance(e, Trouble) and e.kind == "device_fault"]


def test_the_same_fault_is_told_once_a_minute_and_anew_after_a_start_of_the_sensor(script: Script) -> None:
    missing = encode(wire.Fault(wire.FaultCode.SENSOR_MISSING, 0x68), 0, 0)
    held = encode(wire.Fault(wire.FaultCode.BUS_HELD, 1), 0, 0)
    script.at(Chunk(hello_bytes(), 0))
    told = [len(faults(script.at(Chunk(missing + hello_bytes(), t * S)))) for t in range(63)]
    assert [t for t, n in enumerate(told) if n] == [0, 60]
    assert len(faults(script.at(Chunk(held, 63 * S)))) == 1
    script.at(Chunk(hello_bytes(sensor_starts=2), 64 * S))
    assert len(faults(script.at(Chunk(missing, 64 * S)))) == 1
