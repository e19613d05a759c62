"""Many sensors that publish their frames: what one program on MQTT, and two workers on NATS, take and lose.

Broker, server and load have the same processors as what is measured.
"""

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tools.bench.bench_daemon import Usage
from tools.faults.broker import Broker
from tools.faults.nats_server import NatsServer
from tools.faults.program import wait_until

ROOT = Path(__file__).resolve().parents[2]
DEVICES, SECONDS = 200, 15
KILL_S, KILLED_S = 10, 25
"""How long two workers share the devices until one is killed, and how long it goes on after that."""
LAG_S = 10.0
"""For the one that is left to catch up."""
SETTLE_S = 5.0
"""Until all devices have a line and the start-up windows are full."""
PARTITIONS, WORKERS = 16, 2
EVERY = 100
"""Of so many samples of a device one has its estimate: by these it is seen that none is left out."""
FLAGS = ("--every", str(EVERY), "--format", "ndjson")


@contextlib.contextmanager
def broker(folder: Path) -> Iterator[Broker]:
    """Mosquitto on the loopback, which keeps all that waits."""
    started = Broker(folder, logs=False, settings=("max_queued_messages 0",))
    try:
        yield started
    finally:
        started.kill()


def measure(devices: int = DEVICES, seconds: int = SECONDS) -> dict[str, Any]:
    """Both ways, and NATS with one of its workers killed, one after the other."""
    return {
        "mqtt": through_mqtt(devices, seconds),
        "nats": through_nats(devices, seconds),
        "nats, one killed": through_nats(devices, KILL_S + KILLED_S, KILL_S),
    }


def through_mqtt(devices: int, seconds: int) -> dict[str, Any]:
    """One program on mosquitto."""
    with (
        tempfile.TemporaryDirectory() as name,
        broker(Path(name)) as mosquitto,
        _Programs(Path(name), 1, "-s", mosquitto.url, "--mqtt", mosquitto.url) as programs,
    ):
        time.sleep(3.0)
        return _run(programs, {"broker": mosquitto.process.pid}, devices, seconds, "--broker", mosquitto.url)


def through_nats(devices: int, seconds: int, kill_after_s: int | None = None) -> dict[str, Any]:
    """Two workers on NATS, whose results go to mosquitto; the boards speak MQTT to NATS.

    kill_after_s: when one of them is killed (`kill -9`).
    """
    with (
        tempfile.TemporaryDirectory() as name,
        broker(Path(name)) as mosquitto,
        contextlib.ExitStack() as stack,
    ):
        server = NatsServer(Path(name), PARTITIONS)
        stack.callback(server.kill)
        with _Programs(Path(name), WORKERS, "-s", server.url, "--mqtt", mosquitto.url) as programs:
            wait_until(lambda: server.is_shared_by(WORKERS), "shares")
            others = {"broker": mosquitto.process.pid, "server": server.process.pid}
            load = "--broker", f"mqtt://127.0.0.1:{server.mqtt_port}", "--mqtt-311"
            return _run(programs, others, devices, seconds, *load, kill_after_s=kill_after_s)


