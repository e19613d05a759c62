"""`fltea run` under load: latency, processor time, memory, and how many devices one process carries."""

import contextlib
import json
import statistics
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tools.bench.measured import Watch, started
from tools.validation.tables import Table

LATE_MS = 500.0
SETTLE_S = 8.0
"""Until memory, start-up windows and imports have settled."""
LOST = ("lost", "overflow_bytes", "dropped", "port_full")


class Reader(threading.Thread):
    """Reads NDJSON, notes when each estimate's line came, and keeps the last statistics of each device."""

    def __init__(self, stream: Any) -> None:
        super().__init__(daemon=True)
        self._stream = stream
        self.seen_ns: list[tuple[bytes, int]] = []
        self.stats: dict[str, dict[str, Any]] = {}
        self.errors: list[str] = []

    def run(self) -> None:
        """Read to the end; lines are only parsed where they are rare."""
        for line in self._stream:
            now_ns = time.monotonic_ns()
            if line.startswith(b'{"class":"estimate"'):
                self.seen_ns.append((line, now_ns))
            elif line.startswith((b'{"class":"stats"', b'{"class":"error"')):
                record = json.loads(line)
                if record["class"] == "stats":
                    self.stats[record["device"]] = record
                else:
                    self.errors.append(f"{record['kind']}: {record['message']}")

    def arrivals(self) -> Iterator[tuple[int, int, int]]:
        """Device, number and time of every estimate."""
        for line, now_ns in self.seen_ns:
            record = json.loads(line)
            yield int(record["device"].removeprefix("d")), record["seq"], now_ns


def run_once(devices: int, seconds: float) -> dict[str, Any]:
    """Run the daemon on so many devices for a while, and measure it from outside."""
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder, pipe = Path(name), subprocess.PIPE
        feeding = folder, devices, SETTLE_S + seconds
        feeder = started(stack, "tools.bench.feeder", *feeding, stdin=pipe, stdout=pipe, text=True)
        feeder.stdout.readline()
        urls = [part for k in range(devices) for part in ("-s", f"serial:{folder / f'd{k}'}")]
        quiet = {"stderr": subprocess.DEVNULL, "bufsize": 1 << 20}
        daemon = started(stack, "fltea", "run", *urls, "--format", "ndjson", stdout=pipe, **quiet)
        reader = Reader(daemon.stdout)
        reader.start()
        time.sleep(2.0 + devices / 150)  # a device that is silent for 5 s is reported
        feeder.stdin.write("go\n")
        feeder.stdin.flush()
        time.sleep(SETTLE_S)
        watch = Watch({"daemon": daemon.pid})
        time.sleep(max(1.0, seconds - 1.0))
        share = watch.end()["daemon"]
        while not (folder / "times.npy").exists():
            time.sleep(0.1)
        time.sleep(0.5)
        daemon.terminate()
        daemon.wait(30)
        reader.join(30)
        written_ns = np.load(folder / "times.npy")
    latency_ms = np.array(
        [
            (now_ns - written_ns[k, seq]) * 1e-6
            for k, seq, now_ns in reader.arrivals()
            if written_ns[k, seq] > watch.begin_ns
        ]
    )
    stats = reader.stats.values()
    return {
        "devices": devices,
        **share._asdict(),
        "estimates": len(latency_ms),
        "p50_ms": float(np.percentile(latency_ms, 50)),
        "p99_ms": float(np.percentile(latency_ms, 99)),
        "max_ms": float(latency_ms.max()),
        "late": int((latency_ms > LATE_MS).sum()),
        "missing": int((written_ns > watch.begin_ns).sum()) - len(latency_ms),
        "lost": sum(s["samples"]["lost"] for s in stats),
        "overflow_bytes": sum(s["link"]["overflow_bytes"] for s in stats),
        "dropped": sum(o["dropped"] for s in stats for o in s["outputs"].values()),
        "port_full": int((written_ns == 0).sum()),
        "errors": len(reader.errors),
    }


def measure(seconds: float = 20.0, repetitions: int = 3) -> dict[str, Any]:
    """Latency and cost of one device, and the number of devices at which something is lost."""
    one = [run_once(1, seconds) for _ in range(repetitions)]
    many = []
    for devices in (10, 25, 50, 100, 200, 300):
        many.append(run_once(devices, seconds))
        if any(many[-1][key] for key in LOST):
            break
    keys = ("p50_ms", "p99_ms", "max_ms", "cpu_percent", "rss_mb")
    return {
        "one": {key: statistics.median(run[key] for run in one) for key in keys},
        "one_runs": one,
        "many": many,
    }


def text(figures: dict[str, Any]) -> str:
    """The figures as a table."""
    return table([*figures["one_runs"], *figures["many"]]).markdown()


def table(runs: list[dict[str, Any]]) -> Table:
    """Some runs; times the engine: where it is known what the engine alone takes."""
    cells = [
        (
            f"{run['devices']}",
            *(f"{run[key]:.2f}" for key in ("p50_ms", "p99_ms")),
            f"{run['max_ms']:.1f}",
            f"{run['cpu_percent']:.1f}",
            *([f"{run['chain_over_engine']:.1f}"] if "chain_over_engine" in run else []),
            f"{run['rss_mb']:.0f}",
            f"{run['lost'] + run['port_full'] + run['missing']}, {run['dropped'] + run['overflow_bytes']}",
            f"{run['errors']}",
        )
        for run in runs
    ]
    engine = ["times the engine"] if runs and "chain_over_engine" in runs[0] else []
    headings = ["devices", "p50 ms", "p99 ms", "max ms", "core %", *engine, "MB", "lost, dropped", "errors"]
    title = "Live devices at 100 Hz on pseudo-terminals, NDJSON; from a frame's last byte to its line"
    return Table(title, headings, cells)
