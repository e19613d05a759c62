"""Measures the whole program: the cost of recordings from file to output, and of live devices.

The present program is measured, and that of another commit if one is named.

    make bench ARGS='--chain --against HEAD~3 --rows 300,ndjson'

A row of the result is one task. Every round measures each row with one program, and right after that with the
other program, on the same samples. So a busy machine slows both. Some rows measure programs other than fltea
that read such files. Live devices send white noise, or coloured noise, whose fits take longer. The engine
(the native code of the filters) is also measured alone. The column "times the engine" shows how many times
longer the whole program takes for as many samples.
"""

import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import psutil

from tools.bench.chain_rows import ROWS, SECONDS, Row, chosen
from tools.bench.chain_works import Figures, Files, engine_alone
from tools.bench.measured import in_turns
from tools.bench.programs import PRESENT, Program, at_commit
from tools.validation.tables import NONE, Table

ROUNDS = 3
MEMORY_S = 60.0
"""Shortest run of which the growth of memory is reported [s]."""
FAILED = (RuntimeError, OSError, psutil.Error, subprocess.SubprocessError)


class Column(NamedTuple):
    """How a table shows one of the measured figures in a column.

    `whole`: whether the worst run has to reach the goal, and not only the median of the runs. `ratio`:
    whether the table also shows this figure of one program divided by that of the other.
    """

    heading: str
    form: str
    ratio: bool = True
    whole: bool = False


OF_FILES = {
    "wall_s": Column("wall s", ".2f"),
    "cpu_s": Column("processor s", ".2f"),
    "times_engine": Column("times the engine", ".1f", ratio=False),
    "rss_mb": Column("peak MB", ".0f"),
}
OF_DEVICES = {
    "cpu_percent": Column("core %", ".1f"),
    "p50_ms": Column("p50 ms", ".2f"),
    "p99_ms": Column("p99 ms", ".2f"),
    "max_ms": Column("max ms", ".1f"),
    "times_engine": Column("times the engine", ".1f", ratio=False),
    "rss_mb": Column("MB", ".0f"),
    "lost_or_errors": Column("lost, errors", ".0f", ratio=False, whole=True),
    "feeder_percent": Column("feeder: core %", ".0f", ratio=False),
    "feeder_late_ms": Column("its p99 late ms", ".1f", ratio=False),
}
COLUMNS: Mapping[str, Mapping[str, Column]] = {
    **dict.fromkeys(("ten minutes", "hour", "day"), OF_FILES),
    "live": OF_DEVICES,
}
TITLES = {
    "ten minutes": "Ten minutes at 100 Hz, three axes",
    "hour": "One hour at 100 Hz, three axes",
    "day": "24 hours at 100 Hz, three axes",
    "live": "Live devices at 100 Hz on pseudo-terminals, NDJSON; from a frame's last byte to its line",
}


def measure(
    *, long: bool = False, rows: str = "", against: str | None = None, rounds: int | None = None
) -> dict[str, Any]:
    """Measure the rows with the present program and, if `against` is given, with that commit's program.

    `rows`: names separated by commas. `rounds`: number of rounds, by default 3, or 1 for long rows. In the
    result, `runs` has a list for each row and program, with the figures of each run. If a run failed, its
    only figure is `failed`, the reason.
    """
    picked = chosen([name for name in rows.split(",") if name], long=long)
    programs = [*([at_commit(against)] if against else []), PRESENT]
    load = [os.getloadavg()[0]]
    with tempfile.TemporaryDirectory() as name:
        files = {kind: Files(Path(name, kind), seconds) for kind, seconds in SECONDS.items()}
        engine_s = statistics.median(engine_alone(files["hour"])["cpu_s"] for _ in range(ROUNDS))
        runs: dict[str, dict[str, list[Figures]]] = {row.name: {} for row in picked}
        for long_ones, turns in ((False, rounds or ROUNDS), (True, rounds or 1)):
            works = {
                (row.name, program.name): partial(_measured, row, files[row.kind], program, engine_s)
                for row in picked
                if row.long == long_ones
                for program in (programs if row.of_fltea else [PRESENT])
            }
            for (of_row, of_program), found in in_turns(works, turns).items():
                runs[of_row][of_program] = found
    return {
        "programs": [one.name for one in programs],
        "engine_cpu_s": engine_s,
        "runs": runs,
        "load_average": [*load, os.getloadavg()[0]],
        "not_reached": not_reached(runs),
    }


