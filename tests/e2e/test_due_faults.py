"""Tests of faults of sensor, wires, supply and host with the emulated Due.

The board recovers, reports what happened, and counts losses.

In every run, all samples also have to be accounted for (`Measured.wrong`). For each sampling instant by the
emulator's own clock, one of three things is true: its sample was delivered, the host counted its sample as
lost, or the instant came between the last sample and a reset. Every sample is byte for byte what the sensor
gave at the sample's time.
"""

from functools import cache

import pytest
from fltea.wire import layout as wire

from tests.rig.due_support import (
    DUE_CASES,
    NOISE,
    PERIOD_US,
    ROOT,
    DueRun,
    Measured,
    after_a_reading,
    image,
    with_fault,
)
from tests.rig.tiers import long_but, slow
from tools.faults.board import DueExpected
from tools.faults.case import cells, line

LONG_S = 10.0
"""Runs of this duration [virtual s] or longer are made only in the second tier of tests."""


@pytest.fixture(params=[slow(case.name) if case.until_s > LONG_S else case.name for case in DUE_CASES])
def case(request: pytest.FixtureRequest) -> tuple[DueExpected, DueRun, Measured]:
    expected = next(one.expected for one in DUE_CASES if one.name == request.param)
    return expected, *with_fault(request.param)


def test_it_recovers_and_everything_adds_up(case: tuple[DueExpected, DueRun, Measured]) -> None:
    expected, run, row = case
    assert row.wrong is None
    assert expected.differences(row) == []
    # At the end of the run, all is as before the fault: every sample is present, on time and without a flag.
    tail = run.samples[-20:]
    assert [s.seq for s in tail] == list(range(tail[0].seq, tail[0].seq + 20))
    assert {s.flags for s in tail} == {0}
    assert run.hellos[-1].sensor_starts == row.status["sensor_reinits"] + 1


def test_it_says_what_happened(case: tuple[DueExpected, DueRun, Measured]) -> None:
    expected, run, row = case
    assert (row.faults, row.epochs) == (list(expected.faults), list(expected.epochs))
    assert ("device_fault" in run.troubles) == bool(expected.faults)


def test_it_counts(case: tuple[DueExpected, DueRun, Measured]) -> None:
    _, run, row = case
    last_boot = run.boots[-1]
    sent = sum(len(burst.data) == 14 for burst in last_boot.bursts)
    discarded = row.faults.count("readback_mismatch")
    assert last_boot.due - row.status["overruns"] == sent - discarded


def test_resets_have_their_cause(case: tuple[DueExpected, DueRun, Measured]) -> None:
    expected, run, row = case
    assert row.resets == list(expected.resets)
    boots = [hello.boot_id for hello in run.hellos]
    assert len(set(boots)) == len(run.boots)


def test_every_kind_of_fault_has_a_case() -> None:
    from tools.due_emulator.faults import KINDS

    assert {fault.split()[0] for case in DUE_CASES for fault in case.faults} == set(KINDS)


def test_details_of_faults_say_which_line_and_which_chip() -> None:
    assert set(with_fault("SDA held for 1.2 s")[0].faults) >= {("bus_held", 1)}
    assert set(with_fault("SCL held for 1.2 s")[0].faults) >= {("bus_held", 2)}
    assert set(with_fault("sensor unplugged for 1.5 s")[0].faults) >= {("sensor_missing", 0x68)}
    assert set(with_fault("exchanged for an unknown chip for 1 s")[0].faults) >= {("sensor_unknown", 0x12)}
    # After a brown-out, all registers of the sensor have their defaults. The firmware reads back those that
    # determine scale and bandwidth. The first wrong one is CONFIG (0x1A): it reads 0 instead of 1.
    ((name, detail),) = with_fault("sensor's supply sags")[0].faults
    assert (name, detail) == ("readback_mismatch", 0x1A << 16 | 1 << 8 | 0)


