"""Tests in which a Raspberry Pi and the Due read the same noise: the set-up of the sensor and the results are
equal.
"""

from functools import cache
from itertools import pairwise

import pytest
from fltea.records.records import Sample

from tests.rig.due_support import image
from tests.rig.fake_smbus import MS, Pi, S
from tests.rig.host_support import QUICK, Processes
from tools.due_emulator.noise import fractional_world
from tools.due_run import DueRun

NOISE = "alpha=0.5&f=-1&seed=7"
SECONDS = 4
SOURCE = "i2c:///dev/i2c-1?addr=0x68"


@cache
def through_the_due() -> DueRun:
    return DueRun(image(), noise=NOISE).run_until(SECONDS)


def gyro(samples: list[Sample]) -> list[tuple[float, ...]]:
    return [sample.gyro_dps for sample in samples]


@cache
def through_the_pi() -> Pi:
    """Run the program on the simulated Pi with the same noise as on the Due.

    The Pi is switched on at such a time that its first sample is the same value of the noise.
    """
    noise = fractional_world(NOISE)
    first = gyro(through_the_due().samples)[:20]
    seen = gyro(Pi(noise).run_until(1).of(Sample))
    if first[0] not in seen or seen[seen.index(first[0]) :][:20] != first:
        pytest.fail("the two paths did not meet the same noise within the first second")
    begin_ns = seen.index(first[0]) * 10 * MS
    pi = Pi(fractional_world(NOISE), start_ns=begin_ns, overrides={"samples": True})
    return pi.run_until(begin_ns / S + SECONDS)


@pytest.mark.slow
def test_the_same_noise_gives_the_same_samples() -> None:
    due, pi = gyro(through_the_due().samples), gyro(through_the_pi().of(Sample))
    n = min(len(due), len(pi))
    assert n > (SECONDS - 1) * 100
    assert due[:n] == pi[:n]
    assert len(set(due)) > n // 3


def test_both_paths_state_the_same_scales() -> None:
    due, pi = through_the_due().hellos[-1], through_the_pi().hello
    for field in ("rate_hz", "who_am_i", "sensor", "gyro_range_dps", "gyro_lsb_per_dps", "accel_range_g",
                  "accel_lsb_per_g", "gyro_dlpf_hz"):  # fmt: skip
        assert getattr(due, field) == getattr(pi, field), field
    assert (due.sampling_mode, pi.sampling_mode) == ("timer", "fifo")


def test_both_paths_set_the_sensor_up_alike() -> None:
    fifo_mode = 0x40
    for register in (0x1A, 0x1B, 0x1C, 0x1D, 0x37, 0x6B):
        due = through_the_due().board.socket.chip.read_block(register, 1)[0]
        pi = through_the_pi().chip.read_block(register, 1)[0]
        assert due == pi & ~(fifo_mode if register == 0x1A else 0), f"register 0x{register:02X}"


def test_the_command(processes: Processes) -> None:
    """Run `fltea run` on a machine with a sensor on its bus.

    On a busy machine the program may be suspended for longer than the sensor's FIFO takes to fill. Then
    samples are lost, which is reported and counted.
    """
    launcher = ("-m", "tests.e2e.pi_launcher", NOISE)
    command = processes.daemon("--source", SOURCE, "--samples", *QUICK, program=launcher)
    command.wait_for(lambda: len(command.of("estimate")) >= 120, "estimates")
    said = command.end_well()
    hello = command.of("hello")[0]
    assert (hello["source"], hello["sampling_mode"]) == ("i2c:/dev/i2c-1?addr=0x68", "fifo")
    samples = command.of("sample")
    numbers = [s["seq"] for s in samples]
    assert numbers[0] == 0
    assert all(a < b for a, b in pairwise(numbers))
    assert all(a["host_ns"] < b["host_ns"] for a, b in pairwise(samples))
    assert command.of("estimate")[-1]["axes"]["gyro_z"]["fltea"]["valid"]
    stats = command.of("stats")[-1]
    assert stats["board"]["i2c_errors"] == 0
    counts = stats["sample_counts"]
    assert counts["delivered"] == len(samples)
    assert counts["delivered"] + counts["lost"] == numbers[-1] + 1
    # The board's status is up to a second old, so it may lack the newest overruns.
    assert stats["board"]["overruns"] <= counts["lost"]
    assert set(command.errors()) == ({"fifo_overflow"} if counts["lost"] else set())
    assert said.count("\n") == said.count("fltea: fifo_overflow: ") == len(command.errors())
