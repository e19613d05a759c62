"""Measures `fltea run` with many devices on serial ports: latency, processor time, memory and losses.

`make bench ARGS='--ports --devices 300 --seconds 600 --open-files 1024'` also records all devices, with this
limit of open files, and compares the recordings with the bytes that were sent.
"""

import contextlib
import json
import os
import resource
import subprocess
import tempfile
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import psutil
from fltea.recording.part_reader import Batch, read_batches
from fltea.recording.scan import BEGIN, END
from fltea.recording.session import WIRE
from fltea.sources.mcap import find_sessions
from numpy.typing import NDArray

from tools.bench.feeder import RATE_HZ
from tools.bench.measured import Share, Watch, allow_open_files, started, started_command
from tools.bench.programs import PRESENT, Program
from tools.validation.tables import Table, number

SETTLE_S = 8.0
"""Time [s] after which all modules are imported, all devices have estimates and the memory hardly grows."""
OPEN_WITHIN_S = 60.0
"""Longest wait [s] for a daemon to open all its ports; after this the measurement begins anyway.
"""
LOST = ("lost", "overflow_bytes", "dropped", "port_full", "missing", "unrecorded_bytes", "errors")
OTHER_FILES = 100
"""Number of files that the daemon may open in addition to two for each port."""
REFITS = 10
"""Number of times that the daemon's memory is measured in a run."""


class Setting(NamedTuple):
    """Settings of a run.

    `latency_ms`: the setting `link.latency`, or None for its default. `settle_s`: time before the
    measurement. `open_files`: limit of open files of the daemon.
    """

    devices: int
    seconds: float
    coloured: bool = False
    latency_ms: int | None = None
    settle_s: float = SETTLE_S
    record: bool = False
    open_files: int | None = None


class Reader(threading.Thread):
    """Reads the daemon's NDJSON.

    The reader stores the arrival time of each estimate, and the last statistics of each device.
    """

    def __init__(self, stream: Any, devices: int, samples: int) -> None:
        super().__init__(daemon=True)
        self._stream = stream
        self.seen_ns = np.zeros((devices, samples), dtype=np.int64)
        self.stats: dict[str, dict[str, Any]] = {}
        self.errors: list[str] = []

    def run(self) -> None:
        """Read the daemon's output to its end.

        To be fast enough, only records of rare kinds are parsed as JSON.
        """
        head = b'{"class":"estimate","seq":'
        for line in self._stream:
            now_ns = time.monotonic_ns()
            if line.startswith(head):
                seq = int(line[len(head) : line.index(b",", len(head))])
                self.seen_ns[int(line[line.rindex(b'"d') + 2 : -3]), seq] = now_ns
            elif line.startswith((b'{"class":"stats"', b'{"class":"error"')):
                record = json.loads(line)
                if record["class"] == "stats":
                    self.stats[record["device"]] = record
                else:
                    self.errors.append(f"{record['kind']}: {record['message']}")


def run_once(of: Setting, program: Program = PRESENT) -> dict[str, Any]:
    """Run a daemon on `of.devices` devices, and measure its process.

    RuntimeError is raised if the daemon ends early, or if the system permits too few open files.
    """
    allow_open_files(2 * of.devices + OTHER_FILES)
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder, pipe, total_s = Path(name), subprocess.PIPE, of.settle_s + of.seconds
        feeding = folder, of.devices, total_s, *(["coloured"] if of.coloured else [])
        feeder = started(stack, "tools.bench.feeder", *feeding, stdin=pipe, stdout=pipe, text=True)
        feeder.stdout.readline()
        daemon = _daemon(stack, of, folder, program)
        reader = Reader(daemon.stdout, of.devices, int(total_s * RATE_HZ))
        reader.start()
        _wait_until_open(daemon, of.devices, folder)
        feeder.stdin.write("go\n")
        feeder.stdin.flush()
        time.sleep(of.settle_s)
        _still_runs(daemon, folder)
        watch = Watch({"daemon": daemon.pid, "feeder": feeder.pid, "reader": os.getpid()})
        last_refit: list[dict[str, Share]] = []
        while len(last_refit) < REFITS:
            time.sleep(max(1.0, of.seconds - 1.0) / REFITS)
            _still_runs(daemon, folder)
            last_refit.append(watch.end())
        while not (folder / "fed.npz").exists():
            time.sleep(0.1)
        time.sleep(0.5)
        daemon.terminate()
        daemon.wait(30)
        reader.join(30)
        fed = dict(np.load(folder / "fed.npz"))
        recorded = _recorded_bytes(folder / "records", of.devices) if of.record else fed["bytes"]
    return {
        **of._asdict(),
        **last_refit[-1]["daemon"]._asdict(),
        **{f"{name}_percent": last_refit[-1][name].cpu_percent for name in ("feeder", "reader")},
        "memory_mb": [round(look["daemon"].rss_mb, 1) for look in last_refit],
        **_arrived(reader, fed, watch.begin_ns),
        "unrecorded_bytes": int((fed["bytes"] - recorded).sum()),
    }