def test_a_sensor_that_falls_asleep_is_noticed_and_set_up_again() -> None:
    """A sensor that falls asleep keeps the settings of its registers, except PWR_MGMT_1. The firmware notices
    that its values stop changing.
    """
    run = DueRun(image()).run_until(1.0)
    run.board.socket.chip.write_register(0x6B, 0x41)
    run.board.socket.settle()
    run.run_until(2.5)
    assert run.check() is None
    assert run.faults == [("sensor_frozen", 10)]
    assert run.epochs == ["start", "sensor_restart"]
    assert sum(bool(s.flags & wire.SampleFlags.REPEATED) for s in run.samples) == 8
    assert (run.status.sensor_reinits, run.status.overruns) == (1, run.stats.sample_counts.lost)


def test_a_retried_sample_says_so() -> None:
    flags = [s.flags for s in with_fault("one NACK")[0].samples if s.flags]
    assert flags == [wire.SampleFlags.RETRIED]
    flags = [s.flags for s in with_fault("SDA held, 5 clocks free it")[0].samples if s.flags]
    assert flags == [wire.SampleFlags.RETRIED | wire.SampleFlags.LATE]


def test_a_sample_that_waited_for_a_hanging_program_is_late() -> None:
    flags = [s.flags for s in with_fault("program hangs for 0.5 s")[0].samples if s.flags]
    assert flags == [wire.SampleFlags.LATE]


def test_a_bus_that_needs_nine_clocks_is_freed_without_a_loss() -> None:
    """SDA is held for ten rising edges of SCL: those of the nine clocks, and that of the STOP after them.

    A sensor that is interrupted within a byte never needs more than nine clocks.
    """
    run = DueRun(image(), faults=["sda_stuck at=1 clocks=10"]).run_until(2.3)
    assert (run.check(), run.gaps, run.status.bus_recoveries) == (None, [], 1)


def test_a_tick_during_a_step_that_hangs_is_not_slept_through() -> None:
    """The program hangs in the middle of a step of its main loop, until after the next sampling instant (tick
    of the timer). It then takes that sample at once, and does not sleep until the following tick.
    """
    run = after_a_reading(DueRun(image()).run_until(1.4))
    held = len(run.samples)
    run.board.starve(0.0102)
    run.run_until(1.6)
    assert (run.check(), run.gaps) == (None, [])
    tick_us = run.samples[0].device_us % PERIOD_US
    late_us = [(s.device_us - tick_us) % PERIOD_US for s in run.samples[held : held + 3]]
    assert 100 < max(late_us) < 1_000, "it was held over a tick, and then did not wait for the next"


SETTINGS = {0x19: 0, 0x1A: 1, 0x1B: 0x18, 0x1C: 0, 0x1D: 1, 0x37: 0, 0x38: 0, 0x6B: 1, 0x6C: 0}
"""Values of the sensor's registers after its set-up. Register PWR_MGMT_2 is 0, as after a reset."""


