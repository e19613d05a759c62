"""The chain and its engine: what a recording costs from file to output, and what live devices cost.

Every round measures all rows in turns on the same samples, and the engine alone on them too
(`chain_over_engine`, by processor time). Peers are what else reads such files. Live devices send white noise,
or coloured noise, which is fitted at greater length.
"""

import itertools
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from fltea.estimator.engine import Engine
from fltea.estimator.lane_settings import LaneSettings
from fltea.settings.estimator import EstimatorConfig
from numpy.typing import NDArray

from tools.bench import bench_daemon, day_files
from tools.bench.bench_daemon import Setting
from tools.bench.feeder import RATE_HZ, relaxation
from tools.bench.measured import in_turns
from tools.validation.tables import Table, number

ROUNDS = 3
AT_ONCE = 8192
GOALS = {
    "replay of one hour, --format none": ("wall_s", 1.2),
    "the same with coloured axes": ("wall_s", 1.5),
    "replay of one hour, NDJSON to a file": ("wall_s", 4.0),
    "the same from MCAP, --format none": ("wall_s", 2.0),
    "that CSV, read and checked alone": ("cpu_s", 0.7),
    "the program's start alone, run --help": ("wall_s", 0.2),
    "24 h from npz, --format none": ("wall_s", 40.0),
    "24 h from MCAP, --format none": ("wall_s", 40.0),
    "24 h, identify": ("wall_s", 60.0),
}
MOST_RSS_MB = 300.0
DEVICES, LATENCIES_MS, SECONDS = (1, 10, 100, 300), (0, 20), 10.0
OLD_DEVICES, OLD_S = (1, 10), 120.0
"""A young record has a search a second; one of this age shows what a device takes from then on."""
LIVE_GOALS = {1: {"p99_ms": 2.0, "max_ms": 5.0}, 10: {"p99_ms": 5.0}, 300: {"p99_ms": 100.0}}
"""Of latency 0, by the number of devices."""
CPU_GOALS = {1: 3.0, 10: 15.0, 300: 160.0}
"""Percent of a core at the usual latency."""


class Cost(NamedTuple):
    """Of one run. rss_mb: of the largest of its processes, at its peak."""

    wall_s: float
    cpu_s: float
    rss_mb: float