def _measured(row: Row, files: Files, program: Program, engine_s: float) -> Figures:
    """Measure one row (a task) once for one program, and print the figures.

    If the program fails, the result is the reason, so that the other rows are still measured.
    """
    try:
        found = row.work(files, program)
    except FAILED as error:
        found = {"failed": " ".join(str(error).split())}
    columns = [(column.heading, column.form, found.get(key)) for key, column in COLUMNS[row.kind].items()]
    said = [f"{heading} {value:{form}}" for heading, form, value in columns if value is not None]
    print(f"bench: {row.name}, {program.name}: {', '.join(said)}", file=sys.stderr, flush=True)
    if "failed" in found:
        return found
    if row.kind == "live":
        share = found["devices"] * engine_s / SECONDS["hour"]
        return found | {"times_engine": found["cpu_percent"] / 100 / share}
    return found | {"times_engine": found["cpu_s"] / (engine_s * SECONDS[row.kind] / SECONDS["hour"])}


def spread(runs: Sequence[Figures], key: str) -> tuple[float, float, float] | None:
    """Return median, smallest and largest value of a figure; None if no run has the figure."""
    values = [run[key] for run in runs if run.get(key) is not None]
    return (statistics.median(values), min(values), max(values)) if values else None


def not_reached(runs: Mapping[str, Mapping[str, Sequence[Figures]]]) -> list[str]:
    """Return a text for each goal that the present program misses."""
    missed = []
    for row in (row for row in ROWS if row.name in runs and row.of_fltea):
        for key, goal in row.goals.items():
            column, found = COLUMNS[row.kind][key], spread(runs[row.name][PRESENT.name], key)
            value = found and found[2 if column.whole else 0]
            if value is None or value > goal:
                said = NONE if value is None else format(value, column.form)
                missed.append(f"{row.name}: {column.heading} {said}, goal {goal:g}")
    return missed


def text(found: dict[str, Any]) -> str:
    """Return the tables of results.

    Each task has one line for each program. If there are two programs, a line with the ratios of their
    figures follows. The last column has the goals.
    """
    lines = []
    for kind, title in TITLES.items():
        rows = [row for row in ROWS if row.kind == kind and row.name in found["runs"]]
        if rows:
            columns = [column.heading for column in COLUMNS[kind].values()]
            cells = [line for row in rows for line in _lines(row, found["programs"], found["runs"][row.name])]
            headings = ("", "", "program", *columns, "goal")
            lines.append(Table(f"{title}; medians (from, to) of runs in turns", headings, cells).markdown())
    lines += _memory(found["runs"])
    lines.append(f"The engine alone takes {found['engine_cpu_s']:.2f} s of processor time for an hour.")
    before, after = found["load_average"]
    lines.append(f"Load average of the machine: {before:.1f} before, {after:.1f} after.")
    missed = found["not_reached"]
    lines.append(
        "Not reached: " + "; ".join(missed) + "." if missed else "All goals measured here are reached."
    )
    return "\n".join(lines)


def _lines(row: Row, programs: Sequence[str], runs: Mapping[str, Sequence[Figures]]) -> list[list[str]]:
    columns = COLUMNS[row.kind]
    lines = []
    for program in (name for name in programs if name in runs):
        failed = [run["failed"] for run in runs[program] if "failed" in run]
        cells = [_cell(spread(runs[program], key), column.form) for key, column in columns.items()]
        goals = [f"{columns[key].heading} ≤ {goal:g}" for key, goal in row.goals.items()]
        last = [*goals] if program == PRESENT.name else []
        last += [f"{len(failed)} of {len(runs[program])} runs failed: {failed[0]}"] if failed else []
        lines.append(["", "", program, *cells, ", ".join(last)])
    lines[0][:2] = [row.name, row.title]
    if len(lines) > 1:
        before, after = (runs[name] for name in programs)
        ratios = [_ratio(before, after, key) if column.ratio else "" for key, column in columns.items()]
        lines.append(["", "", "ratio", *ratios, ""])
    return lines


def _cell(found: tuple[float, float, float] | None, form: str) -> str:
    if found is None:
        return NONE
    median, least, most = (format(value, form) for value in found)
    return median if least == most else f"{median} ({least}, {most})"


def _ratio(before: Sequence[Figures], after: Sequence[Figures], key: str) -> str:
    """Return the ratio of the medians, that of `after` divided by that of `before`."""
    old, new = spread(before, key), spread(after, key)
    return NONE if old is None or new is None or not old[0] else f"**{new[0] / old[0]:.2f}**"


def _memory(runs: Mapping[str, Mapping[str, Sequence[Figures]]]) -> list[str]:
    """Return lines on the growth of memory in long runs."""
    return [
        f"Memory of {row.name}, {program}, in MB, ten times in {run['seconds']:g} s: "
        f"{', '.join(map(str, run['memory_mb']))}."
        for row in ROWS
        for program, several in runs.get(row.name, {}).items()
        for run in several
        if run.get("seconds", 0) >= MEMORY_S
    ]
