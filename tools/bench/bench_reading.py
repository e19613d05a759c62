"""Compares the time in which `open_csv` reads text, as `fltea info` calls it, with that of pandas.

In each round, fltea and pandas read the same file one after the other, so that a busy machine slows both.
Their processor times are compared round by round. pandas reads the same columns and nothing else; fltea also
checks every line, numbers the samples and determines the clock.
"""

import json
import statistics
import tempfile
from collections import deque
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from fltea.recording.csv_file import open_csv
from fltea.records.errors import UsageError
from fltea.settings.how import How
from fltea.sources.text_events import TextEvents

from tools.bench.measured import cpu_seconds, in_turns
from tools.validation.tables import NONE, Table, number

ROWS = 600_000
"""Number of rows of the CSV file, 50 MB."""
SEVEN = ["t", "gx", "gy", "gz", "ax", "ay", "az"]
NAMES = ["time (s)", "gyro_x (deg/s)", "gyro_y (deg/s)", "gyro_z (deg/s)"]
NAMES += [f"accel_{axis} (m/s^2)" for axis in "xyz"]
PLACES = How(columns=["2", "3", "4"], time_column="1", time_unit="s", units="deg/s")
ROUNDS = 5
SMALLER = 30
"""Three smaller files show how the reading time grows with a file's size. The smallest has ROWS / SMALLER
rows; the others are twice and four times as long.
"""
SECONDS_PER_MB, TWICE = 1.0, 2.5
"""Goals for texts of any kind. SECONDS_PER_MB: largest time to read 1 MB [s]. TWICE: largest ratio of the
time to read a text to the time to read half of it.
"""
HALF = 0.5
"""Goal: the speed of reading CSV is at least this fraction of pandas' speed."""
HEADERS = 20.0
"""Goal: rows with a header before each of them take at most this many times as long as the same rows without
these headers.
"""
LIVE_BYTES = 1500
"""Size of the pieces in which live text arrives [bytes]."""

Row = tuple[str, ...]


class Form(NamedTuple):
    """A kind of text, for which the time of reading is measured.

    `pandas`: function that reads the text by pandas, or None if pandas cannot. `again`: a line that is
    repeated after every `every` rows. `share`: fraction of the rows that is used, smaller for text that takes
    longer to read.
    """

    write: Callable[[Row], str]
    head: str = ""
    how: How = How()
    pandas: Callable[[Path], object] | None = None
    again: str = ""
    every: int = 0
    share: float = 1.0


def _of_json(row: Row) -> str:
    return json.dumps(dict(zip(NAMES, map(float, row), strict=True)))


def _of_yaml(row: Row) -> str:
    """Return a row as a message that `ros2 topic echo` prints, without its covariances."""
    second, _, fraction = row[0].partition(".")
    lines = ["header:", "  stamp:", f"    sec: {second}", f"    nanosec: {int(fraction) * 1_000_000}"]
    for name, values in (("angular_velocity", row[1:4]), ("linear_acceleration", row[4:])):
        lines += [f"{name}:", *(f"  {axis}: {value}" for axis, value in zip("xyz", values, strict=True))]
    return "\n".join([*lines, "---"])


def _csv(columns: int = len(SEVEN), **options: Any) -> Callable[[Path], object]:
    """Return a function that reads by pandas the same columns as fltea."""
    return partial(pd.read_csv, usecols=list(range(columns)), **options)


