"""Every kind of fault on the emulated Due, one run each: what was lost and counted, how soon it recovered.

    python -m tools.fault_report             a table in Markdown
    python -m tools.fault_report --json      the same as JSON
    python -m tools.fault_report unplug      only these cases

Times are virtual: two reports of one image are equal. Exit code 1: a run ended early, or its counts do not
add up.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from fltea.wire import layout as wire

from tools.due_emulator.__main__ import IMAGE
from tools.due_emulator.image import read_image
from tools.due_run import DueRun

SUM = "due = delivered + lost + unheard"


class Case(NamedTuple):
    """faults: as on the emulator's command line. until_s: length of the run [s of virtual time]."""

    name: str
    faults: tuple[str, ...]
    until_s: float


CASES = (
    Case("SDA held, 5 clocks free it", ("sda_stuck at=1 clocks=5",), 2.2),
    Case("SDA held for 1.2 s", ("sda_stuck at=1 for=1.2",), 4.2),
    Case("SCL held for 1.2 s", ("scl_stuck at=1 for=1.2",), 4.2),
    Case("one NACK", ("nack_burst at=1 count=1",), 2.2),
    Case("NACKs for 0.1 s", ("nack_burst at=1 for=0.1",), 3.2),
    Case("stale bytes in the controller", ("stale_byte at=1 count=5",), 2.2),
    Case("sensor unplugged for 1.5 s", ("unplug at=1 for=1.5",), 4.2),
    Case("exchanged for an MPU-6500", ("clone at=1 who_am_i=0x70",), 3.2),
    Case(
        "exchanged for an unknown chip for 1 s", ("clone at=1 who_am_i=0x12", "clone at=2 who_am_i=0x71"), 4.2
    ),
    Case("sensor's supply sags", ("brown_out at=1",), 3.2),
    Case("board's supply sags in mid-frame", ("brown_out at=1.0055 part=board",), 3.2),
    Case("40 bytes lost on the UART", ("uart_loss at=1 count=40",), 2.2),
    Case("2 % of bytes lost for 1 s", ("uart_loss at=1 probability=0.02 for=1",), 3.2),
    Case("host does not read for 10 s", ("host_stops_reading at=1 for=10",), 12.2),
    Case("sensor's clock 1 % fast", ("sensor_clock at=1 percent=1",), 2.2),
    Case("program hangs for 0.5 s", ("watchdog_starvation at=1 for=0.5",), 2.7),
    Case("program hangs for 2 s", ("watchdog_starvation at=1 for=2",), 4.2),
    Case("port opened again", ("port_reopen at=1.0071",), 3.2),
)


class Row(NamedTuple):
    """What one run gave.

    due: sampling instants by the emulator's own clock, from the first reading of the sensor on, of all boots.
    delivered, lost: as the host counts them. unheard: due at the end of a boot that a reset ended, so that no
    later sample could tell of them. recovery_s: from the last good sample before to the first after the
    longest interruption, at the host [virtual s]. epochs: reasons of new ones. status: of the last boot.
    wrong: None, or what does not add up.
    """

    name: str
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


def measure(image: bytes, case: Case) -> tuple[DueRun, Row]:
    """Run one case."""
    run = DueRun(image, faults=case.faults).run_until(case.until_s)
    arrivals = [sample.at_ps for sample in run.of(wire.Sample)]
    samples = run.stats.samples
    status = run.status._asdict()
    del status["cpu_share"], status["longest_step"]  # not counts
    status["reset_cause"] = wire.ResetCause(run.status.reset_cause).name.lower()
    row = Row(
        name=case.name,
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
    return run, row


def markdown(rows: list[Row]) -> Iterator[str]:
    """The table, line by line."""
    heads = "fault", "lost", "time to recover", "counted in STATUS", "FAULT", "new epoch", SUM
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    for r in rows:
        counted = ", ".join(f"{name} {n}" for name, n in r.status.items() if n and name != "reset_cause")
        if r.resets:
            counted = ", ".join(filter(None, (f"reset_cause {r.status['reset_cause']}", counted)))
        recovery = "not interrupted" if r.recovery_s < 0.015 else f"{r.recovery_s:.2f} s"
        cells = (
            r.name,
            str(r.lost + r.unheard),
            recovery,
            counted or "–",
            ", ".join(r.faults) or "–",
            ", ".join(r.epochs) or "–",
            r.wrong or f"{r.due} = {r.delivered} + {r.lost} + {r.unheard}",
        )
        yield f"| {' | '.join(cells)} |"


def main() -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.fault_report",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("only", nargs="*", help="words that a case's name or faults must hold")
    parser.add_argument("--image", type=Path, default=IMAGE, help="raw binary for the Due (default: ours)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args()
    image = read_image(options.image).content
    cases = [c for c in CASES if all(word in f"{c.name} {c.faults}" for word in options.only)]
    rows = [measure(image, case)[1] for case in cases]
    if options.json:
        print(json.dumps([row._asdict() for row in rows], indent=2))
    else:
        print("\n".join(markdown(rows)))
    return 1 if any(row.wrong for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
