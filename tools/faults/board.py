"""Causes every kind of fault of sensor, bus, wires and board. For each fault the emulated Due runs once.

Times are virtual, so a second report on the same firmware image is equal to the first.
"""

from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import NamedTuple

from fltea.wire import layout as wire

from tools.due_emulator.__main__ import IMAGE
from tools.due_emulator.image import read_image
from tools.due_run import DueRun
from tools.faults.case import Case
from tools.faults.expected import Expected, within
from tools.faults.outcome import LOST, Outcome
from tools.faults.stage import Stage

UNINTERRUPTED_S = 0.015


class Measured(NamedTuple):
    """Results of one run of the emulated board.

    `due`: number of sampling instants of all boots by the emulator's own clock, since the first read of the
    sensor. `delivered`, `lost`: the host's counts. `unheard`: sampling instants at the end of a boot whose
    samples did not arrive. They are not counted as lost, because a reset ended the boot and no later sample
    shows that they are missing. `recovery_s`: duration of the longest interruption at the host, from the last
    good sample before the interruption to the first good sample after it [virtual s]. `epochs`: reasons why
    the host began new epochs (runs of samples without a break). `status`: fields of the last boot's STATUS.
    `wrong`: text about a contradiction in the counts, or None.
    """

    due: int
    delivered: int
    lost: int
    unheard: int
    recovery_s: float
    epochs: list[str]
    faults: list[str]
    status: dict[str, int | str]
    bad_frames: int
    resets: list[str]
    wrong: str | None

    @property
    def outcome(self) -> Outcome:
        """These results as an `Outcome`, which the report shows as a row of its table."""
        counts = [f"{name} {n}" for name, n in self.status.items() if n and name != "reset_cause"]
        if self.resets:
            counts.insert(0, f"reset_cause {self.status['reset_cause']}")
        interrupted = self.recovery_s >= UNINTERRUPTED_S
        recovery = f"recovered in {self.recovery_s:.2f} s" if interrupted else "not interrupted"
        return Outcome(
            [*self.faults, *self.epochs],
            self.due,
            {
                "delivered": self.delivered,
                LOST: self.lost,
                "unheard when a boot ended": self.unheard,
            },
            more=f"{recovery}; STATUS: {', '.join(counts) or 'nothing'}",
            wrong=[self.wrong] if self.wrong else [],
        )


class DueExpected(NamedTuple):
    """The expected outcome of a fault on the emulated board.

    `lost`, `recovery_s`, `unheard`: smallest and largest permitted value of these fields of `Measured`.
    `epochs`: reasons why the host begins new epochs (runs of samples without a break), in order. `faults`:
    kinds of FAULT messages, in order. `i2c_errors`, `bus_recoveries`: fields of the last boot's STATUS.
    `resets`: causes of the resets. `bad_frames`: number of frames that the host refused. `lost_on_the_way`:
    whether samples are lost on the wire, so that the board cannot count them.
    """

    lost: tuple[int, int]
    recovery_s: tuple[float, float]
    epochs: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    i2c_errors: range = range(1)
    bus_recoveries: int = 0
    unheard: tuple[int, int] = (0, 0)
    resets: tuple[str, ...] = ()
    bad_frames: range = range(1)
    lost_on_the_way: bool = False

    @property
    def of_outcome(self) -> Expected:
        """What is expected of a run's `Outcome`: its faults, epochs and losses."""
        return Expected((*self.faults, *self.epochs), lost=self.lost, excused=self.unheard)

    def differences(self, one: Measured) -> list[str]:
        """Return a sentence for each difference between a run and what is expected."""
        status = one.status
        checks = {
            "recovery_s": within(one.recovery_s, self.recovery_s),
            "bad_frames": one.bad_frames in self.bad_frames,
            "resets": one.resets == list(self.resets),
            "reset_cause": status["reset_cause"] == (self.resets or ("power_up",))[-1],
            "i2c_errors": status["i2c_errors"] in self.i2c_errors,
            "bus_recoveries": status["bus_recoveries"] == self.bus_recoveries,
            "sensor_reinits": status["sensor_reinits"] == one.epochs.count("sensor_restart"),
            "dropped_frames": status["dropped_frames"] == 0,
            # The device has to count each sample that the host lacks as an overrun. It cannot know of samples
            # that are lost on the wire, so it counts none of these.
            "overruns": status["overruns"] == (0 if self.lost_on_the_way else one.lost),
        }
        wrong = [f"{name} is not as expected: {one}" for name, is_right in checks.items() if not is_right]
        return [*self.of_outcome.differences(one.outcome), *wrong]


class DueCase(NamedTuple):
    """A fault of sensor, bus, wires or board.

    `faults`: texts of the faults, as on the emulator's command line. `until_s`: length of the run [s of
    virtual time].
    """

    name: str
    faults: tuple[str, ...]
    until_s: float
    expected: DueExpected