@pytest.mark.parametrize("number", range(1 + 8))
def test_a_set_up_of_which_a_write_was_refused_sets_what_it_has_to(
    number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One write to the sensor is refused.

    The refused byte stays in the controller, and without a recovery the next write would send it first.
    """
    run = DueRun(image(), noise=NOISE)
    socket = run.board.socket
    writes: list[int] = []
    start = socket.start

    def refuse_one(address: int, read: bool) -> bool:
        if not run.board.twi.field("MMR", "MREAD"):
            socket.nacks_left = int(len(writes) == number)
            writes.append(address)
        return start(address, read)

    monkeypatch.setattr(socket, "start", refuse_one)
    run.run_until(0.5)
    assert run.check() is None
    assert (len(writes), run.faults) == (10, [])
    assert {register: socket.chip._registers[register] for register in SETTINGS} == SETTINGS
    rates = [s.gyro_dps for s in run.samples]
    assert [len({rate[axis] for rate in rates}) > 5 for axis in range(3)] == [True] * 3


def test_faults_have_their_own_sequence_and_do_not_flood_the_line() -> None:
    arrivals = with_fault("sensor unplugged for 1.5 s")[0].of(wire.Fault)
    assert [arrival.frame.sequence for arrival in arrivals] == list(range(len(arrivals)))
    assert 2 <= len(arrivals) < 12


def test_a_relative_is_named_and_used_and_an_unknown_chip_is_refused() -> None:
    run, _ = with_fault("exchanged for an MPU-6500")
    assert run.hellos[-1].who_am_i == 0x70
    assert "sensor_relative" in run.troubles
    run, _ = with_fault("exchanged for an unknown chip for 1 s")
    assert "sensor_unknown" in run.troubles


def test_the_bus_is_freed_by_as_many_clocks_as_it_needs() -> None:
    """Five clocks free the bus. Each recovery has one more rising edge of SCL, for the STOP, and one recovery
    happens at boot, so there are seven edges.
    """
    assert with_fault("SDA held, 5 clocks free it")[0].board.lines.recovery_clocks == 5 + 2


@pytest.mark.slow
def test_a_board_that_sags_in_mid_transfer_frees_the_bus() -> None:
    """The supply of the board fails at any bit of a byte, so the sensor may be left holding SDA low."""
    quiet = DueRun(image()).run_until(0.6)
    began_ps = next(burst.at_ps for burst in quiet.boots[0].bursts if burst.at_ps > 5 * 10**11)
    clocks = []
    for us in range(60, 360, 40):
        at_s = began_ps / 1e12 + us * 1e-6
        run = DueRun(image(), faults=[f"brown_out at={at_s:.6f} part=board"]).run_until(0.9)
        assert run.check() is None
        assert run.unheard() == [1, 0]
        assert run.faults == []
        clocks.append(run.board.lines.recovery_clocks - 2)
    assert max(clocks) > 0


def test_the_readme_shows_the_figures_of_the_committed_image(
    case: tuple[DueExpected, DueRun, Measured],
) -> None:
    """The figures of faults in the README are compared with those of the runs of the other tests in this
    file.
    """
    readme = (ROOT / "firmware/README.md").read_text(encoding="utf-8")
    (name,) = (one.name for one in DUE_CASES if one.expected is case[0])
    row = line(cells(name, case[2].outcome))
    assert row in readme, "make it true again by `make faults ARGS=board`"


BIT_S = 2.5e-6
BYTES = 14
# Moments within a read of the sensor, in bits since its START: address, register, repeated START, address,
# each byte, STOP.
PHASES = {
    "address": 5.0,
    "register": 14.0,
    "repeated start": 19.4,
    "address to read": 24.0,
    **{f"byte {i}": 29.0 + 9 * i + 4 for i in range(BYTES)},
    "acknowledge": 29.0 + 8.4,
    "last acknowledge": 29.0 + 9 * BYTES - 0.6,
    "stop": 29.0 + 9 * BYTES + 0.4,
}
STUCK = {
    # The sensor releases SDA after nine clocks, the most that a sensor in the middle of a byte needs.
    "SDA": "sda_stuck at={at:.7f} clocks=9",
    "SCL": "scl_stuck at={at:.7f} for=0.004",
}


@cache
def start_s() -> float:
    """Return the time at which the transfer of a sample begins, in a run without faults [s]."""
    run = DueRun(image(), noise=NOISE).run_until(0.3)
    return next(burst.at_ps * 1e-12 for burst in run.boots[0].bursts if burst.at_ps > 0.25e12)


@pytest.mark.slow
@pytest.mark.parametrize("held", STUCK)
@pytest.mark.parametrize("phase", long_but(list(PHASES)[::3], PHASES))
def test_a_line_that_gets_stuck_costs_two_samples_at_most(phase: str, held: str) -> None:
    fault = STUCK[held].format(at=start_s() + PHASES[phase] * BIT_S)
    run = DueRun(image(), noise=NOISE, faults=[fault]).run_until(0.65)
    assert run.check() is None
    assert len(run.boots) == 1
    assert run.epochs == ["start"], "the sensor was not set up again"
    assert run.stats.sample_counts.lost <= 2
    newest = run.samples[-1]
    assert newest.seq * 0.01 > 0.65 - start_s(), "it goes on"
    assert newest.flags == 0
    assert run.status.i2c_errors > 0
