"""Helpers for the tests of recordings: simulate a serial port's data, record them as the daemon does, and
read them back.
"""

import random
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import msgspec
from fltea.recording.part_reader import Part, read_entries, read_info
from fltea.recording.session import WIRE, Entry
from fltea.records.events import Chunk, Failed, Opened, TransportEvent
from fltea.records.records import AnyRecord
from fltea.settings.config import Config, load_config
from fltea.settings.outputs import RecordConfig
from fltea.sinks.record import RecordSink
from fltea.sources.open_source import open_source
from fltea.sources.synthetic import parse_noise
from fltea.stream.pipeline import Pipeline
from mcap.reader import make_reader
from mcap.records import Message

from tests.rig.blocks import records_of
from tools.fed_source import FedSource
from tools.standin import Device

MONOTONIC_NS, OFFSET_NS = 5_000_000_000, 1_800_000_000_123_456_789
SMALL = {"estimator.window": 50, "estimator.startup": 20, "name": "due"}
PERIOD_NS = 10_000_000


def transport(
    samples: int = 200, boots: int = 1, seed: int = 1, contradicting: int = 0
) -> list[TransportEvent]:
    """Return the events of a device's serial port, with frames cut anywhere, late arrivals and lost frames.

    Between two boots the port is unplugged.

    `contradicting`: number of samples of each boot during which HELLO states twice the true rate.
    """
    rng = random.Random(seed)
    now_ns, found = MONOTONIC_NS, list[TransportEvent]()

    def offset_ns() -> int:
        return OFFSET_NS + rng.randrange(-300, 300)

    for boot in range(boots):
        device = Device(parse_noise(f"seed={seed}"), boot_id=boot + 1)
        if boot:
            found.append(Failed("unplugged", "the port was lost.", now_ns, offset_ns()))
            now_ns += 7 * 10**9
        found.append(Opened(now_ns, offset_ns()))
        true = device.hello
        device.hello = true._replace(sample_rate=2 * true.sample_rate) if contradicting else true
        pending = device.booted()
        for k in range(samples):
            if k == contradicting:
                device.hello = true
            frames = device.next_frames()
            pending += b"" if k in (60, 61, 150) else frames
            now_ns += PERIOD_NS
            cut = rng.randrange(len(pending) + 1) if k < samples - 1 else len(pending)
            if cut:
                late_ns = int(rng.expovariate(1e-6))
                found.append(Chunk(pending[:cut], now_ns + late_ns % PERIOD_NS, offset_ns()))
            pending = pending[cut:]
    return found


def recording_to(folder: Path, **settings: Any) -> RecordConfig:
    """Return settings for the recording of one device."""
    return RecordConfig(folder=str(folder), **settings).for_devices(1)


def record(
    folder: Path,
    items: Iterable[TransportEvent],
    report: Callable[[str, str], None] = lambda kind, text: None,
    device: str = "due",
    end: bool = True,
    estimate_on: str = "host",
    **settings: object,
) -> tuple[list[AnyRecord], RecordSink]:
    """Process and record events, as the daemon does; if `end` is false, the recording stays open."""
    sink = RecordSink(recording_to(folder, **settings), device, report)
    source = FedSource("/dev/due")
    pipeline = Pipeline(
        source, load_config(None, SMALL | {"name": device, "estimator.estimate_on": estimate_on})
    )
    records = []
    for item in items:
        sink.write(item)
        for event in source.wire.feed(item, item.host_ns):
            for one in pipeline.feed(event):
                records += records_of([one])
                sink.write(one)
        source.wire.resume(item.host_ns)
        sink.flush()
    if end:
        sink.close()
    return records, sink


def kill(sink: RecordSink) -> None:
    """Leave a recorder in the state of a killed process.

    The recorder's file is closed, and nothing more is written to it.
    """
    assert sink._part is not None
    sink._part.writer._file.close()


def replay(path: Path, **overrides: object) -> list[AnyRecord]:
    config: Config = load_config(None, {**SMALL, "source": f"replay:{path}", **overrides})
    source = open_source(config)
    pipeline = Pipeline(source, config)
    return records_of(one for event in source.events() for one in pipeline.feed(event))


def without(records: Iterable[AnyRecord], *fields: str) -> list[AnyRecord]:
    """Return the records with "" in `fields`, whose values differ from run to run."""
    return [msgspec.structs.replace(one, **dict.fromkeys(fields, "")) for one in records]


def messages(path: Path) -> list[tuple[str, Message]]:
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return [(channel.topic, message) for _, channel, message in reader.iter_messages()]


def wire_of(path: Path) -> list[Message]:
    return [message for topic, message in messages(path) if topic == "/due/wire"]


def metadata_of(path: Path) -> list[tuple[str, dict[str, str]]]:
    with path.open("rb") as file:
        return [(entry.name, entry.metadata) for entry in make_reader(file).iter_metadata()]


def wire_entries(path: Path) -> list[Entry]:
    """Return the entries of a recording that hold the serial port's bytes.

    The entries are returned even if the end of the recording is cut off.
    """
    entries = read_entries(Part(path, read_info(path)))
    return [entry for entry in entries if entry.topic == WIRE]


def wire_data(path: Path) -> list[bytes]:
    return [entry.data for entry in wire_entries(path)]


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.mcap"))


def sink_in(folder: Path, told: list[tuple[str, str]] | None = None, **settings: Any) -> RecordSink:
    told = [] if told is None else told
    return RecordSink(recording_to(folder, **settings), "due", lambda *one: told.append(one))


def written(sink: RecordSink, *items: Any) -> None:
    """Write all items, and close the sink."""
    for item in items:
        sink.write(item)
    sink.close()