UNINTERRUPTED = (0.0099, 0.0151)
RESTART = ("sensor_restart",)
# The firmware tries to set up the sensor every 0.1 s, and a set-up takes 0.15 s. An interruption may
# therefore be longer than the fault by at most the sum of these two times.
DUE_CASES = (
    DueCase(
        "SDA held, 5 clocks free it",
        ("sda_stuck at=1 clocks=5",),
        2.2,
        DueExpected((0, 0), UNINTERRUPTED, (), (), range(1, 2), 1),
    ),
    DueCase(
        "SDA held for 1.2 s",
        ("sda_stuck at=1 for=1.2",),
        4.2,
        DueExpected((135, 148), (1.35, 1.49), RESTART, ("bus_held", "sensor_lost"), range(4, 30)),
    ),
    DueCase(
        "SCL held for 1.2 s",
        ("scl_stuck at=1 for=1.2",),
        4.2,
        DueExpected((135, 148), (1.35, 1.49), RESTART, ("bus_held", "sensor_lost"), range(4, 30)),
    ),
    DueCase(
        "one NACK", ("nack_burst at=1 count=1",), 2.2, DueExpected((0, 0), UNINTERRUPTED, (), (), range(1, 2))
    ),
    DueCase(
        "NACKs for 0.1 s",
        ("nack_burst at=1 for=0.1",),
        3.2,
        DueExpected((25, 38), (0.25, 0.39), RESTART, ("sensor_lost",), range(8, 13)),
    ),
    DueCase(
        "stale bytes in the controller", ("stale_byte at=1 count=5",), 2.2, DueExpected((0, 0), UNINTERRUPTED)
    ),
    DueCase(
        "sensor unplugged for 1.5 s",
        ("unplug at=1 for=1.5",),
        4.2,
        DueExpected((165, 179), (1.65, 1.8), RESTART, ("sensor_lost", "sensor_missing"), range(10, 50)),
    ),
    DueCase(
        "exchanged for an MPU-6500",
        ("clone at=1 who_am_i=0x70",),
        3.2,
        DueExpected((15, 25), (0.16, 0.25), RESTART, ("readback_mismatch",), range(3)),
    ),
    DueCase(
        "exchanged for an unknown chip for 1 s",
        ("clone at=1 who_am_i=0x12", "clone at=2 who_am_i=0x71"),
        4.2,
        DueExpected((114, 131), (1.15, 1.32), RESTART, ("readback_mismatch", "sensor_unknown"), range(5)),
    ),
    DueCase(
        "sensor's supply sags",
        ("brown_out at=1",),
        3.2,
        DueExpected((15, 22), (0.16, 0.22), RESTART, ("readback_mismatch",)),
    ),
    DueCase(
        "board's supply sags in mid-frame",
        ("brown_out at=1.0055 part=board",),
        3.2,
        DueExpected(
            (0, 0), (0.15, 0.22), ("restart",), unheard=(1, 1), resets=("power_up",), bad_frames=range(1, 2)
        ),
    ),
    DueCase(
        "40 bytes lost on the UART",
        ("uart_loss at=1 count=40",),
        2.2,
        DueExpected((1, 2), (0.019, 0.031), bad_frames=range(1, 3), lost_on_the_way=True),
    ),
    DueCase(
        "2 % of bytes lost for 1 s",
        ("uart_loss at=1 probability=0.02 for=1",),
        3.2,
        DueExpected((20, 70), (0.019, 0.1), bad_frames=range(15, 70), lost_on_the_way=True),
    ),
    DueCase(
        "host does not read for 10 s",
        ("host_stops_reading at=1 for=10",),
        12.2,
        DueExpected((995, 1005), (9.9, 10.1), ("gap",), bad_frames=range(3), lost_on_the_way=True),
    ),
    DueCase(
        "sensor's clock 1 % fast", ("sensor_clock at=1 percent=1",), 2.2, DueExpected((0, 0), UNINTERRUPTED)
    ),
    DueCase(
        "program hangs for 0.5 s",
        ("watchdog_starvation at=1 for=0.5",),
        2.7,
        DueExpected((48, 51), (0.49, 0.52)),
    ),
    DueCase(
        "program hangs for 2 s",
        ("watchdog_starvation at=1 for=2",),
        4.2,
        DueExpected((0, 0), (0.7, 1.3), ("restart",), unheard=(95, 105), resets=("watchdog",)),
    ),
    DueCase(
        "port opened again",
        ("port_reopen at=1.0071",),
        3.2,
        DueExpected((0, 0), (0.36, 0.42), ("restart",), resets=("user",), bad_frames=range(2)),
    ),
)


def measure(image: bytes, case: DueCase) -> tuple[DueRun, Measured]:
    """Run the emulated board with the faults of a `DueCase`; return the run and its results."""
    run = DueRun(image, faults=case.faults).run_until(case.until_s)
    arrivals = [sample.at_ps for sample in run.of(wire.Sample)]
    samples = run.stats.sample_counts
    status = run.status._asdict()
    # Only the counts of STATUS are compared: `cpu_share` is a share, and `longest_step` a duration.
    del status["cpu_share"], status["longest_step"]
    status["reset_cause"] = wire.ResetCause(run.status.reset_cause).name.lower()
    return run, Measured(
        due=sum(boot.due for boot in run.boots),
        delivered=samples.delivered,
        lost=samples.lost,
        unheard=sum(run.unheard()),
        recovery_s=round(max(b - a for a, b in pairwise(arrivals)) / 1e12, 3),
        epochs=run.epochs[1:],
        faults=list(dict.fromkeys(name for name, _ in run.faults)),
        status=status,
        bad_frames=sum(run.stats.link.bad_frames.values()),
        resets=[boot.cause.name.lower() for boot in run.boots[1:]],
        wrong=run.check(),
    )


def _play(case: DueCase, stage: Stage) -> Outcome:
    measured = measure(read_image(stage.image or IMAGE).content, case)[1]
    outcome = measured.outcome
    return replace(outcome, wrong=[*outcome.wrong, *case.expected.differences(measured)])


CASES = tuple(Case(case.name, partial(_play, case), case.expected.of_outcome) for case in DUE_CASES)
