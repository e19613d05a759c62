"""Tests of the committed image of the firmware on the emulated Due, without faults and in virtual time.

The host's own modules read the bytes that the board sends.
"""

import hashlib
from functools import cache
from itertools import pairwise

import pytest
from fltea.sources.synthetic import NoiseGenerator, parse_noise
from fltea.wire import layout as wire

from tests.rig.due_support import NOISE, DueRun, build, image
from tests.rig.tiers import long, slow
from tools.due_emulator import mpu9250_registers as reg

PERIOD_US = 10_000


def steps_us(run: DueRun) -> list[int]:
    return [b.device_us - a.device_us for a, b in pairwise(run.samples)]


@cache
def quiet_for(seconds: int) -> DueRun:
    """Run the emulated Due until a little more than `seconds` after the first sample."""
    return DueRun(image(), noise=NOISE).run_until(seconds + 0.35)


@pytest.fixture(params=[6, long(30)], ids="{} s".format)
def quiet(request: pytest.FixtureRequest) -> DueRun:
    return quiet_for(request.param)


def test_so_many_seconds_give_as_many_samples_and_no_gap(quiet: DueRun) -> None:
    assert quiet.error is None
    first, seconds = quiet.samples[0].device_us, int(quiet.board.now_s)
    within = sum(s.device_us < first + seconds * 1_000_000 for s in quiet.samples)
    assert abs(within - 100 * seconds) <= 1
    stats = quiet.stats
    assert (stats.sample_counts.delivered, stats.sample_counts.lost) == (quiet.boots[0].due, 0)
    counts = stats.sample_counts
    assert (counts.gaps, counts.duplicates, counts.before_hello) == (0, 0, 0)
    assert stats.link.bad_frames == {}
    assert stats.link.unknown_type == stats.link.refused == 0
    assert quiet.unheard() == [0]
    assert quiet.epochs == ["start"]
    assert quiet.troubles == quiet.faults == []
    assert all(sample.flags == 0 for sample in quiet.samples)


def test_its_first_sample_comes_soon_after_power_up(quiet: DueRun) -> None:
    """The sensor's reset takes 100 ms and its start 50 ms. The set-up of its registers and at most one
    sampling period come in addition.
    """
    assert 0.15 < quiet.of(wire.Sample)[0].at_s < 0.2


def test_its_steps_and_its_rate(quiet: DueRun) -> None:
    run = quiet
    assert all(abs(step - PERIOD_US) <= 50 for step in steps_us(run))
    first, last = run.samples[0], run.samples[-1]
    rate_hz = (last.seq - first.seq) / (last.device_us - first.device_us) * 1e6
    assert rate_hz == pytest.approx(100.0, rel=1e-4)
    # The emulated device's clock is exact, so the sampling rate is the same by the device's clock as by the
    # emulator's time.
    arrivals = run.of(wire.Sample)
    true_hz = (last.seq - first.seq) / (arrivals[-1].at_s - arrivals[0].at_s)
    assert true_hz == pytest.approx(100.0, rel=1e-4)


def test_its_samples_arrive_before_the_next_is_due(quiet: DueRun) -> None:
    run = quiet
    sent = run.boots[0].bursts
    delays_s = [a.at_s - b.at_ps / 1e12 for a, b in zip(run.of(wire.Sample), sent, strict=True)]
    # A SAMPLE frame takes 1.1 ms on the wire. If another frame is still being sent before it, a HELLO takes
    # 3.2 ms, a STATUS 1.4 ms, and an ESTIMATE 3.9 ms.
    assert max(delays_s) < 0.008


def test_its_hellos_and_statuses_come_every_second(quiet: DueRun) -> None:
    run = quiet
    for kind in (wire.Hello, wire.Status):
        arrivals = run.of(kind)
        assert len(arrivals) - int(run.board.now_s) in range(3)
        # At boot there are two HELLOs: the first immediately, the second when the sensor delivers values.
        gaps_s = [b.at_s - a.at_s for a, b in pairwise(arrivals[2:])]
        assert all(0.98 < gap < 1.02 for gap in gaps_s)
        sequences = [arrival.frame.sequence for arrival in arrivals]
        assert sequences == list(range(len(arrivals)))
    assert all(a.frame.message[:6] == (0, 0, 0, 0, 0, 0) for a in run.of(wire.Status))
    hello = run.hellos[-1]
    assert (hello.sensor, hello.who_am_i, hello.sensor_starts) == ("MPU-9250", 0x71, 1)
    assert (hello.rate_hz, hello.gyro_range_dps, hello.gyro_lsb_per_dps) == (100.0, 2000.0, 16.4)
    assert (hello.accel_range_g, hello.accel_lsb_per_g, hello.gyro_dlpf_hz) == (2.0, 16384.0, 184.0)
    assert hello.sampling_mode == "timer"


def test_first_comes_00_then_hello_then_samples(quiet: DueRun) -> None:
    run = quiet
    assert run.wire[0] == 0
    kinds = [type(arrival.frame.message) for arrival in run.arrivals]
    assert kinds[0] is wire.Hello
    starts = [a.frame.message.sensor_starts for a in run.of(wire.Hello)]
    announced = next(n for n, k in enumerate(kinds) if k is wire.Hello and n)
    assert starts[:2] == [0, 1]
    assert announced < kinds.index(wire.Sample)


