"""Many sensors that publish their frames: what one program on MQTT, and two workers on NATS, take and lose.

Broker, server and load have the same processors as what is measured.
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
"""How long two workers share the devices until one is killed, and how long it goes on after that."""
SETTLE_S = 5.0
"""Until all devices have a line and the start-up windows are full."""
PARTITIONS, WORKERS = 16, 2
EVERY = 100
"""Of so many samples of a device one has its estimate: by these it is seen that none is left out."""


def broker(folder: Path, stack: contextlib.ExitStack) -> Broker:
    """Return mosquitto on the loopback, which keeps all that waits."""
    found = Broker(folder, logs=False, settings=("max_queued_messages 0",))
    stack.callback(found.kill)
    return found


def measure(devices: int = DEVICES, seconds: int = SECONDS) -> dict[str, Any]:
    """Both ways, and NATS with one of its workers killed, one after the other."""
    return {
        "mqtt": _run(devices, seconds),
        "nats": _run(devices, seconds, nats=True),
        "nats, one killed": _run(devices, KILL_S + KILLED_S, KILL_S, nats=True),
    }


class _Programs:
    """Several processes of `fltea run`, and their records."""

    def __init__(self, folder: Path, stack: contextlib.ExitStack, count: int, *arguments: str) -> None:
        # Appended to: reading moves the place in a file that both have open.
        self._files = [stack.enter_context((folder / f"out{k}").open("a+b")) for k in range(count)]
        command = ("run", *arguments, "--every", EVERY, "--format", "ndjson")
        self.processes = [
            started(stack, "fltea", *command, "--set", f"name=bench{k}", stdout=file, stderr=DEVNULL)
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
            yield from (json.loads(line) for line in file if line.startswith(begin) and line[-1:] == b"\n")

    def have_walked(self, seq: int, devices: int) -> bool:
        """Whether they have the estimate of this number of so many devices, and so all before it."""
        return len({one["device"] for one in self.records("estimate") if one["seq"] == seq}) == devices

    def estimates(self) -> tuple[int, int]:
        """How many were made twice, and how many are left out, of all from the first to the last."""
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
    """One program on mosquitto; or two workers on NATS, whose results go to mosquitto.

    The boards speak MQTT to either. kill_after_s: when one of the workers is killed (`kill -9`).
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
            lambda: programs.have_walked((seconds - 1) * EVERY, devices), "the last samples", every_s=0.5
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
    """Return what the programs say of themselves: of each device the record that has most samples."""
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
    """A table. With one killed `delivered` is what the other counted since it had taken over."""
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
