"""Every fault of every part, played on the real programs: what was told, and where each record went.

    make faults                                 all parts, in build/faults.md: some minutes
    make faults ARGS='ingest cluster'           only these parts
    make faults ARGS='--only disk --only clock' only faults with one of these words in their names
    make faults ARGS=--json                     the rows as JSON on the standard output too

Exit code 1: something is not accounted for, or is wrong in another way. What cannot be played on this machine
says why: a row without records, or a part that is left out.
"""

import argparse
import json
import sys
from pathlib import Path

from tools.fault_script.stage import Skip
from tools.faults import board, cluster, daemon, fleet, ingest
from tools.faults.row import HEADS, Row, markdown

PARTS = {
    "board": board.rows,
    "daemon": daemon.rows,
    "fleet": fleet.rows,
    "ingest": ingest.rows,
    "cluster": cluster.rows,
}
OUT = Path("build/faults.md")


def report(rows: list[Row], left_out: list[str]) -> str:
    """The table, and what it comes to."""
    lines = [markdown(HEADS), "|---" * len(HEADS) + "|", *(markdown(row.cells) for row in rows)]
    wrong = [row for row in rows if not row.is_right]
    lines += ["", f"{len(rows)} faults; {len(wrong)} that are wrong or do not add up."]
    lines += [f"Left out: {text}" for text in left_out]
    return "\n".join(lines) + "\n"


def main() -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.faults",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; all if none is named"
    )
    parser.add_argument("--only", action="append", default=[], metavar="WORD", help="in the fault's name")
    parser.add_argument("--out", type=Path, default=OUT, help=f"the report (default {OUT})")
    parser.add_argument("--json", action="store_true", help="print the rows as JSON too")
    given = parser.parse_args()
    unknown = [part for part in given.parts if part not in PARTS]
    if unknown:
        parser.error(f"{unknown[0]}: no such part; there are {', '.join(PARTS)}")
    rows: list[Row] = []
    left_out: list[str] = []
    for part in given.parts or PARTS:
        try:
            for row in PARTS[part](given.only):
                rows.append(row)
                print(markdown(row.cells), file=sys.stderr, flush=True)
        except (Skip, ModuleNotFoundError) as why:
            left_out.append(f"{part}: {why}")
    if not rows:
        parser.error("nothing was played: " + ("; ".join(left_out) or "no fault has such a name"))
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(report(rows, left_out), encoding="utf-8")
    if given.json:
        print(json.dumps([row._asdict() | {"uncounted": row.uncounted} for row in rows], indent=2))
    print(f"{given.out}: {report(rows, left_out).splitlines()[len(rows) + 3]}", file=sys.stderr)
    return 0 if all(row.is_right for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
