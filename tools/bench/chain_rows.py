"""The rows of `make bench ARGS=--chain`: recordings of ten minutes, an hour and a day, and live devices."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from typing import NamedTuple

from tools.bench.bench_daemon import SETTLE_S, Setting
from tools.bench.chain_works import (
    Work,
    code,
    export,
    identify,
    identify_in_full,
    live,
    replay,
    start,
)

SECONDS = {"ten minutes": 600, "hour": 3600, "day": 24 * 3600, "live": 0}
"""Length of the recordings that the rows of each kind read [s]."""
LIVE_S = 10.0
OLD_S = 120.0
"""Age of a live record after which model searches have become rare [s]. From then on, the cost of a live
device stays constant.
"""


class Row(NamedTuple):
    """One row of the tables: a task that is measured.

    `kind`: the table in which the row stands. `goals`: largest permitted values of figures. `usual`: whether
    the row is measured if no rows are named. `of_fltea`: False for a row that measures another program for
    comparison. Such a row is measured once a round. `long`: whether the row takes minutes to measure. Such a
    row is measured only if its own name is given, or with --long.
    """

    name: str
    title: str
    kind: str
    work: Work
    goals: Mapping[str, float] = {}
    usual: bool = False
    of_fltea: bool = True
    long: bool = False


READ_CSV = """
import sys
from pathlib import Path
from fltea.recording.csv_file import open_csv
from fltea.settings.how import How
open_csv(Path(sys.argv[1]), How(rate_hz=100.0))
"""
PANDAS = "import pandas, sys; pandas.read_csv(sys.argv[1])"
NUMPY = "import numpy, sys; numpy.load(sys.argv[1])['gyro_raw']"
MCAP = """
import sys
from pathlib import Path
from mcap.reader import make_reader
for path in sorted(Path(sys.argv[1]).glob("*.mcap")):
    with path.open("rb") as file:
        for _ in make_reader(file).iter_messages():
            pass
"""


def _hour() -> Iterator[Row]:
    without_fit, ndjson = ("--set", "live.on=false"), partial(replay, "npz", output="ndjson")
    yield Row(
        "none", "replay of one hour, --format none", "hour", partial(replay, "npz"), {"wall_s": 0.8}, True
    )
    yield Row("ndjson", "the same, NDJSON to a file", "hour", ndjson, {"wall_s": 2.0}, True)
    yield Row(
        "mcap", "the same from MCAP, --format none", "hour", partial(replay, "mcap"), {"wall_s": 1.0}, True
    )
    yield Row("no-fit", "the same without the live fit", "hour", partial(replay, "npz", more=without_fit))
    yield Row("coloured", "the same with coloured axes", "hour", partial(replay, "coloured"), {"wall_s": 1.5})
    yield Row("csv", "the same from CSV, --format none", "hour", partial(replay, "csv"))
    yield Row(
        "csv-read", "that CSV, read and checked alone", "hour", partial(code, READ_CSV, "csv"), {"cpu_s": 0.7}
    )
    yield Row("start", "the program's start alone, run --help", "hour", start, {"wall_s": 0.2})
    yield from _peers("hour", "")


ALLANTOOLS = """
import sys
import allantools, numpy
with numpy.load(sys.argv[1]) as file:
    y = file["gyro_raw"] / file["lsb_per_dps"]
for axis in y.T:
    allantools.oadev(numpy.ascontiguousarray(axis), rate=100.0, data_type="freq", taus="octave")
