"""Plays every fault of every part on the real programs; reports errors and what became of each record.

     make faults                                 all parts, in build/faults.md: some minutes
     make faults ARGS='ingest cluster'           only these parts
     make faults ARGS='--only disk --only clock' only faults with one of these words in their names
     make faults ARGS='daemon --long'            faults of minutes, as in the tables of host/docs

Exit code 1: some records are not accounted for, or a fault did not have the expected outcome. If a fault
cannot be played on this machine, its row of the table says why, and all its counts are 0.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tools.faults import board, cluster, daemon_line, daemon_outputs, daemon_program, fleet, ingest
from tools.faults.case import NOT_PLAYED, Case, cells, line, play_all, report
from tools.faults.outcome import Outcome
from tools.faults.program import Skip


class Part(NamedTuple):
    """A part of the system with its faults. `at_once`: number of faults that are caused at the same time."""

    cases: tuple[Case, ...]
    at_once: int = 2


PARTS = {
    "board": Part(board.CASES, at_once=1),
    "daemon": Part((*daemon_line.CASES, *daemon_outputs.CASES, *daemon_program.CASES)),
    "fleet": Part(fleet.CASES),
    "ingest": Part(ingest.CASES),
    "cluster": Part(cluster.CASES, at_once=1),
}
OUT = Path("build/faults.md")


def main() -> int:
    """Run the command line and return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.faults",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"any of {', '.join(PARTS)}; default: all")
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="WORD",
        help="only faults with this word in their names",
    )
    parser.add_argument("--long", action="store_true", help="faults last minutes instead of seconds")
    parser.add_argument(
        "--image", type=Path, help="raw binary for the Due, for `board` (default: the committed image)"
    )
    parser.add_argument("--out", type=Path, default=OUT, help=f"the report (default {OUT})")
    given = parser.parse_args()
    unknown = [part for part in given.parts if part not in PARTS]
    if unknown:
        parser.error(f"{unknown[0]}: there is no such part; the parts are {', '.join(PARTS)}")
    rows = []
    for row in played(given.parts or [*PARTS], given.only, short=not given.long, image=given.image):
        rows.append(row)
        print(line((row[0], *cells(*row[1:]))), file=sys.stderr, flush=True)
    if not rows:
        parser.error(f"no fault of {', '.join(given.parts or PARTS)} has such a name")
    text = report(rows)
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(text, encoding="utf-8")
    print(f"{given.out}: {text.splitlines()[-1]}", file=sys.stderr)
    return 0 if all(one.is_right for _, _, one in rows) else 1


def played(
    parts: list[str], words: list[str], *, short: bool, image: Path | None
) -> Iterator[tuple[str, str, Outcome]]:
    """Yield the part, the name and the outcome of each fault whose name contains one of the words.

    If no words are given, all faults are caused.
    """
    for part in parts:
        cases = [one for one in PARTS[part].cases if not words or any(word in one.name for word in words)]
        playing = play_all(cases, at_once=PARTS[part].at_once, short=short, image=image)
        for case in cases:
            try:
                yield part, case.name, playing[case.name].result()
            # After `Skip`, go on with the other faults: they may not need the program or permission that is
            # missing on this machine.
            except Skip as why:
                yield part, case.name, Outcome([], 0, {}, more=f"{NOT_PLAYED}: {why}")


if __name__ == "__main__":
    sys.exit(main())
