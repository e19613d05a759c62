"""Samples of a source that has no wire protocol are written as frames of the protocol. Samples that are read
from these frames are the same.
"""

import msgspec
import pytest
from fltea.records.errors import UsageError
from fltea.records.events import Break, Chunk, Event, Failed, LinkDown, Opened, RawSample, Tick, Trouble
from fltea.records.records import Hello
from fltea.records.stats import DeviceStatus
from fltea.sources.as_wire import AsWire, as_stated
from fltea.sources.wire_events import WireEvents
from fltea.wire import layout as wire
from fltea.wire.block_reader import FrameReader
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.blocks import in_samples, of, of_samples, raw_samples
from tests.rig.host_support import hello

OFFSET_NS = 1_800_000_000_000_000_000

MPU = hello(
    device_id=bytes(range(16)).hex(),
    firmware_version="1.2.3",
    sensor="MPU-9250",
    protocol=f"{wire.PROTOCOL_MAJOR}.{wire.PROTOCOL_MINOR}",
    schema_hash=f"0x{wire.SCHEMA_HASH:08X}",
    gyro_range_dps=2000.0,
    accel_range_g=2.0,
    gyro_dlpf_hz=184.0,
    sampling_mode="fifo",
)


def round_trip(events: list[Event]) -> list[Event]:
    encoder, decoder = AsWire(lambda: OFFSET_NS), WireEvents("")
    found: list[Event] = []
    for event in of_samples(events):
        for item in encoder.encode(event):
            found += decoder.feed(item, item.host_ns)
            decoder.resume(item.host_ns)
            assert decoder.unix_offset_ns == OFFSET_NS
    assert decoder.link_stats().bad_frames == {}
    return in_samples(found)


hellos = st.builds(
    lambda boot, rate, lsb, accel, starts: msgspec.structs.replace(
        MPU,
        boot_id=boot,
        rate_hz=round(rate * 0.001, 9),
        gyro_lsb_per_dps=round(lsb * 0.1, 9),
        accel_lsb_per_g=float(accel),
        sensor_starts=starts,
    ),
    st.integers(0, 2**32 - 1),
    st.integers(1, 2**32 - 1),
    st.integers(1, 2**16 - 1),
    st.integers(0, 2**16 - 1),
    st.integers(0, 2**16 - 1),
)


@given(hellos, st.sampled_from([None, "abc", "00" * 16, "12" * 16]), st.booleans())
def test_a_hello_has_the_names_that_the_next_one_has_on_the_wire(one: Hello, device: str, bare: bool) -> None:
    one = msgspec.structs.replace(one, device_id=device)
    if bare:
        one = msgspec.structs.replace(one, boot_id=None, who_am_i=None, sensor_starts=None)
    (stated,) = (event for event in round_trip([one]) if isinstance(event, Hello))
    names = ("boot_id", "device_id", "who_am_i", "sensor_starts")
    assert [getattr(as_stated(one), name) for name in names] == [getattr(stated, name) for name in names]


statuses = st.builds(
    DeviceStatus,
    *[st.integers(0, 2**32 - 1)] * 5,
    reset_cause=st.sampled_from(["power_up", "user", "watchdog"]),
)


@given(st.lists(st.tuples(st.one_of(hellos, raw_samples, statuses), st.integers(1, 10**8)), max_size=30))
def test_what_goes_in_comes_out(found: list[tuple[Event, int]]) -> None:
    events, now_ns = [], 0
    for event, step_ns in found:
        now_ns += step_ns
        match event:
            case Hello():
                event = msgspec.structs.replace(event, host_ns=now_ns)
            case RawSample():
                event = event._replace(host_ns=now_ns)
        events.append(event)
    again = [event for event in round_trip(events) if not isinstance(event, Trouble)]
    again = [
        msgspec.structs.replace(event, source="test:") if isinstance(event, Hello) else event
        for event in again
    ]
    assert again == events


def test_a_lost_device_is_lost_again_for_the_same_reason() -> None:
    lost = Trouble("i2c_lost", "nothing answers at 0x68.", 30)
    events = [
        hello(host_ns=10),
        LinkDown(30),
        lost,
        Trouble("i2c_lost", "still nothing.", 40),
        hello(host_ns=50),
        LinkDown(60),
        hello(host_ns=70),
    ]
    encoder = AsWire(lambda: OFFSET_NS)
    items = [item for event in events for item in encoder.encode(event)]
    assert [type(item) for item in items] == [Opened, Chunk, Failed, Opened, Chunk, Failed, Opened, Chunk]
    assert items[2] == Failed("i2c_lost", "nothing answers at 0x68.", 30, OFFSET_NS)
    assert (items[5].kind, items[5].host_ns) == ("link_down", 60)
    kinds = [type(event) for event in round_trip(events)]
    assert kinds == [Hello, LinkDown, Trouble, Hello, LinkDown, Trouble, Hello]


def test_what_is_no_frame_gives_nothing() -> None:
    encoder = AsWire(lambda: OFFSET_NS)
    assert encoder.encode(Tick(5)) == []
    assert encoder.encode(Trouble("sensor_relative", "a relative.", 6, fatal=False)) == []


def test_sequences_count_by_type() -> None:
    encoder = AsWire(lambda: OFFSET_NS)
    raw = RawSample(7, 70_000, 1, (1, 2, 3))
    data = b"".join(
        item.data
        for event in of_samples([hello(), hello(), raw, hello()])
        for item in encoder.encode(event)
        if isinstance(item, Chunk)
    )
    frames = FrameReader().feed(data)
    assert [(frame.type, frame.sequence, frame.device_us) for frame in frames] == [
        (1, 0, 0),
        (1, 1, 0),
        (2, 7, 70_000),
        (1, 2, 70_000),
    ]


@pytest.mark.parametrize(
    ("event", "text"),
    [
        (hello(gyro_lsb_per_dps=None), "its samples are in deg/s, not in counts"),
        (hello(gyro_lsb_per_dps=16.384), r"gyro_lsb_per_dps 16\.384 can only be stated as 16\.4"),
        (hello(rate_hz=100 / 3), r"rate_hz 33\.3333 can only be stated as 33\.333"),
        (hello(gyro_lsb_per_dps=1e6), "Hello: .*"),
        (RawSample(0, 0, 0, (1.5, 0.0, 0.0)), r"1\.5 is not a whole count"),
        (RawSample(0, 0, 0, (1.0,)), "1 axes of angular rate"),
        (RawSample(0, 0, 0, (40_000, 0, 0)), "RawSample: .*"),
        (Break("restart", 0), "frames cannot state that an epoch begins"),
    ],
)
def test_what_a_frame_cannot_state_is_refused(event: Event, text: str) -> None:
    with pytest.raises(UsageError, match=rf"cannot be recorded as frames: .*{text}.* fltea run --samples"):
        AsWire(lambda: 0).encode(*of_samples([event]))


@pytest.mark.parametrize("name", [None, "i2c-1-0x68", "ff" * 16, "ff"])
def test_a_devices_name_stays_its_own(name: str | None) -> None:
    (found,) = of(Hello, round_trip([hello(device_id=name)]))
    (again,) = of(Hello, round_trip([hello(device_id=name)]))
    assert found.device_id == again.device_id
    assert len(found.device_id or "") == 32
    others = of(Hello, round_trip([hello(device_id="other")]))
    assert others[0].device_id != found.device_id
