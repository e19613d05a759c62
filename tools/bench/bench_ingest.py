"""Measures how programs process the frames that many sensors publish: processor time and losses.

One program behind an MQTT broker is measured, and two workers behind a NATS server.

Broker, server and the simulated sensors run on the same processors as the measured programs.
"""

import contextlib
import json
import os
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from subprocess import DEVNULL, PIPE
from typing import Any

from tools.bench.measured import Watch, rounded, started
from tools.faults.nats_server import NatsServer
from tools.faults.program import wait_until
from tools.faults.server import Broker
from tools.validation.tables import Table

DEVICES, SECONDS = 200, 15
KILL_S, KILLED_S = 10, 25
"""KILL_S: time [s] during which two workers share the devices. KILLED_S: time [s] that is measured after one
worker was killed.
"""
SETTLE_S = 5.0
"""Time [s] after which every device is processed and has estimates."""
PARTITIONS, WORKERS = 16, 2
EVERY = 100
"""The programs write one estimate in this many samples. Gaps in the numbers of these samples show whether any
estimates are missing.
"""


def broker(folder: Path, stack: contextlib.ExitStack) -> Broker:
    """Return mosquitto on the loopback interface, with an unlimited queue."""
    found = Broker(folder, logs=False, settings=("max_queued_messages 0",))
    stack.callback(found.kill)
    return found


def measure(devices: int = DEVICES, seconds: int = SECONDS) -> dict[str, Any]:
    """Measure with MQTT, then with NATS, then with NATS while one of the workers is killed."""
    return {
        "mqtt": _run(devices, seconds),
        "nats": _run(devices, seconds, nats=True),
        "nats, one killed": _run(devices, KILL_S + KILLED_S, KILL_S, nats=True),
    }