def test_its_values_are_the_quantised_noise_one_by_one(quiet: DueRun) -> None:
    """The sensor measures noise of known α and f. Each value arrives exactly once and unchanged."""
    run = quiet
    assert run.check_values() is None
    noise = NoiseGenerator(parse_noise(NOISE))
    for _ in range(round(run.boots[0].bursts[0].at_ps / 1e10)):
        noise.step()
    for arrival in run.of(wire.Sample):
        sample = arrival.frame.message
        assert (sample.gyro_x, sample.gyro_y, sample.gyro_z) == noise.step()
    assert all(s.temperature_c == pytest.approx(25.0, abs=0.01) for s in run.samples)
    means = [sum((s.accel_ms2 or ())[i] for s in run.samples) / len(run.samples) for i in range(3)]
    assert means == pytest.approx([0.0, 0.0, 9.80665], abs=0.01)


def test_the_identifier_is_the_chips_own(quiet: DueRun) -> None:
    """The board reports the chip's own identifier, which the emulator derives from the seed of the run."""
    assert quiet.hellos[0].device_id == hashlib.sha256(b"due 1").hexdigest()[:32]


def test_the_sensor_is_set_up_as_its_hello_says(quiet: DueRun) -> None:
    chip = quiet.board.socket.chip
    # The expected registers of the sensor: 1 kHz, filters of 184 Hz, ±2000 deg/s, ±2 g, awake, clocked by the
    # chip's PLL.
    assert chip.read_block(reg.SMPLRT_DIV, 5).hex() == "0001180001"
    assert chip.read_block(reg.PWR_MGMT_1, 1)[0] == 1


def test_it_sleeps_when_there_is_nothing_to_do_and_the_bus_is_at_400_khz(quiet: DueRun) -> None:
    assert quiet.board.machine.idle_ps / quiet.now_ps > 0.8
    assert 0.045 < quiet.board.twi.load_ps / quiet.now_ps < 0.07


def test_the_watchdog_is_fed_by_the_main_loop_and_not_by_an_interrupt(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The main loop feeds the watchdog, and no interrupt handler does.

    If an interrupt handler fed it, a main loop that hangs would go unnoticed.
    """
    run = DueRun(image())
    watchdog, fed_in = run.board.watchdog, []
    feed = watchdog.on_write

    def on_write(register: str, value: int) -> None:
        fed_in.append(run.board.cpu.active_exceptions)
        feed(register, value)

    monkeypatch.setattr(watchdog, "on_write", on_write)
    run.run_until(0.5)
    assert len(fed_in) > 10
    assert set(fed_in) == {0}


def test_the_watchdog_is_on_for_about_a_second_and_never_hungry(quiet: DueRun) -> None:
    board = quiet.board
    watchdog = board.watchdog
    assert not watchdog.field("MR", "WDDIS")
    assert watchdog.field("MR", "WDRSTEN")
    assert not watchdog.field("MR", "WDIDLEHLT")
    assert 0.5e12 < watchdog.period_ps <= 1.5e12
    assert board.events == []


@pytest.fixture(scope="module")
def by_edges(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return build("data_ready", tmp_path_factory.mktemp("data_ready"))


@pytest.mark.parametrize("percent", [slow(1), long(-1)])
def test_with_the_data_ready_pin_each_conversion_is_read_once(by_edges: bytes, percent: int) -> None:
    run = DueRun(by_edges, faults=[f"sensor_clock percent={percent}"])
    edges_ps: list[int] = []
    run.board.socket.int_wire.listen(lambda level: edges_ps.append(run.now_ps) if level else None)
    run.run_until(4)
    assert run.error is None
    assert run.hellos[-1].sampling_mode == "data_ready"
    arrivals = run.of(wire.Sample)
    stats = run.stats
    assert (stats.sample_counts.lost, stats.sample_counts.duplicates, run.faults) == (0, 0, [])
    assert all(sample.flags == 0 for sample in run.samples)
    assert run.check_values() is None
    # The board does not use the first edges of the INT pin. Each later edge has one sample, and the sample's
    # time is that of the edge.
    used_ps = edges_ps[-len(arrivals) :]
    assert all(edge < arrival.at_ps for edge, arrival in zip(used_ps, arrivals, strict=True))
    device_us = [arrival.frame.device_us for arrival in arrivals]
    true_us = [(edge - used_ps[0]) / 1e6 for edge in used_ps]
    assert [us - device_us[0] for us in device_us] == pytest.approx(true_us, abs=5)
    period_us = PERIOD_US / (1 + percent / 100)
    assert all(abs(step - period_us) <= 5 for step in steps_us(run))


def test_a_data_ready_wire_that_breaks_is_told_and_the_sensor_set_up_again(by_edges: bytes) -> None:
    run = DueRun(by_edges, faults=["unplug at=1 for=0.5"]).run_until(4)
    assert run.error is None
    assert "data_ready_missing" in [name for name, _ in run.faults]
    assert run.epochs == ["start", "sensor_restart"]
    assert run.stats.sample_counts.lost == run.status.overruns in range(50, 240)
    assert run.samples[-1].device_us > 3_900_000