class _Programs(contextlib.AbstractContextManager["_Programs"]):
    """Several processes of `fltea run`, and their records."""

    def __init__(self, folder: Path, count: int, *arguments: str) -> None:
        self._files = [(folder / f"out{k}").open("w+b") for k in range(count)]
        self.processes = [
            subprocess.Popen(
                [sys.executable, "-m", "fltea", "run", *arguments, *FLAGS, "--set", f"name=bench{k}"],
                stdout=file,
                stderr=subprocess.DEVNULL,
            )
            for k, file in enumerate(self._files)
        ]

    def end(self) -> None:
        """In order, all at the same time: else one takes the other's devices."""
        for process in self.processes:
            process.terminate()
        for process in self.processes:
            process.wait(60)

    def records(self, kind: str) -> Iterator[dict[str, Any]]:
        """Those of a class, of all programs."""
        begin = f'{{"class":"{kind}"'.encode()
        for file in self._files:
            file.seek(0)
            yield from (json.loads(line) for line in file if line.startswith(begin))

    def estimates(self) -> tuple[int, int]:
        """How many were made twice, and how many are left out, of all from the first to the last."""
        seen: dict[str, Counter[int]] = {}
        for one in self.records("estimate"):
            seen.setdefault(one["device"], Counter())[one["seq"]] += 1
        if not seen:
            return 0, 0
        distinct = sum(map(len, seen.values()))
        first, last = min(map(min, seen.values())), max(map(max, seen.values()))
        again = sum(sum(found.values()) for found in seen.values()) - distinct
        return again, len(seen) * ((last - first) // EVERY + 1) - distinct

    def __exit__(self, *exception: object) -> None:
        for process, file in zip(self.processes, self._files, strict=True):
            process.kill()
            process.wait()
            file.close()


def _run(
    programs: _Programs,
    others: dict[str, int],
    devices: int,
    seconds: int,
    *load: str,
    kill_after_s: int | None = None,
) -> dict[str, Any]:
    pids = {f"program{k}": process.pid for k, process in enumerate(programs.processes)} | others
    load_before = os.getloadavg()[0]
    command = [sys.executable, "-m", "tools.frames_load", *load, "--devices", str(devices)]
    begin_s = time.monotonic()
    sender = subprocess.Popen(
        [*command, "--seconds", str(seconds)], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    if kill_after_s is not None:
        time.sleep(kill_after_s)
        programs.processes[0].kill()
        programs.processes[0].wait()
        del pids["program0"]
    try:
        time.sleep(SETTLE_S)
        first, first_s = {name: Usage.of(pid) for name, pid in pids.items()}, time.monotonic()
        time.sleep(max(1.0, begin_s + seconds - 0.5 - time.monotonic()))
        last, last_s = {name: Usage.of(pid) for name, pid in pids.items()}, time.monotonic()
        sent = json.loads(sender.communicate(timeout=60)[0])
    finally:
        sender.kill()
        sender.wait()
    time.sleep(2.0 if kill_after_s is None else LAG_S)
    programs.end()
    stats: dict[str, dict[str, Any]] = {}
    for one in programs.records("stats"):
        known = stats.get(one["device"])
        if known is None or one["samples"]["delivered"] >= known["samples"]["delivered"]:
            stats[one["device"]] = one
    each = stats.values()
    again, holes = programs.estimates()
    return {
        **sent,
        "programs": len(programs.processes),
        "lines": len(stats),
        "delivered": sum(one["samples"]["delivered"] for one in each),
        "first_messages": devices * 100,  # a device is let in with its second message
        "lost": sum(one["samples"]["lost"] for one in each),
        "overflow_bytes": sum(one["link"]["overflow_bytes"] for one in each),
        "estimates_twice": again,
        "estimates_left_out": holes,
        "fits": sum(1 for _ in programs.records("fit")),
        "fit_period_s": max((one["fit_period_s"] or 0 for one in each), default=None),
        "cpu_percent": {
            name: round(100 * (last[name].cpu_s - first[name].cpu_s) / (last_s - first_s), 1) for name in pids
        },
        "rss_mb": {name: round(usage.rss_mb, 1) for name, usage in last.items()},
        "load_before": round(load_before, 2),
        "errors": list(dict.fromkeys(one["kind"] for one in programs.records("error"))),
    }


def text(found: dict[str, Any]) -> str:
    """A table. With one killed `delivered` is what the other counted since it had taken over."""
    heads = "through", "sensors", "seconds", "samples", "delivered", "lost", "estimates left out", "twice"
    lines = [f"{heads[0]:18}" + "".join(f"{head:>{len(head) + 3}}" for head in heads[1:]) + "   % of a core"]
    for name, one in found.items():
        keys = "devices", "seconds", "samples", "delivered", "lost", "estimates_left_out", "estimates_twice"
        cells = (f"{one[key]:>{len(head) + 3}}" for key, head in zip(keys, heads[1:], strict=True))
        shares = ", ".join(f"{who} {share:.0f}" for who, share in one["cpu_percent"].items())
        lines.append(f"{name:18}{''.join(cells)}   {shares}")
    return "\n".join(lines)