class _Programs:
    """The measured processes of `fltea run` (one or two), and the records that these processes write."""

    def __init__(self, folder: Path, stack: contextlib.ExitStack, count: int, *arguments: str) -> None:
        # This process reads the file while `fltea run` writes to it, and both share one file position, which
        # reading moves. The file is opened for appending, so that each write goes to its end wherever the
        # position is.
        self._files = [stack.enter_context((folder / f"out{k}").open("a+b")) for k in range(count)]
        command = ("run", *arguments, "--every", EVERY, "--format", "ndjson")
        self.processes = [
            started(stack, "fltea", *command, "--set", f"name=bench{k}", stdout=file, stderr=DEVNULL)
            for k, file in enumerate(self._files)
        ]

    def end(self) -> None:
        """End all processes at the same time, since otherwise one would take over the devices of another."""
        for process in self.processes:
            process.terminate()
        for process in self.processes:
            process.wait(60)

    def records(self, kind: str) -> Iterator[dict[str, Any]]:
        """Yield the records of one class that all programs have written."""
        begin = f'{{"class":"{kind}"'.encode()
        for file in self._files:
            file.seek(0)
            yield from (json.loads(line) for line in file if line.startswith(begin) and line[-1:] == b"\n")

    def have_estimated(self, seq: int, devices: int) -> bool:
        """Return whether all devices have an estimate of sample `seq`.

        By then, the programs have also written all estimates of earlier samples.
        """
        return len({one["device"] for one in self.records("estimate") if one["seq"] == seq}) == devices

    def estimates(self) -> tuple[int, int]:
        """Return how many estimates were made twice, and how many are missing.

        An estimate is missing if it was due between the first and the last estimate of any device.
        """
        seen: dict[str, Counter[int]] = {}
        for one in self.records("estimate"):
            seen.setdefault(one["device"], Counter())[one["seq"]] += 1
        if not seen:
            return 0, 0
        distinct = sum(map(len, seen.values()))
        first, last = min(map(min, seen.values())), max(map(max, seen.values()))
        again = sum(found.total() for found in seen.values()) - distinct
        return again, len(seen) * ((last - first) // EVERY + 1) - distinct


def _run(
    devices: int, seconds: int, kill_after_s: int | None = None, *, nats: bool = False
) -> dict[str, Any]:
    """Run one program behind mosquitto, or two workers behind NATS, which publish their results to mosquitto.

    The boards speak MQTT in both cases. `kill_after_s`: time after which one worker is killed (`kill -9`).
    """
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        mosquitto = broker(folder, stack)
        others = {"broker": mosquitto.process.pid}
        source, load, workers = mosquitto.url, ["--broker", mosquitto.url], 1
        if nats:
            server = NatsServer(folder, PARTITIONS)
            stack.callback(server.kill)
            others["server"] = server.process.pid
            load = ["--broker", f"mqtt://127.0.0.1:{server.mqtt_port}", "--mqtt-311"]
            source, workers = server.url, WORKERS
        programs = _Programs(folder, stack, workers, "-s", source, "--mqtt", mosquitto.url)
        if nats:
            wait_until(lambda: server.is_shared_by(WORKERS), "shares")
        else:
            time.sleep(3.0)
        pids = {f"program{k}": process.pid for k, process in enumerate(programs.processes)} | others
        load_before = os.getloadavg()[0]
        begin_s = time.monotonic()
        load += ["--devices", str(devices), "--seconds", str(seconds)]
        sender = started(stack, "tools.frames_load", *load, stdout=PIPE, text=True)
        if kill_after_s is not None:
            time.sleep(kill_after_s)
            programs.processes[0].kill()
            programs.processes[0].wait()
            del pids["program0"]
        time.sleep(SETTLE_S)
        watch = Watch(pids)
        time.sleep(max(1.0, begin_s + seconds - 0.5 - time.monotonic()))
        shares = watch.end()
        sent = json.loads(sender.communicate(timeout=60)[0])
        end_s = time.monotonic()
        wait_until(
            lambda: programs.have_estimated((seconds - 1) * EVERY, devices), "the last samples", every_s=0.5
        )
        caught_up_s = time.monotonic() - end_s
        programs.end()
        return {
            **sent,
            "caught_up_s": round(caught_up_s, 1),
            **_counted(programs),
            **rounded(shares),
            "load_before": round(load_before, 2),
        }


def _counted(programs: _Programs) -> dict[str, Any]:
    """Return the counts that the programs themselves report.

    For each device, these are the counts in the `stats` record with the largest number of samples.
    """
    stats: dict[str, dict[str, Any]] = {}
    for one in programs.records("stats"):
        known = stats.get(one["device"])
        if known is None or one["sample_counts"]["delivered"] >= known["sample_counts"]["delivered"]:
            stats[one["device"]] = one
    each = stats.values()
    again, holes = programs.estimates()
    return {
        "programs": len(programs.processes),
        "lines": len(stats),
        "delivered": sum(one["sample_counts"]["delivered"] for one in each),
        "lost": sum(one["sample_counts"]["lost"] for one in each),
        "overflow_bytes": sum(one["link"]["overflow_bytes"] for one in each),
        "estimates_twice": again,
        "estimates_left_out": holes,
        "fits": sum(1 for _ in programs.records("fit")),
        "fit_period_s": max((one["fit_period_s"] or 0 for one in each), default=None),
        "errors": list(dict.fromkeys(one["kind"] for one in programs.records("error"))),
    }


def text(found: dict[str, Any]) -> str:
    """Return the figures as a table.

    `delivered` is the largest count of a device's samples by one worker, summed over the devices. So it is
    too small if a worker was killed: its devices were counted by one worker before, and by the other after
    that.
    """
    keys = (
        "devices",
        "seconds",
        "samples",
        "delivered",
        "lost",
        "caught_up_s",
        "estimates_left_out",
        "estimates_twice",
    )
    cells = [
        (
            name,
            *(str(one[key]) for key in keys),
            ", ".join(f"{who} {share:.0f}" for who, share in one["cpu_percent"].items()),
        )
        for name, one in found.items()
    ]
    heads = (
        "through",
        "sensors",
        "seconds",
        "samples",
        "delivered",
        "lost",
        "caught up [s]",
        "estimates left out",
        "twice",
    )
    return Table("Frames of many sensors", (*heads, "% of a core"), cells).markdown()
