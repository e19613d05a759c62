"""Tests of the unchanged Arduino sketch, which is compiled with a stub of the Arduino core and run in virtual
time.
"""

import json
import subprocess
import tomllib
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from fltea.records.events import RawSample
from fltea.stream.decode import Decoder
from fltea.wire import layout as wire
from fltea.wire.block_reader import FrameReader
from fltea.wire.message_events import hello_event
from fltea.wire.messages import Frame

from tests.rig.blocks import track_one
from tests.rig.built import make
from tests.rig.tiers import long, slow
from tests.rig.toolchain import needed

FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[1]
SKETCH = ROOT / "firmware/arduino/fltea"


@pytest.fixture(scope="session", params=[slow("g++"), long("clang++")])
def build(request: pytest.FixtureRequest) -> Path:
    """Build the sketch with one of two compilers and with all warnings as errors.

    Return the folder of the programs that were built.
    """
    needed(request.param)
    folder = ROOT / "build/tests-arduino" / request.param
    make(FOLDER / "arduino_stub", folder, f"CXX={request.param}", "all")
    return folder


class Run(NamedTuple):
    """The frames that the sketch sent, and a summary of the board at the end."""

    frames: list[Frame]
    board: dict[str, Any]

    def of(self, kind: type) -> list[Any]:
        return [f.message for f in self.frames if isinstance(f.message, kind)]

    def samples(self) -> list[Frame]:
        return [f for f in self.frames if isinstance(f.message, wire.Sample)]

    def faults(self) -> list[int]:
        return [fault.code for fault in self.of(wire.Fault)]