HEAD = ",".join(NAMES) + "\n"
FORMS = {
    "CSV with a header": Form(",".join, HEAD, pandas=_csv()),
    "CSV without a header": Form(",".join, "", PLACES, _csv(4, header=None)),
    "blanks between the columns": Form(" ".join, "", PLACES, _csv(4, header=None, sep=r"\s+")),
    "CSV in quotes": Form(lambda row: ",".join(f'"{value}"' for value in row), HEAD, pandas=_csv()),
    "JSON, an object a line": Form(_of_json, pandas=partial(pd.read_json, lines=True), share=0.1),
    "YAML of ros2 topic echo": Form(_of_yaml, share=0.1),
}
LINEAR = {
    "CSV with a header": FORMS["CSV with a header"],
    "a header every ten rows": Form(",".join, HEAD, again=HEAD, every=10),
    "a header before each row": Form(",".join, HEAD, again=HEAD, every=1),
    "words every ten rows": Form(",".join, HEAD, again="battery low\n", every=10),
    "labels beside each number": Form(
        lambda row: " ".join(f"{name}: {value}" for name, value in zip(SEVEN, row, strict=True)),
        how=How(columns=SEVEN[1:4], units="deg/s", time_column="t", time_unit="s"),
    ),
    "YAML of ros2 topic echo": FORMS["YAML of ros2 topic echo"],
}


