"""`fltea run` under load: latency, processor time, memory, and how many devices one process carries."""

import contextlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
TICKS = os.sysconf("SC_CLK_TCK")
LATE_MS = 500.0
SETTLE_S = 8.0
"""Until memory, start-up windows and imports have settled."""


class Usage(NamedTuple):
    """Processor time and memory of a process as of now."""

    cpu_s: float
    rss_mb: float
    threads: int

    @staticmethod
    def of(pid: int) -> "Usage":
        """Read it from /proc."""
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        status = Path(f"/proc/{pid}/status").read_text()
        rss_kb = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS"))
        return Usage((int(fields[11]) + int(fields[12])) / TICKS, rss_kb / 1024, int(fields[17]))


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


def run_once(devices: int, seconds: float, extra: Sequence[str] = (), client: Any = None) -> dict[str, Any]:
    """Run the daemon on so many devices for a while, and measure it from outside."""
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        feeder = subprocess.Popen(
            [sys.executable, "-m", "tools.bench.feeder", folder, str(devices), str(SETTLE_S + seconds)],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        stack.callback(feeder.wait)
        stack.callback(feeder.kill)
        assert feeder.stdin is not None and feeder.stdout is not None  # noqa: PT018
        feeder.stdout.readline()
        urls = [part for k in range(devices) for part in ("-s", f"serial:{folder / f'd{k}'}")]
        daemon = subprocess.Popen(
            [sys.executable, "-m", "fltea", "run", *urls, "--format", "ndjson", *extra],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            bufsize=1 << 20,
        )
        stack.callback(daemon.wait)
        stack.callback(daemon.kill)
        reader = Reader(daemon.stdout)
        reader.start()
        time.sleep(2.0 + devices / 150)  # a device that is silent for 5 s is reported
        feeder.stdin.write("go\n")
        feeder.stdin.flush()
        time.sleep(SETTLE_S)
        if client is not None:
            stack.enter_context(client())
        begin, begin_s, begin_ns = Usage.of(daemon.pid), time.monotonic(), time.monotonic_ns()
        time.sleep(max(1.0, seconds - 1.0))
        end, end_s = Usage.of(daemon.pid), time.monotonic()
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
                if written_ns[k, seq] > begin_ns
            ]
        )
        stats = reader.stats.values()
        return {
            "devices": devices,
            "cpu_percent": 100 * (end.cpu_s - begin.cpu_s) / (end_s - begin_s),
            "rss_mb": end.rss_mb,
            "threads": end.threads,
            "estimates": len(latency_ms),
            "p50_ms": float(np.percentile(latency_ms, 50)),
            "p99_ms": float(np.percentile(latency_ms, 99)),
            "max_ms": float(latency_ms.max()),
            "late": int((latency_ms > LATE_MS).sum()),
            "missing": int((written_ns > begin_ns).sum()) - len(latency_ms),
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
        if any(many[-1][key] for key in ("lost", "overflow_bytes", "dropped", "port_full")):
            break
    keys = ("p50_ms", "p99_ms", "max_ms", "cpu_percent", "rss_mb")
    return {
        "one": {key: statistics.median(run[key] for run in one) for key in keys},
        "one_runs": one,
        "many": many,
    }


def text(figures: dict[str, Any]) -> str:
    """The figures as a table."""
    lines = ["devices   latency ms: p50     p99      max   CPU %  memory MB  estimates  lost  dropped"]
    for run in (*figures["one_runs"], *figures["many"]):
        lines.append(
            f"{run['devices']:7d} {run['p50_ms']:15.2f} {run['p99_ms']:7.2f} {run['max_ms']:8.2f} "
            f"{run['cpu_percent']:7.1f} {run['rss_mb']:10.1f} {run['estimates']:10d} "
            f"{run['lost'] + run['port_full']:5d} {run['dropped'] + run['overflow_bytes']:8d}"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    arguments = sys.argv[1:]
    if arguments and arguments[0] == "once":
        print(json.dumps(run_once(int(arguments[1]), float(arguments[2]), arguments[3:]), indent=1))
    else:
        found = measure()
        print(json.dumps(found) if "--json" in arguments else text(found))
