"""What an image has to do on the emulated Due: a quiet run, and one with a fault of most kinds.

python -m tools.mutants.trial IMAGE      exit code 1 and the first statement that does not hold
"""

import hashlib
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from fltea.sources.synthetic import NoiseGenerator, parse_noise
from fltea.wire import layout as wire

from tools.due_emulator import mpu9250_registers as reg
from tools.due_emulator.instants import PERIOD_PS
from tools.due_run import DueRun

NOISE = "alpha=0.5&f=-1&seed=7"
FAULTS = (
    "nack_burst at=1.0 count=1",
    # Nine clocks, and that of the STOP.
    "sda_stuck at=1.2 clocks=10",
    # Each of three reads in a row leaves one in the controller.
    "stale_byte at=1.3 count=3",
    # From the middle of a step to after the next tick: its wake-up must not get lost.
    "watchdog_starvation at=1.4042 for=0.0102",
    "brown_out at=1.6",
    "scl_stuck at=2.5 for=0.2",
    "unplug at=4.2 for=0.3",
    # A write of the set-up after it: its byte stays in the controller.
    "nack_burst at=4.64445 count=1",
    "uart_loss at=5.9 count=20",
    "watchdog_starvation at=6.2 for=0.4",
    "watchdog_starvation at=7.2 for=2",
    "port_reopen at=9.0071",
    "brown_out at=10.0048 part=board",
)
END_S = 11.6
Statement = tuple[str, object]
"""What has to hold, and whether it does."""


def first_failure(image: bytes) -> str | None:
    """Return the first statement that does not hold; None if all do."""
    for run in (quiet, troubled):
        for statement, holds in run(image):
            if not holds:
                return statement
    return None


def quiet(image: bytes) -> Iterator[Statement]:
    """Undisturbed: samples, times, values, what is reported of them, loads."""
    run = _watched(DueRun(image, noise=NOISE))
    # At once, for an image that never sleeps is slow to emulate.
    run.run_until(0.03)
    yield from _runs(run)
    yield from _sleeps(run, 0.3)
    run.run_until(0.6)
    yield from _runs(run)
    yield f"there are samples ({len(run.samples)})", run.samples
    run.run_until(2.6)
    yield from _runs(run)
    yield f"nothing is damaged ({run.stats.link.bad_frames})", not run.stats.link.bad_frames
    yield f"no fault, no trouble, one epoch ({run.faults} {run.troubles})", not run.faults + run.troubles
    yield f"one boot ({run.board.events})", len(run.boots) == 1
    first = run.of(wire.Sample)[0]
    yield f"the first sample comes in time ({first.at_s:.3f} s)", 0.15 < first.at_s < 0.2
    yield "the first sample has number 0", first.frame.sequence == 0
    steps = {b.device_us - a.device_us for a, b in pairwise(run.samples)}
    yield f"steps are 10,000 ± 50 us ({sorted(steps)[:3]})", all(abs(step - 10_000) <= 50 for step in steps)
    arrivals = run.of(wire.Sample)
    true_hz = (len(arrivals) - 1) / (arrivals[-1].at_s - arrivals[0].at_s)
    yield f"100.00 Hz by the emulator's clock ({true_hz:.3f})", abs(true_hz / 100 - 1) < 1e-4
    yield "no sample is doubtful", not any(sample.flags for sample in run.samples)
    yield _sound(run)
    yield "values are the quantised noise", _is_noise(run)
    yield from _settings(run)
    yield from _rhythm(run)
    board = run.board
    yield from _sleeps(run, 0.85)
    yield "the watchdog counts on in sleep", not board.watchdog.field("MR", "WDIDLEHLT")
    bus = board.twi.load_ps / run.now_ps
    yield f"the bus is at 400 kHz (busy {bus:.3f})", 0.045 < bus < 0.065