def measure(rows: int = ROWS, rounds: int = ROUNDS) -> dict[str, Any]:
    """Return how fast each kind of text is read, and a text for each goal that is missed.

    `growth` of the result: for some kinds of text, the times for a small file and for files that are twice
    and four times as long. `headers`: how fast rows with and without a header before each of them are read.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rest.csv"
        speeds = {name: _speed(path, form, rows, rounds) for name, form in FORMS.items()}
        times = {name: _growth(path, form, rows // SMALLER, rounds) for name, form in LINEAR.items()}
        headers = _headers(Path(folder), rows // SMALLER, rounds)
    found = {"rows": rows, "rounds": rounds, "speed": speeds, "growth": times, "headers": headers}
    return found | {"not_reached": not_reached(found)}


def not_reached(found: dict[str, Any]) -> list[str]:
    """Return a text for each goal that the figures of this benchmark miss."""
    ratio = found["speed"]["CSV with a header"]["of_pandas"]
    missed = [f"CSV at {ratio:.2f} of pandas' speed, goal {HALF:g}"] if ratio < HALF else []
    for name, one in found["growth"].items():
        if "refused" in one:
            missed.append(f"{name}: refused")
            continue
        if max(one["twice"]) > TWICE:
            missed.append(
                f"{name}: twice the file takes {max(one['twice']):.1f} times as long, goal {TWICE:g}"
            )
        if one["s_per_mb"] > SECONDS_PER_MB:
            missed.append(f"{name}: {one['s_per_mb']:.2f} s for 1 MB, goal {SECONDS_PER_MB:g}")
    for name, one in found["headers"].items():
        if one["ratio"] > HEADERS:
            missed.append(
                f"{name} with a header before each row: {one['ratio']:.1f} times the time, goal {HEADERS:g}"
            )
    return missed


def text(found: dict[str, Any]) -> str:
    """Return the figures as tables for people."""
    speeds = [
        (
            name,
            f"{one['mb']:.1f}",
            *_spread(one["fltea"]),
            *_spread(one["pandas"]),
            number(one["of_pandas"], ".2f"),
        )
        if "refused" not in one
        else (name, f"{one['mb']:.1f}", "refused", *[NONE] * 4)
        for name, one in found["speed"].items()
    ]
    growth = [
        (name, *(f"{seconds * 1e3:.0f}" for seconds in one["seconds"]), *(f"{x:.2f}" for x in one["twice"]))
        if "refused" not in one
        else (name, "refused", *[NONE] * 4)
        for name, one in found["growth"].items()
    ]
    headers = [
        (name, *(f"{one[which]:.0f}" for which in ("without", "with")), f"{one['ratio']:.1f}")
        for name, one in found["headers"].items()
    ]
    columns = ("", "MB", "fltea, MB/s", "from … to", "pandas, MB/s", "from … to", "of pandas' speed")
    tables = [
        Table(
            f"{found['rows']:,} rows, of JSON and YAML a tenth; medians of {found['rounds']} rounds in turns",
            columns,
            speeds,
        ),
        Table(
            f"Is it linear? {found['rows'] // SMALLER:,} rows, twice and four times as many",
            ("", "n, ms", "2n, ms", "4n, ms", "2n / n", "4n / 2n"),
            growth,
        ),
        Table(
            f"A header before each row? {found['rows'] // SMALLER:,} rows; medians of rounds in turns",
            ("", "without, rows/s", "with, rows/s", "times as long"),
            headers,
        ),
    ]
    missed = found["not_reached"]
    last = "Not reached: " + "; ".join(missed) + "." if missed else "All goals measured here are reached."
    return "\n".join([*(one.markdown() for one in tables), last])


def _spread(speeds: list[float]) -> tuple[str, str]:
    if not speeds:
        return NONE, NONE
    return f"{statistics.median(speeds):.0f}", f"{min(speeds):.0f} … {max(speeds):.0f}"


def _write(path: Path, form: Form, rows: int) -> None:
    rng = np.random.default_rng(1)
    values = rng.normal([0, 0, 0, 0, 0, 9.81], [0.1, 0.1, 0.1, 0.02, 0.02, 0.02], (rows, 6))
    with path.open("w") as file:
        file.write(form.head)
        for k, row in enumerate(values.tolist()):
            if form.every and k and k % form.every == 0:
                file.write(form.again)
            file.write(form.write((f"{k / 200:.3f}", *(f"{value:.9f}" for value in row))) + "\n")


def _speed(path: Path, form: Form, rows: int, rounds: int) -> dict[str, Any]:
    _write(path, form, round(rows * form.share))
    mb = path.stat().st_size / 1e6
    works = {"fltea": partial(cpu_seconds, partial(open_csv, path, form.how))}
    if form.pandas is not None:
        works["pandas"] = partial(cpu_seconds, partial(form.pandas, path))
    try:
        seconds = in_turns(works, rounds)
    except UsageError as error:
        return {"mb": mb, "refused": str(error)}
    ratios = [
        theirs / ours for ours, theirs in zip(seconds["fltea"], seconds.get("pandas", []), strict=False)
    ]
    speeds = {name: [mb / one for one in seconds.get(name, [])] for name in ("fltea", "pandas")}
    return {"mb": mb, **speeds, "of_pandas": statistics.median(ratios) if ratios else None}


def _growth(path: Path, form: Form, rows: int, rounds: int) -> dict[str, Any]:
    """Return the smallest time for each size of a file, since disturbances can only increase a time."""
    seconds, mb = [], 0.0
    for times in (1, 2, 4):
        _write(path, form, rows * times)
        mb = path.stat().st_size / 1e6
        try:
            seconds.append(min(cpu_seconds(partial(open_csv, path, form.how)) for _ in range(rounds)))
        except UsageError as error:
            return {"refused": str(error)}
    twice = [after / before for before, after in pairwise(seconds)]
    return {"seconds": seconds, "twice": twice, "s_per_mb": seconds[-1] / mb}


def _headers(folder: Path, rows: int, rounds: int) -> dict[str, dict[str, float]]:
    """Return how fast rows with and without a header before each of them are read [rows/s].

    `ratio`: the time with headers divided by the time without.
    """
    works = {}
    for name, form in (("with", LINEAR["a header before each row"]), ("without", FORMS["CSV with a header"])):
        path = folder / f"{name}.csv"
        _write(path, form, rows)
        works["a file", name] = partial(cpu_seconds, partial(open_csv, path, form.how))
        works["live text", name] = partial(cpu_seconds, partial(_live, path.read_bytes(), form.how))
    seconds = in_turns(works, rounds)
    found = {}
    for of in ("a file", "live text"):
        times = seconds[of, "with"], seconds[of, "without"]
        speeds = [rows / statistics.median(some) for some in times]
        ratio = statistics.median(long / short for long, short in zip(*times, strict=True))
        found[of] = {"with": speeds[0], "without": speeds[1], "ratio": ratio}
    return found


def _live(data: bytes, how: How) -> None:
    events = TextEvents("stdin:", how, fatal=False)
    events.open(0, within_line=False)
    for begin in range(0, len(data), LIVE_BYTES):
        deque(events.feed(data[begin : begin + LIVE_BYTES], begin), maxlen=0)
    deque(events.finish(len(data)), maxlen=0)