def run(build: Path, *arguments: str, mode: str = "timer") -> Run:
    done = subprocess.run([build / f"run-{mode}", *arguments], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    assert done.stdout[:1] == b"\0", "0x00 ends whatever is on the line before the first frame"
    reader = FrameReader()
    frames = reader.feed_all(done.stdout)
    assert set(reader.counts) == {"frames"}
    assert all(isinstance(frame, Frame) for frame in frames)
    return Run([f for f in frames if isinstance(f, Frame)], json.loads(done.stderr))


def lost(run: Run) -> tuple[list[str], int, int]:
    """Pass the frames of a run to the host's sequence tracker.

    Return the reasons for which epochs began, and two numbers of samples: of those that were lost, and of
    those that were delivered in epochs.
    """
    place = Decoder(lambda: 0, max_gap=10**6)
    reasons: list[str] = []
    for frame in run.frames:
        match frame.message:
            case wire.Hello() as hello:
                place.on_hello(hello_event(hello, "test", 0))
            case wire.Sample():
                arrival_ns = frame.device_us * 1000
                raw = RawSample(frame.sequence, frame.device_us, arrival_ns, (0, 0, 0))
                placed = track_one(place, raw)
                if placed.new_epoch:
                    reasons.append(placed.new_epoch)
    counts = place.counts
    assert counts.before_hello == counts.duplicates == 0
    return reasons, counts.lost, counts.delivered


def test_parts_of_the_port(build: Path) -> None:
    done = subprocess.run([build / "bus"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_core_as_an_arduino_library_has_the_version_of_the_project() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert (
        f"version={project['version']}"
        in (ROOT / "firmware/core/library.properties").read_text().splitlines()
    )


def test_the_sketch_is_short() -> None:
    assert len((SKETCH / "fltea.ino").read_text().splitlines()) <= 40


@pytest.mark.parametrize("mode", ["timer", "data_ready"])
def test_ten_quiet_seconds(build: Path, mode: str) -> None:
    quiet = run(build, "10", mode=mode)
    samples = quiet.samples()
    assert [s.sequence for s in samples] == list(range(len(samples)))
    assert len(samples) in range(983, 987)  # the set-up takes 0.15 s
    steps = [b.device_us - a.device_us for a, b in pairwise(samples)]
    assert set(steps) <= set(range(9990, 10011))
    for sample, frame in zip(quiet.of(wire.Sample), samples, strict=True):
        assert sample.flags == 0
        # the stub's sensor gives the time of reading in ms
        assert abs(sample.gyro_x - frame.device_us / 1000) <= 2
    hello = quiet.of(wire.Hello)[-1]
    assert hello.boot_id == 0x12345678
    assert hello.device_id == bytes(range(16))
    assert " arduino " in hello.firmware_version
    assert (hello.who_am_i, hello.sensor_starts) == (0x71, 1)
    assert wire.SamplingMode(hello.sampling_mode).name.lower() == mode
    assert quiet.faults() == []
    status = quiet.of(wire.Status)[-1]
    assert status[:6] == (0, 0, 0, 0, 0, wire.ResetCause.USER)
    assert 0 < status.cpu_share < 10_000
    assert 0 < status.longest_step < 10_000
    assert (quiet.board["baud"], quiet.board["watchdog_us"]) == (wire.BAUD, 2_000_000)
    assert quiet.board["waited"] is False
    assert quiet.board["hunger_us"] < 10_000
    assert (quiet.board["edge_pin"], quiet.board["edge_mode"]) == ((2, 4) if mode == "data_ready" else (0, 0))


def test_the_sketch_fits_too_and_its_small_ring_bears_it(build: Path) -> None:
    """The sketch fits the noise of x only: the stub's sensor counts milliseconds on x, while y and z never
    change.
    """
    fitting = run(build, "16.5")
    assert [s.sequence for s in fitting.samples()] == list(range(len(fitting.samples())))
    assert fitting.of(wire.Status)[-1].dropped_frames == 0
    fits = fitting.of(wire.Fit)
    assert len(fits) >= 1
    assert {fit.axis for fit in fits} == {wire.Axis.GYRO_X}
    bins = [s for s in fitting.of(wire.Spectrum) if s.number == 1]
    assert [s.first for s in bins] == list(range(0, bins[0].total, 5))
    assert fitting.of(wire.Estimator)[-1].fit_every == 300


@pytest.mark.parametrize(
    ("trouble", "overruns", "errors", "retried"),
    [
        ("nacks=2,1", 0, 1, 1),
        ("nacks=2,4", 2, 4, 0),
        ("short=2,3", 0, 1, 1),
        ("held=2,9", 0, 1, 1),
        ("stale=2,6", 0, 0, 0),
    ],
)
def test_a_short_trouble_costs_few_samples_and_no_epoch(
    build: Path, trouble: str, overruns: int, errors: int, retried: int
) -> None:
    after = run(build, "4.8", trouble)
    status = after.of(wire.Status)[-1]
    reasons, missing, _ = lost(after)
    assert reasons == ["start"]
    assert missing == status.overruns == overruns
    assert status.i2c_errors == errors
    assert (status.sensor_reinits, status.dropped_frames) == (0, 0)
    assert sum(bool(s.flags & wire.SampleFlags.RETRIED) for s in after.of(wire.Sample)) == retried


@pytest.mark.parametrize("stalls", [1, 2])
def test_a_stalled_transfer_loses_its_instants_and_nothing_else(build: Path, stalls: int) -> None:
    """A sample that is read a period or more after its instant is lost, because its time would be wrong."""
    after = run(build, "4.8", f"stalls=2,{stalls}")
    reasons, missing, _ = lost(after)
    assert reasons == ["start"]
    assert missing == after.of(wire.Status)[-1].overruns <= 6 * stalls


@pytest.mark.parametrize(
    ("trouble", "mode", "fault"),
    [
        ("unplug=2,1.2", "timer", wire.FaultCode.SENSOR_LOST),
        ("unplug=2,1.2", "data_ready", wire.FaultCode.DATA_READY_MISSING),
        ("brownout=2,0", "timer", wire.FaultCode.READBACK_MISMATCH),
        ("scl=2,1", "timer", wire.FaultCode.BUS_HELD),
        ("noint=2,1.2", "data_ready", wire.FaultCode.DATA_READY_MISSING),
    ],
)
def test_a_sensor_that_was_away_begins_an_epoch_and_every_instant_is_accounted_for(
    build: Path, trouble: str, mode: str, fault: wire.FaultCode
) -> None:
    after = run(build, "6.8", trouble, mode=mode)
    status = after.of(wire.Status)[-1]
    reasons, missing, delivered = lost(after)
    assert reasons[0] == "start"
    assert set(reasons[1:]) == {"sensor_restart"}
    assert fault in after.faults()
    assert 1 <= len(reasons) - 1 <= status.sensor_reinits == after.of(wire.Hello)[-1].sensor_starts - 1
    assert missing == status.overruns
    assert delivered + missing == after.samples()[-1].sequence + 1
    assert after.board["longest_us"] < 10_000


def test_a_line_that_takes_nothing_loses_whole_frames_and_counts_them(build: Path) -> None:
    after = run(build, "5.8", "deaf=2,1")
    status = after.of(wire.Status)[-1]
    reasons, missing, _ = lost(after)
    assert reasons == ["start"]
    assert missing == status.dropped_frames > 90
    assert status.overruns == 0
    assert after.board["waited"] is False


def test_a_stalled_transfer_takes_as_long_as_the_readme_says(build: Path) -> None:
    """When a read of the sensor stalls, Arduino's library Wire waits twice for a fixed number of loops before
    it gives up, which takes 55 ms. Two stalled reads in a row are the worst case.
    """
    one, two = run(build, "3", "stalls=2,1"), run(build, "3", "stalls=2,2")
    assert one.board["longest_us"] in range(55_000, 58_000)
    assert two.board["longest_us"] in range(110_000, 113_000)
    assert two.board["hunger_us"] < two.board["watchdog_us"] / 10