def troubled(image: bytes) -> Iterator[Statement]:
    """One fault after the other; after each it recovers, and the sums are right."""
    run = _watched(DueRun(image, noise=NOISE, faults=FAULTS))
    run.run_until(1.55)
    yield from _runs(run)
    yield f"a NACK, a held SDA, stale bytes and a late tick cost no sample ({run.gaps})", not run.gaps
    flags = [
        (s.flags, round(s.device_us / 1e6, 1)) for s in run.samples if s.flags & wire.SampleFlags.RETRIED
    ]
    yield f"retried samples say so ({flags})", [at for _, at in flags] == [1.0, 1.2]
    late = [
        sample.device_us % 10_000 for sample in run.samples if sample.device_us // 1000 in range(1410, 1420)
    ]
    yield f"a tick during a step is not slept through ({late} us after it)", late and late[0] < 1_000
    run.run_until(6.85)
    yield from _runs(run)
    yield _sound(run)
    status = run.status
    yield f"I2C errors are counted ({status.i2c_errors})", status.i2c_errors in range(12, 20)
    yield f"one held bus was freed ({status.bus_recoveries})", status.bus_recoveries == 1
    yield f"the sensor was set up again three times ({status.sensor_reinits})", status.sensor_reinits == 3
    yield f"each time in a new epoch ({run.epochs})", run.epochs == ["start"] + 3 * ["sensor_restart"]
    starts = [hello.sensor_starts for hello in run.hellos]
    yield f"HELLO counts the starts of the sensor ({starts})", starts == [0, 1, 2, 3, 4]
    lost = run.stats.samples.lost
    yield (
        f"overruns are the losses but one on the wire ({status.overruns}, {lost})",
        status.overruns == lost - 1,
    )
    reported = {name for name, _ in run.faults}
    needed = {"readback_mismatch", "bus_held", "sensor_lost"}
    yield f"FAULTs name the faults ({reported})", needed <= reported <= needed | {"sensor_missing"}
    yield f"FAULTs do not flood the line ({len(run.faults)})", len(run.faults) < 12
    sequences = [arrival.frame.sequence for arrival in run.of(wire.Fault)]
    yield f"FAULTs have their own sequence ({sequences})", sequences == list(range(len(sequences)))
    after = [s.gyro_dps for s in run.samples if 4_800_000 < s.device_us < 5_800_000]
    still = [axis for axis in range(3) if len({rates[axis] for rates in after}) < 10]
    yield f"all axes are alive after a set-up with a refused byte ({still} are not)", not still
    hung = [sample.flags for sample in run.samples if 6_590_000 < sample.device_us < 6_620_000]
    yield f"a sample that had to wait is late ({hung})", wire.SampleFlags.LATE in hung
    run.run_until(END_S)
    yield from _runs(run)
    causes = [boot.cause.name.lower() for boot in run.boots]
    yield f"resets ({causes})", causes == ["power_up", "watchdog", "user", "power_up"]
    yield _sound(run)
    reset_causes = list(dict.fromkeys(status.reset_cause for status in run.messages(wire.Status)))
    yield f"STATUS gives their causes ({reset_causes})", reset_causes == [0, 2, 4]
    boots = {hello.boot_id for hello in run.messages(wire.Hello)}
    yield f"each boot has its own id ({len(boots)})", len(boots) == 4
    identifiers = {hello.device_id for hello in run.hellos}
    yield "and the same device", len(identifiers) == 1


def _watched(run: DueRun) -> DueRun:
    """End a run that feeds its watchdog from an interrupt handler, which hides a main loop that hangs."""
    board = run.board
    feed = board.watchdog.on_write

    def on_write(register: str, value: int) -> None:
        if register == "CR" and board.cpu._nvic.active:
            board.machine.fault("the watchdog is fed by an interrupt handler")
        feed(register, value)

    board.watchdog.on_write = on_write  # type: ignore[method-assign]
    return run


def _runs(run: DueRun) -> Iterator[Statement]:
    yield f"it runs ({run.error})", run.error is None


def _sleeps(run: DueRun, least: float) -> Iterator[Statement]:
    asleep = run.board.machine.idle_ps / run.now_ps
    yield f"it sleeps when there is nothing to do ({asleep:.2f})", asleep > least


def _sound(run: DueRun) -> Statement:
    wrong = run.check()
    return f"everything adds up ({wrong})", wrong is None


def _is_noise(run: DueRun) -> bool:
    noise = NoiseGenerator(parse_noise(NOISE))
    for _ in range(round(run.boots[0].bursts[0].at_ps / PERIOD_PS)):
        noise.step()
    return all((s.gyro_x, s.gyro_y, s.gyro_z) == noise.step() for s in run.messages(wire.Sample))


def _settings(run: DueRun) -> Iterator[Statement]:
    chip = run.board.socket.chip
    kept = chip.read_block(reg.SMPLRT_DIV, 5).hex()
    yield f"1 kHz, 184 Hz, ±2000 deg/s, ±2 g ({kept})", kept == "0001180001"
    power = chip.read_block(reg.PWR_MGMT_1, 1)[0]
    yield f"awake, by its PLL ({power:#x})", power == 1
    hello = run.hellos[-1]
    stated = (hello.rate_hz, hello.gyro_range_dps, hello.gyro_lsb_per_dps, hello.accel_lsb_per_g)
    yield f"HELLO states these ({stated})", stated == (100.0, 2000.0, 16.4, 16384.0)
    yield "and of the filter", hello.gyro_dlpf_hz == 184.0
    yield f"the sensor is an MPU-9250 ({hello.who_am_i:#x})", hello.who_am_i == 0x71
    uid = hashlib.sha256(f"due {run.board.seed}".encode()).hexdigest()[:32]
    yield f"the device's identifier is its chip's ({hello.device_id})", hello.device_id == uid


def _rhythm(run: DueRun) -> Iterator[Statement]:
    for kind in (wire.Hello, wire.Status):
        arrivals = run.of(kind)
        sequences = [arrival.frame.sequence for arrival in arrivals]
        yield f"{kind.__name__} has its own sequence ({sequences})", sequences == list(range(len(sequences)))
        yield f"{kind.__name__} comes every second", len(arrivals) in (2, 3, 4)
    yield f"STATUS is clean ({run.status})", run.status is not None and not any(run.status[:6])


if __name__ == "__main__":
    failure = first_failure(Path(sys.argv[1]).read_bytes())
    print(failure or "all statements hold")
    sys.exit(1 if failure else 0)