def _daemon(stack: contextlib.ExitStack, of: Setting, folder: Path, program: Program) -> Any:
    """Start `fltea run` on all ports, with its standard error in FOLDER/said."""
    arguments = [part for k in range(of.devices) for part in ("-s", f"serial:{folder / f'd{k}'}")]
    if of.latency_ms is not None:
        arguments += ["--set", f"link.latency={of.latency_ms} ms"]
    if of.record:
        arguments += ["--record", str(folder / "records")]
    options: dict[str, Any] = {"stdout": subprocess.PIPE, "bufsize": 1 << 20}
    if of.open_files is not None:
        limit = of.open_files, of.open_files
        options["preexec_fn"] = partial(resource.setrlimit, resource.RLIMIT_NOFILE, limit)
    with (folder / "said").open("wb") as said:
        command = program.command("run", *arguments, "--format", "ndjson")
        return started_command(stack, command, stderr=said, **options)


def _wait_until_open(daemon: Any, devices: int, folder: Path) -> None:
    """Wait until the daemon has opened all ports, and a second more.

    After a longer wait, the daemon would report that the devices, which send nothing yet, are silent for 5 s.
    """
    files, until_s = psutil.Process(daemon.pid), time.monotonic() + OPEN_WITHIN_S
    with contextlib.suppress(psutil.Error):  # The daemon may have ended; then `_still_runs` raises the error.
        while daemon.poll() is None and files.num_fds() < devices and time.monotonic() < until_s:
            time.sleep(0.1)
    time.sleep(1.0)
    _still_runs(daemon, folder)


def _still_runs(daemon: Any, folder: Path) -> None:
    if daemon.poll() is not None:
        said = (folder / "said").read_text(encoding="utf-8", errors="replace").strip()
        raise RuntimeError(f"the daemon ended early: {said[-300:]}")


def _arrived(reader: Reader, fed: dict[str, Any], begin_ns: int) -> dict[str, Any]:
    """Return the latency of the estimates, and the number of losses of each kind.

    Latency and missing estimates are those of samples written after `begin_ns`.

    A record `stats` has the counts of samples in `sample_counts`. The `stats` of the commit 068f73c8, with
    which later commits are compared, has these counts in `samples`.
    """
    written_ns, stats = fed["times"], reader.stats.values()
    after = written_ns > begin_ns
    latency_ms = (reader.seen_ns - written_ns)[after & (reader.seen_ns > 0)] * 1e-6
    none = [None, None, None]
    p50, p99, most = np.percentile(latency_ms, [50, 99, 100]).tolist() if len(latency_ms) else none
    return {
        "estimates": len(latency_ms),
        "p50_ms": p50,
        "p99_ms": p99,
        "max_ms": most,
        "feeder_late_ms": float(np.percentile((written_ns - fed["due"])[after], 99)) * 1e-6,
        "missing": int(after.sum()) - len(latency_ms),
        "lost": sum((s.get("sample_counts") or s["samples"])["lost"] for s in stats),
        "overflow_bytes": sum(s["link"]["overflow_bytes"] for s in stats),
        "dropped": sum(o["dropped"] for s in stats for o in s["outputs"].values()),
        "port_full": int((written_ns == 0).sum()),
        "errors": len(reader.errors),
        "first_errors": reader.errors[:3],
    }


def _recorded_bytes(folder: Path, devices: int) -> NDArray[np.int64]:
    """Return, for each device, how many bytes from its serial port are in the recordings."""
    found = np.zeros(devices, dtype=np.int64)
    for part in (part for session in find_sessions([folder])[0] for part in session.parts):
        for item in read_batches(part):
            if isinstance(item, Batch):
                of_wire = [channel for channel, topic in item.topics.items() if topic == WIRE]
                table = item.messages.of_channels(of_wire).table
                found[int(part.info.device.removeprefix("d"))] += int((table[:, END] - table[:, BEGIN]).sum())
    return found


def measure(devices: int = 300, seconds: float = 60.0, open_files: int | None = None) -> dict[str, Any]:
    """Run the daemon once, with recordings."""
    return run_once(Setting(devices, seconds, record=True, open_files=open_files))


def text(run: dict[str, Any]) -> str:
    """Return a table of the run's figures, and lines on its memory and its losses by kind."""
    lost = {key: run[key] for key in LOST if run[key]}
    return "\n".join(
        [
            table([run]).markdown(),
            f"Memory in MB, ten times in {run['seconds']:g} s: {', '.join(map(str, run['memory_mb']))}",
            f"Lost: {lost}; {run['first_errors']}"
            if lost
            else "Nothing was lost, on the way or in recordings.",
        ]
    )


def table(runs: list[dict[str, Any]]) -> Table:
    """Return the figures of several runs as a table."""
    cells = [
        (
            f"{run['devices']}, {'coloured' if run['coloured'] else 'white'}",
            "" if run["latency_ms"] is None else f"{run['latency_ms']}",
            f"{run['settle_s']:.0f}",
            *(number(run[key], ".2f") for key in ("p50_ms", "p99_ms")),
            number(run["max_ms"], ".1f"),
            f"{run['cpu_percent']:.1f}",
            f"{run['rss_mb']:.0f}",
            f"{sum(run[key] for key in LOST)}",
        )
        for run in runs
    ]
    headings = [
        "devices",
        "latency",
        "after s",
        "p50 ms",
        "p99 ms",
        "max ms",
        "core %",
        "MB",
        "lost, errors",
    ]
    title = "Live devices at 100 Hz on pseudo-terminals, NDJSON; from a frame's last byte to its line"
    return Table(title, headings, cells)
