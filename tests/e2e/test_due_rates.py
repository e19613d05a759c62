"""Tests of firmware for the Due that is built for 200, 500 and 1,000 Hz: exact sampling instants, no gaps,
estimates in time.
"""

import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from fltea.wire import layout as wire
from fltea.wire.block_reader import FrameReader
from fltea.wire.messages import Frame

from tests.rig.built import make
from tests.rig.due_support import DueRun, build
from tests.rig.host_support import ROOT
from tests.rig.tiers import long, slow
from tests.rig.toolchain import arm_compiler
from tools.due_run import chip_bytes

STARTUP, EVERY = 500, 50
"""Start-up window, and interval between estimates, at 500 Hz [samples]."""
SETTINGS = {
    200: ("FLTEA_RATE_HZ=200", "FLTEA_DLPF_HZ=92", "FLTEA_GYRO_RANGE_DPS=250"),
    500: ("FLTEA_RATE_HZ=500",),
    1000: ("FLTEA_RATE_HZ=1000", "FLTEA_BAUD=400000", "FLTEA_ESTIMATE=false"),
}
ENDS_S = {200: 0.5, 500: 1.5, 1000: 0.4}
FIRMWARE = ("-std=gnu++11", "-I", str(ROOT / "firmware/core"))


def compiled(*defines: str) -> subprocess.CompletedProcess[str]:
    flags = [f"-D{define}" for define in defines]
    source = str(ROOT / "tests/firmware/strict.cpp")
    command = ["g++", *FIRMWARE, *flags, "-fsyntax-only", source]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def image_by_command(mode: str, folder: Path, *defines: str) -> bytes:
    """Build an image for another rate with the command behind `make`, as a user does.

    `fltea flash` finds the id of the build in a file next to the image.
    """
    arm_compiler()
    file = folder / "fast.bin"
    command = [sys.executable, "-m", "tools.build_firmware", "--to", str(file), "--mode", mode]
    command += [word for define in defines for word in ("--define", define)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    committed = json.loads((ROOT / "firmware/due/image/fltea_due.json").read_text())
    assert json.loads(file.with_suffix(".json").read_text())["build_id"] == committed["build_id"]
    return file.read_bytes()


@pytest.mark.parametrize(
    ("rate_hz", "mode"), [slow(200, "timer"), long(500, "data_ready"), slow(1000, "data_ready")]
)
def test_a_rate_is_exact_and_without_gaps(rate_hz: int, mode: str, tmp_path: Path) -> None:
    image = (image_by_command if rate_hz == 200 else build)(mode, tmp_path, *SETTINGS[rate_hz])
    baud = 400_000 if rate_hz == 1000 else wire.BAUD
    run = DueRun(image, noise=f"rate_hz={rate_hz}&alpha=0.5&f=-1&seed=7", baud=baud).run_until(
        ENDS_S[rate_hz]
    )
    assert run.error is None
    samples = [arrival.frame for arrival in run.of(wire.Sample)]
    bursts = run.boots[-1].bursts
    assert len(bursts) - 2 <= len(samples) <= len(bursts)  # The last two samples may not have arrived yet.
    assert [chip_bytes(s.message) for s in samples] == [bytes(b.data) for b in bursts[: len(samples)]]
    assert [s.sequence for s in samples] == list(range(len(samples)))
    assert {b.device_us - a.device_us for a, b in pairwise(samples)} == {1_000_000 // rate_hz}
    assert {s.message.flags for s in samples} == {0}, "late, retried or repeated"
    counts = run.stats.sample_counts
    assert (counts.delivered, counts.lost, counts.gaps) == (len(samples), 0, 0)
    assert (run.troubles, run.hellos[-1].rate_hz) == ([], rate_hz)
    if rate_hz == 200:
        hello = run.hellos[-1]
        assert (hello.gyro_dlpf_hz, hello.gyro_range_dps, hello.gyro_lsb_per_dps) == (92.0, 250.0, 131.0)

    if rate_hz != 500:
        return
    assert run.status.dropped_frames == run.status.overruns == 0
    numbers = [number for number in range(STARTUP, len(samples) - 3, EVERY) for _ in range(3)]
    assert len(numbers) >= 3 * 3
    assert [message.sample for message in run.messages(wire.Estimate)][: len(numbers)] == numbers
    assert {message.skipped for message in run.messages(wire.Estimator)} == {0}
    assert {message.fit_every for message in run.messages(wire.Estimator)} == {0}, (
        "it makes no fits, and says so"
    )


def test_what_the_line_cannot_take_does_not_compile() -> None:
    """Samples of 28 bytes at 1 kHz are 28,000 bytes a second, but 250,000 baud can carry only 25,000."""
    refused = compiled("FLTEA_RATE_HZ=1000", "FLTEA_ESTIMATE=false")
    assert "the line has to take all that is to be said" in refused.stderr
    assert refused.returncode != 0
    assert compiled(*SETTINGS[1000]).returncode == 0


@pytest.mark.parametrize(
    ("defines", "says"),
    [
        (("FLTEA_RATE_HZ=1000", "FLTEA_BAUD=400000"), "too fast for estimates"),
        (("FLTEA_RATE_HZ=300",), "must divide a second without a rest"),
        (("FLTEA_DLPF_HZ=100",), "kDlpfHz must be"),
        (("FLTEA_GYRO_RANGE_DPS=300",), "kGyroRangeDps must be"),
    ],
)
def test_a_setting_that_cannot_be_does_not_compile(defines: tuple[str, ...], says: str) -> None:
    assert says in compiled(*defines).stderr


@pytest.mark.slow
def test_the_small_ring_of_arduino_bears_500_hz(tmp_path: Path) -> None:
    """At 500 Hz no frame is lost, though the ring buffer of Arduino's serial port can contain only 127 bytes.

    The message ESTIMATOR has 113 bytes, and a sample of 28 bytes comes every 2 ms.
    """
    folder = ROOT / "tests/firmware/arduino_stub"
    make(folder, tmp_path, "SANITIZE=", "CXX=g++ -DFLTEA_RATE_HZ=500", tmp_path / "run-data_ready")
    done = subprocess.run([tmp_path / "run-data_ready", "4"], capture_output=True, check=True)
    frames = [found for found in FrameReader().feed_all(done.stdout) if isinstance(found, Frame)]
    samples = [frame for frame in frames if isinstance(frame.message, wire.Sample)]
    assert [s.sequence for s in samples] == list(range(len(samples)))
    assert {b.device_us - a.device_us for a, b in pairwise(samples)} == {2000}
    (status,) = [f.message for f in frames if isinstance(f.message, wire.Status)][-1:]
    assert (status.dropped_frames, status.overruns) == (0, 0)
    estimators = [f.message for f in frames if isinstance(f.message, wire.Estimator)]
    assert len(estimators) >= 4, "once a second"
    assert estimators[-1].skipped == 0
    assert len([f for f in frames if isinstance(f.message, wire.Estimate)]) > 3 * 25
    assert json.loads(done.stderr)["waited"] is False


@pytest.mark.parametrize(
    ("gyro_dps", "accel_g", "gyro_lsb", "accel_lsb"),
    [slow(250, 4, 131.0, 8192.0), long(500, 8, 65.5, 4096.0), long(1000, 16, 32.8, 2048.0)],
)
def test_other_ranges_are_set_told_and_true(
    gyro_dps: int, accel_g: int, gyro_lsb: float, accel_lsb: float, tmp_path: Path
) -> None:
    defines = (f"FLTEA_GYRO_RANGE_DPS={gyro_dps}", f"FLTEA_ACCEL_RANGE_G={accel_g}")
    noise = "alpha=0.5&f=-1&offset_dps=20&seed=7"
    run = DueRun(build("timer", tmp_path, *defines), noise=noise).run_until(0.5)
    assert run.check() is None
    assert run.troubles == []
    chip = run.board.socket.chip
    assert [chip.read_block(register, 1)[0] >> 3 for register in (0x1B, 0x1C)] == [
        {250: 0, 500: 1, 1000: 2}[gyro_dps],
        {4: 1, 8: 2, 16: 3}[accel_g],
    ]
    hello = run.hellos[-1]
    assert (hello.gyro_range_dps, hello.gyro_lsb_per_dps) == (gyro_dps, gyro_lsb)
    assert (hello.accel_range_g, hello.accel_lsb_per_g) == (accel_g, accel_lsb)
    # The sensor is at rest, with an offset of 20 deg/s and 1 g along z.
    assert len(run.samples) > 20
    assert np.mean([s.gyro_dps for s in run.samples], axis=0) == pytest.approx([20.0] * 3, abs=0.3)
    assert np.mean([s.accel_ms2 for s in run.samples], axis=0) == pytest.approx([0, 0, 9.80665], abs=0.3)