def measure(*, long: bool = False) -> dict[str, Any]:
    """All rows; `long` adds 24 hours."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        found: dict[str, Any] = {"hour": _hour(folder)}
        if long:
            found["day"] = _day(folder)
    settings = [Setting(*one) for one in itertools.product(DEVICES, [SECONDS], (False, True), LATENCIES_MS)]
    settings += [Setting(n, SECONDS, False, LATENCIES_MS[-1], OLD_S) for n in OLD_DEVICES]
    found["live"] = [bench_daemon.run_once(one) for one in settings]
    engine_ms = found["hour"]["engine alone"]["cpu_s"] / (3600 * RATE_HZ) * 1e3
    for run in found["live"]:
        run["chain_over_engine"] = run["cpu_percent"] / (run["devices"] * engine_ms * RATE_HZ * 0.1)
    return found | {"not_reached": not_reached(found)}


def not_reached(found: dict[str, Any]) -> list[str]:
    """Goals that these figures miss."""
    missed = []
    rows = found["hour"] | found.get("day", {})
    for row, (key, goal) in GOALS.items():
        if row in rows and rows[row][key] > goal:
            missed.append(f"{row}: {rows[row][key]:.1f} s, goal {goal:g} s")
    for row, figures in found.get("day", {}).items():
        if figures.get("rss_mb", 0) > MOST_RSS_MB and not figures.get("peer"):
            missed.append(f"{row}: {figures['rss_mb']:.0f} MB at its peak, goal {MOST_RSS_MB:g} MB")
    for run in found["live"]:
        n, latency_ms = run["devices"], run["latency_ms"]
        noise, after_s = "coloured" if run["coloured"] else "white", run["settle_s"]
        what = f"{n} devices, {noise}, latency {latency_ms} ms, after {after_s:g} s"
        of_cpu = {"cpu_percent": CPU_GOALS[n]} if n in CPU_GOALS else {}
        goals = of_cpu if latency_ms else LIVE_GOALS.get(n, {})
        missed += [
            f"{what}: {key} {run[key]:.2f}, goal {goal:g}" for key, goal in goals.items() if run[key] > goal
        ]
        if not bench_daemon.is_whole(run):
            missed.append(f"{what}: not all arrived")
    return missed


def _hour(folder: Path) -> dict[str, Any]:
    gyro, npz, csv, mcap = _files(folder, 3600)
    day_files.write_csv(csv, gyro)
    coloured = folder / "coloured.npz"
    day_files.write_npz(coloured, gyro + np.rint(relaxation(1, len(gyro))).astype(np.int16))
    return _figures(
        {
            "engine alone": partial(_engine, gyro),
            "replay of one hour, --format none": partial(_replay, npz),
            "the same without the live fit": partial(_replay, npz, None, "--set", "live.on=false"),
            "the same with coloured axes": partial(_replay, coloured),
            "replay of one hour, NDJSON to a file": partial(_replay, npz, folder / "lines"),
            "the same from CSV, --format none": partial(_replay, csv),
            "that CSV, read and checked alone": partial(_python, _TEXT, csv),
            "the same from MCAP, --format none": partial(_replay, mcap),
            "peer: pandas.read_csv of that CSV": partial(_python, _CSV_PEER, csv),
            "peer: mcap's reader over that MCAP": partial(_python, _MCAP_PEER, mcap),
            "peer: numpy.load of that npz": partial(_python, _NPZ_PEER, npz),
            "the program's start alone, run --help": partial(run_fltea, ["run", "--help"]),
        },
        ROUNDS,
    )


def _day(folder: Path) -> dict[str, Any]:
    """Each once: they take minutes."""
    gyro, npz, csv, mcap = _files(folder, 24 * 3600)
    return _figures(
        {
            "engine alone": partial(_engine, gyro),
            "24 h from npz, --format none": partial(_replay, npz),
            "24 h from MCAP, --format none": partial(_replay, mcap),
            "24 h, export of MCAP to npz": partial(run_fltea, ["export", mcap, "--to", folder / "out.npz"]),
            "24 h, export of MCAP to CSV": partial(run_fltea, ["export", mcap, "--to", csv]),
            "24 h from that CSV, --format none": partial(_replay, csv),
            "peer: pandas.read_csv of that CSV, 24 h": partial(_python, _CSV_PEER, csv),
            "peer: mcap's reader over 24 h": partial(_python, _MCAP_PEER, mcap),
            "24 h, identify": partial(run_fltea, ["identify", npz, "--json"]),
        },
        1,
    )


def _files(folder: Path, seconds: int) -> tuple[NDArray[np.int16], Path, Path, Path]:
    """Return counts, the recordings of them as .npz and MCAP, and between these where CSV is to be."""
    gyro = day_files.counts(seconds * RATE_HZ)
    npz, csv, mcap = (folder / f"{seconds}{suffix}" for suffix in (".npz", ".csv", "_mcap"))
    day_files.write_npz(npz, gyro)
    day_files.write_mcap(mcap, gyro)
    return gyro, npz, csv, mcap


_TEXT = """
import sys
from pathlib import Path
from fltea.recording.csv_file import open_csv
from fltea.settings.how import How
open_csv(Path(sys.argv[1]), How(rate_hz=100.0))
"""
_CSV_PEER = "import pandas, sys; pandas.read_csv(sys.argv[1])"
_NPZ_PEER = "import numpy, sys; numpy.load(sys.argv[1])['gyro_raw']"
_MCAP_PEER = """
import sys
from pathlib import Path
from mcap.reader import make_reader
for path in sorted(Path(sys.argv[1]).glob("*.mcap")):
    with path.open("rb") as file:
        for _ in make_reader(file).iter_messages():
            pass
