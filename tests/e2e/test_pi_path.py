"""The Raspberry Pi's path beside the Due's: one noise, one way to set the sensor up, one estimate."""

from functools import cache
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest
from blocks import of_samples, records_of
from due_support import image
from fake_smbus import MS, Pi, S
from fltea.records.events import Chunk, Opened, TransportEvent
from fltea.records.records import AnyRecord, Estimate, Hello, Sample
from fltea.settings.config import load_config
from fltea.sources.as_wire import AsWire
from fltea.sources.wire_events import WireEvents
from fltea.stream.pipeline import Pipeline
from support import QUICK, Processes

from tools.due_emulator.noise import fractional_world
from tools.due_run import DueRun

NOISE = "alpha=0.5&f=-1&seed=7"
SECONDS = 12
SOURCE = "i2c:///dev/i2c-1?addr=0x68"


class OfWire:
    """A source whose bytes are already there."""

    live = prompt = True
    unix_offset_ns = 0

    def __init__(self, items: list[TransportEvent]) -> None:
        wire = WireEvents("the wire")
        self.events = [event for item in items for event in wire.feed(item, item.host_ns)]
        self.link_stats = wire.link_stats


def walked(items: list[TransportEvent]) -> list[AnyRecord]:
    source = OfWire(items)
    pipeline = Pipeline(source, load_config(None, {"samples": True}))
    return records_of(item for event in source.events for item in pipeline.feed(event))


def of(records: list[AnyRecord], kind: type) -> list:
    return [record for record in records if isinstance(record, kind)]


@cache
def through_the_due() -> tuple[DueRun, list[AnyRecord]]:
    run = DueRun(image(), noise=NOISE).run_until(SECONDS)
    frames = bytes(run.wire).split(b"\0")
    items: list[TransportEvent] = [Opened(0, 0)]
    items += [Chunk(frame + b"\0", 10 * MS * i, 0) for i, frame in enumerate(frames)]
    return run, walked(items)


def gyro(records: list[AnyRecord]) -> list[tuple[float, ...]]:
    return [sample.gyro_dps for sample in of(records, Sample)]


@cache
def through_the_pi() -> Pi:
    """The same noise, and switched on so that the first sample is of the same piece of it."""
    noise = fractional_world(NOISE)
    first = gyro(through_the_due()[1])[:20]
    seen = gyro(Pi(noise).run_until(1).records)
    if first[0] not in seen or seen[seen.index(first[0]) :][:20] != first:
        pytest.fail("the two paths did not meet the same noise within the first second")
    begin_ns = seen.index(first[0]) * 10 * MS
    pi = Pi(fractional_world(NOISE), start_ns=begin_ns, overrides={"samples": True})
    return pi.run_until(begin_ns / S + SECONDS)


def test_the_same_noise_gives_the_same_samples() -> None:
    due, pi = gyro(through_the_due()[1]), gyro(through_the_pi().records)
    n = min(len(due), len(pi))
    assert n > (SECONDS - 1) * 100
    assert due[:n] == pi[:n]
    assert len(set(due)) > n // 3


def test_the_same_noise_gives_the_same_estimates() -> None:
    """State, order and parameter of every axis with every sample, to the last bit."""
    due, pi = (of(records, Estimate) for records in (through_the_due()[1], through_the_pi().records))
    n = min(len(due), len(pi))
    assert n > (SECONDS - 1) * 100 - 500
    for one, other in zip(due[:n], pi[:n], strict=True):
        assert one.axes == other.axes
    last = pi[n - 1].axes["gyro_x"].fltea
    assert last.valid
    assert last.alpha is not None


def test_both_paths_state_the_same_scales() -> None:
    due, pi = of(through_the_due()[1], Hello)[-1], through_the_pi().hello
    for field in ("rate_hz", "who_am_i", "sensor", "gyro_range_dps", "gyro_lsb_per_dps", "accel_range_g",
                  "accel_lsb_per_g", "gyro_dlpf_hz"):  # fmt: skip
        assert getattr(due, field) == getattr(pi, field), field
    assert (due.sampling_mode, pi.sampling_mode) == ("timer", "fifo")


def test_both_paths_set_the_sensor_up_alike() -> None:
    fifo_mode = 0x40
    for register in (0x1A, 0x1B, 0x1C, 0x1D, 0x37, 0x6B):
        due = through_the_due()[0].board.socket.chip.read_block(register, 1)[0]
        pi = through_the_pi().chip.read_block(register, 1)[0]
        assert due == pi & ~(fifo_mode if register == 0x1A else 0), f"register 0x{register:02X}"


def test_a_recording_replays_to_the_same_estimates() -> None:
    """The recorder writes frames; what they give is what was live."""
    pi = through_the_pi()
    as_wire = AsWire(pi.host.unix_offset_ns)
    replayed = walked([item for event in of_samples(pi.events) for item in as_wire.encode(event)])
    live = of(pi.records, Estimate)
    again = of(replayed, Estimate)
    assert len(live) == len(again) > 500
    assert [estimate.axes for estimate in live] == [estimate.axes for estimate in again]
    assert [sample.seq for sample in of(replayed, Sample)] == [
        sample.seq for sample in of(pi.records, Sample)
    ]
    hello = msgspec.structs.asdict(of(replayed, Hello)[0])
    mine = msgspec.structs.asdict(pi.hello)
    differing = {name for name in mine if mine[name] != hello[name]}
    assert differing <= {"source", "protocol", "schema_hash", "host_ns", "device"}


def test_the_command(processes: Processes) -> None:
    """`fltea run` on a machine with a sensor on its bus."""
    launcher = (str(Path(__file__).with_name("pi_launcher.py")), NOISE)
    command = processes.daemon("--source", SOURCE, "--samples", *QUICK, program=launcher)
    command.wait_for(lambda: len(command.of("estimate")) >= 120, "estimates")
    assert command.end() == (0, "")
    hello = command.of("hello")[0]
    assert (hello["source"], hello["sampling_mode"]) == ("i2c:/dev/i2c-1?addr=0x68", "fifo")
    samples = command.of("sample")
    assert [s["seq"] for s in samples] == list(range(len(samples)))
    assert all(a["host_ns"] < b["host_ns"] for a, b in pairwise(samples))
    assert command.of("estimate")[-1]["axes"]["gyro_z"]["fltea"]["valid"]
    stats = command.of("stats")[-1]
    assert stats["board"]["i2c_errors"] == stats["board"]["overruns"] == 0
    assert stats["samples"]["lost"] == 0
    assert command.of("error") == []
