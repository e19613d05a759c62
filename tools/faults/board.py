"""Plays every kind of fault of sensor, bus, wires and board on the emulated Due, one run each.

Times are virtual, so two reports of one image are equal.
"""

from functools import partial
from itertools import pairwise
from typing import NamedTuple

from fltea.wire import layout as wire

from tools.due_emulator.__main__ import IMAGE
from tools.due_emulator.image import read_image
from tools.due_run import DueRun
from tools.faults.case import Case, Outcome
from tools.faults.stage import Stage

UNINTERRUPTED_S = 0.015


class DueCase(NamedTuple):
    """Faults as on the emulator's command line, and the length of the run [s of virtual time]."""

    name: str
    faults: tuple[str, ...]
    until_s: float


DUE_CASES = (
    DueCase("SDA held, 5 clocks free it", ("sda_stuck at=1 clocks=5",), 2.2),
    DueCase("SDA held for 1.2 s", ("sda_stuck at=1 for=1.2",), 4.2),
    DueCase("SCL held for 1.2 s", ("scl_stuck at=1 for=1.2",), 4.2),
    DueCase("one NACK", ("nack_burst at=1 count=1",), 2.2),
    DueCase("NACKs for 0.1 s", ("nack_burst at=1 for=0.1",), 3.2),
    DueCase("stale bytes in the controller", ("stale_byte at=1 count=5",), 2.2),
    DueCase("sensor unplugged for 1.5 s", ("unplug at=1 for=1.5",), 4.2),
    DueCase("exchanged for an MPU-6500", ("clone at=1 who_am_i=0x70",), 3.2),
    DueCase(
        "exchanged for an unknown chip for 1 s", ("clone at=1 who_am_i=0x12", "clone at=2 who_am_i=0x71"), 4.2
    ),
    DueCase("sensor's supply sags", ("brown_out at=1",), 3.2),
    DueCase("board's supply sags in mid-frame", ("brown_out at=1.0055 part=board",), 3.2),
    DueCase("40 bytes lost on the UART", ("uart_loss at=1 count=40",), 2.2),
    DueCase("2 % of bytes lost for 1 s", ("uart_loss at=1 probability=0.02 for=1",), 3.2),
    DueCase("host does not read for 10 s", ("host_stops_reading at=1 for=10",), 12.2),
    DueCase("sensor's clock 1 % fast", ("sensor_clock at=1 percent=1",), 2.2),
    DueCase("program hangs for 0.5 s", ("watchdog_starvation at=1 for=0.5",), 2.7),
    DueCase("program hangs for 2 s", ("watchdog_starvation at=1 for=2",), 4.2),
    DueCase("port opened again", ("port_reopen at=1.0071",), 3.2),
)


class Measured(NamedTuple):
    """Results of one run.

    `due`: number of sampling instants of all boots by the emulator's own clock, since the first read of the
    sensor. `delivered`, `lost`: the host's counts. `unheard`: instants at the end of a boot that a reset
    ended, so that no later sample could show that they were missing. `recovery_s`: longest interruption at
    the host, from the last good sample before to the first after [virtual s]. `epochs`: reasons of new
    epochs. `status`: of the last boot. `wrong`: what does not add up, or None.
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
        """The results in the form of the report."""
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
                "counted as lost": self.lost,
                "unheard when a boot ended": self.unheard,
            },
            more=f"{recovery}; STATUS: {', '.join(counts) or 'nothing'}",
            wrong=[self.wrong] if self.wrong else [],
        )


def measure(image: bytes, case: DueCase) -> tuple[DueRun, Measured]:
    """Run one case."""
    run = DueRun(image, faults=case.faults).run_until(case.until_s)
    arrivals = [sample.at_ps for sample in run.of(wire.Sample)]
    samples = run.stats.sample_counts
    status = run.status._asdict()
    del status["cpu_share"], status["longest_step"]  # these fields are not counts
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
    return measure(read_image(stage.image or IMAGE).content, case)[1].outcome


CASES = tuple(Case(case.name, partial(_play, case)) for case in DUE_CASES)