"""


def _replay(path: Path, lines: Path | None = None, *more: str) -> Cost:
    output = "none" if lines is None else "ndjson"
    return run_fltea(["run", "-s", f"replay:{path}", "--once", "--format", output, *more], lines)


def _engine(gyro: Any) -> Cost:
    """The engine on the same samples, in blocks."""
    y = np.asarray(gyro[200:], dtype=np.float64) / day_files.LSB_PER_DPS
    engine = Engine(3, LaneSettings(EstimatorConfig(), 1 / RATE_HZ, y[:1000].var(axis=0)))
    begin_s, begin_cpu_s = time.monotonic(), time.process_time()
    for begin in range(0, len(y), AT_ONCE):
        engine.run(y[begin : begin + AT_ONCE])
    return Cost(time.monotonic() - begin_s, time.process_time() - begin_cpu_s, 0.0)


def run_fltea(arguments: Sequence[Any], out: Path | None = None) -> Cost:
    """What the command `fltea` costs with these arguments; its output goes to `out`."""
    return _run([sys.executable, "-m", "fltea", *map(str, arguments)], out)


def _python(code: str, file: Path) -> Cost:
    return _run([sys.executable, "-c", code, str(file)], None)


_MEASURE = """
import contextlib, ctypes, json, os, subprocess, sys, time
ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)  # PR_SET_CHILD_SUBREAPER: its workers are waited for, too
begin_s = time.monotonic()
program = subprocess.Popen(sys.argv[1:])
cpu_s = rss_kb = code = 0
with contextlib.suppress(ChildProcessError):
    while True:
        pid, status, usage = os.wait4(-1, 0)
        if pid == program.pid:
            wall_s, code = time.monotonic() - begin_s, os.waitstatus_to_exitcode(status)
        cpu_s += usage.ru_utime + usage.ru_stime
        rss_kb = max(rss_kb, usage.ru_maxrss)
print(json.dumps([wall_s, cpu_s, rss_kb / 1024]), file=sys.stderr)
os._exit(code % 256)
"""
"""A process of its own, and a small one: a program has the peak of whoever has started it."""


def _run(command: list[str], out: Path | None) -> Cost:
    """Of a program with all its processes."""
    with open(out or os.devnull, "wb") as stream:
        measure = [sys.executable, "-c", _MEASURE, *command]
        done = subprocess.run(measure, stdout=stream, stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{command}: {done.stderr[-500:]}")
    return Cost(*json.loads(done.stderr.splitlines()[-1]))


def _figures(rows: dict[str, Callable[[], Cost]], rounds: int) -> dict[str, Any]:
    runs = in_turns(rows, rounds)
    engine_s = statistics.median(run.cpu_s for run in runs["engine alone"])
    return {
        name: {
            "wall_s": statistics.median(run.wall_s for run in found),
            "wall_s_min": min(run.wall_s for run in found),
            "wall_s_max": max(run.wall_s for run in found),
            "cpu_s": statistics.median(run.cpu_s for run in found),
            "rss_mb": max(run.rss_mb for run in found),
            "chain_over_engine": statistics.median(run.cpu_s for run in found) / engine_s,
            "peer": name.startswith("peer"),
        }
        for name, found in runs.items()
    }


def text(found: dict[str, Any]) -> str:
    """The figures as tables, goals beside them."""
    tables = []
    for title in ("hour", "day"):
        cells = [
            (
                name,
                f"{f['wall_s']:.2f} ({f['wall_s_min']:.2f}, {f['wall_s_max']:.2f})",
                f"{f['cpu_s']:.2f}",
                f"{f['chain_over_engine']:.1f}",
                number(f["rss_mb"] or None, ".0f"),
                f"≤ {GOALS[name][1]:g} s" if name in GOALS else "",
            )
            for name, f in found.get(title, {}).items()
        ]
        rounds = f"medians of {ROUNDS} rounds, in turns" if title == "hour" else "one round"
        headings = ("", "wall s (from, to)", "processor s", "times the engine", "peak MB", "goal")
        if cells:
            tables.append(Table(f"One {title} at 100 Hz, three axes; {rounds}", headings, cells))
    tables.append(bench_daemon.table(found["live"]))
    lines = [one.markdown() for one in tables]
    if "day" not in found:
        lines.append("Not measured here: 24 hours (--long).")
    missed = found["not_reached"]
    lines += ["Not reached: " + "; ".join(missed) + "." if missed else "All goals measured here are reached."]
    return "\n".join(lines)