"""
IDENTIFY = {
    "ten minutes": ("10min-identify", "10min-identify-json", "10min-oadev"),
    "hour": ("identify", "identify-json", "oadev", "peer-npz"),
    "day": ("day-identify", "day-oadev", "day-peer-npz"),
}
"""Rows of `make bench ARGS=--identify` by kind: those of `fltea identify`, and those of other programs that
process the same files.
"""


def _identify() -> Iterator[Row]:
    """Yield the rows of `fltea identify` and of the Allan deviation alone."""
    yield Row("10min-identify", "identify", "ten minutes", identify, {"wall_s": 0.8})
    yield Row("10min-identify-json", "identify --json", "ten minutes", identify_in_full)
    yield Row("identify", "identify", "hour", identify)
    yield Row("identify-json", "identify --json", "hour", identify_in_full)
    oadev = partial(code, ALLANTOOLS, "npz")
    for name, kind in (("10min-oadev", "ten minutes"), ("oadev", "hour"), ("day-oadev", "day")):
        title = "peer: allantools.oadev of the axes, octaves"
        yield Row(name, title, kind, oadev, of_fltea=False, long=kind == "day")


def _day() -> Iterator[Row]:
    def row(name: str, title: str, work: Work, goal_s: float | None = None) -> Row:
        goals = {"wall_s": goal_s} if goal_s else {}
        return Row(f"day-{name}", f"24 h, {title}", "day", work, goals | {"rss_mb": 300.0}, long=True)

    yield row("npz", "replay from npz, --format none", partial(replay, "npz"), 40.0)
    yield row("mcap", "the same from MCAP", partial(replay, "mcap"), 40.0)
    yield row("csv", "the same from CSV", partial(replay, "csv"))
    yield row("export-npz", "export of MCAP to npz", partial(export, ".npz"))
    yield row("export-csv", "export of MCAP to CSV", partial(export, ".csv"))
    yield row("identify", "identify", identify, 60.0)
    yield from (one._replace(long=True) for one in _peers("day", "day-"))


def _peers(kind: str, prefix: str) -> Iterator[Row]:
    """Yield the rows of the benchmark that measure other programs, for comparison.

    They read the same kinds of files.
    """
    for form, title, text in (
        ("csv", "pandas.read_csv of that CSV", PANDAS),
        ("mcap", "mcap's reader over that MCAP", MCAP),
        ("npz", "numpy.load of that npz", NUMPY),
    ):
        work = partial(code, text, form)
        yield Row(f"{prefix}peer-{form}", f"peer: {title}", kind, work, of_fltea=False)


GOALS: Mapping[str, Mapping[str, float]] = {
    "1": {"cpu_percent": 3.0},
    "1-0ms": {"p99_ms": 1.0, "max_ms": 4.0},
    "1-old": {"cpu_percent": 1.0},
    "10": {"cpu_percent": 6.0},
    "10-0ms": {"p99_ms": 5.0},
    "300": {"cpu_percent": 45.0, "p99_ms": 60.0},
    "1000": {"cpu_percent": 170.0, "p99_ms": 150.0},
    "300-record": {"p99_ms": 150.0},
}
"""Goals of rows that measure live devices: largest permitted values of figures, by the row's name."""
USUAL = ("1", "1-0ms", "10", "300", "1000")


def _devices() -> Iterator[Row]:
    settings = [
        Setting(n, LIVE_S, coloured, latency_ms)
        for n, coloured, latency_ms in product((1, 10, 100, 300), (False, True), (20, 0))
    ]
    settings += [Setting(1000, LIVE_S, False, 20), *(Setting(n, LIVE_S, False, 20, OLD_S) for n in (1, 10))]
    for one in [*settings, Setting(300, 600.0, record=True, open_files=1024)]:
        name = f"{one.devices}{'-coloured' * one.coloured}{'-0ms' * (one.latency_ms == 0)}"
        name += "-record" * one.record + "-old" * (one.settle_s > SETTLE_S)
        long = one.seconds + one.settle_s > 30
        goals = {**GOALS.get(name, {}), "lost_or_errors": 0.0}
        yield Row(name, _said(one), "live", partial(live, one), goals, name in USUAL, long=long)


def _said(of: Setting) -> str:
    said = [f"{of.devices} device{'s' * (of.devices > 1)}", "coloured" if of.coloured else "white"]
    said += [] if of.latency_ms is None else [f"{of.latency_ms} ms"]
    said += [f"after {of.settle_s:g} s"] if of.settle_s > SETTLE_S else []
    said += ["--record"] if of.record else []
    said += [f"{of.seconds:g} s"] if of.seconds > LIVE_S else []
    said += [] if of.open_files is None else [f"{of.open_files} open files"]
    return ", ".join(said)


ROWS = (*_hour(), *_identify(), *_day(), *_devices())


def chosen(names: Sequence[str] = (), *, long: bool = False) -> list[Row]:
    """Return the rows with these names or kinds, all rows for `all`, or the usual rows if there are no names.

    A row that takes minutes to measure (`Row.long`) is included if `names` has its own name. If `long` is
    set, it is also included with its kind, with `all`, or if there are no names. An unknown name raises
    SystemExit.
    """
    known = {row.name for row in ROWS} | {row.kind for row in ROWS} | {"all"}
    if unknown := [name for name in names if name not in known]:
        rows = ", ".join(row.name for row in ROWS)
        raise SystemExit(
            f"--rows: there is no row {', '.join(unknown)}. "
            f"The rows are {rows}; hour, day, live and all stand for several."
        )

    def fits(row: Row) -> bool:
        many = row.kind in names or "all" in names or (not names and (row.usual or row.long))
        return row.name in names or (many and (long or not row.long))

    return [row for row in ROWS if fits(row)]
