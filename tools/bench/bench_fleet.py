"""Many daemons' fits through a real broker into one `fltea fleet`: what it costs, and what is lost.

Broker and load have the same processors as the program that is measured.
"""

import contextlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

from tools.bench.bench_daemon import Usage
from tools.bench.bench_ingest import ROOT, broker
from tools.faults.program import wait_until

SENSORS, EVERY_S, ROUNDS = 500, 2.5, 6


def measure(devices: int = SENSORS, rounds: int = ROUNDS) -> dict[str, Any]:
    """One run: so many sensors with a fit, statistics and now and then a status every 2.5 s."""
    with (
        tempfile.TemporaryDirectory() as name,
        broker(Path(name)) as mosquitto,
        contextlib.ExitStack() as stack,
    ):
        address = mosquitto.url.removeprefix("mqtt://")
        log = Path(name) / "fleet.log"
        command = [sys.executable, "-m", "fltea", "fleet", "--mqtt", address, "--listen", "0"]
        with log.open("wb") as output:
            fleet = subprocess.Popen(
                [*command, "--history", str(Path(name) / "fleet.db")], stdout=output, stderr=output
            )
        stack.callback(fleet.wait)
        stack.callback(fleet.kill)
        wait_until(lambda: "the fleet is at" in log.read_text(), "the fleet")
        page = log.read_text().rpartition("the fleet is at ")[2].split()[0]
        wait_until(lambda: _summary(page)["connected"], "the connection")
        load = [sys.executable, "-m", "tools.fleet_load", "--port", address.rpartition(":")[2]]
        load += ["--sensors", str(devices), "--every", str(EVERY_S), "--rounds", str(rounds)]
        load_before = os.getloadavg()[0]
        pids = {"fleet": fleet.pid, "broker": mosquitto.process.pid}
        sender = subprocess.Popen(
            load, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        stack.callback(sender.wait)
        stack.callback(sender.kill)
        wait_until(lambda: _summary(page)["fits"] > 0, "the first fit")
        first, first_s = {who: Usage.of(pid) for who, pid in pids.items()}, time.monotonic()
        looks = []
        while sender.poll() is None:
            begin_s = time.monotonic()
            _ask(f"{page}api/table?count=50")
            looks.append(time.monotonic() - begin_s)
            time.sleep(1.0)
        last, last_s = {who: Usage.of(pid) for who, pid in pids.items()}, time.monotonic()
        assert sender.stdout is not None
        sent = json.loads(sender.stdout.read())
        time.sleep(1.0)
        found = _summary(page)
        return {
            **sent,
            "taken": found["fits"],
            "lost": sent["fits"] - found["fits"],
            "messages_per_s": round(sent["published"] / sent["seconds"], 1),
            "table_s": round(statistics.median(looks), 4),
            "cpu_percent": {
                who: round(100 * (last[who].cpu_s - first[who].cpu_s) / (last_s - first_s), 1) for who in pids
            },
            "rss_mb": {who: round(usage.rss_mb, 1) for who, usage in last.items()},
            "load_before": round(load_before, 2),
        }


def _ask(url: str) -> Any:
    with urllib.request.urlopen(url, timeout=30) as answer:
        return json.load(answer)


def _summary(page: str) -> dict[str, Any]:
    found: dict[str, Any] = _ask(f"{page}api/summary")
    return found


def text(found: dict[str, Any]) -> str:
    """A few lines."""
    return (
        f"{found['sensors']} sensors, {found['fits']} fits, {found['messages_per_s']:.0f} messages a second: "
        f"{found['lost']} fits lost\n"
        f"fleet {found['cpu_percent']['fleet']:.0f} % of a core, {found['rss_mb']['fleet']:.0f} MB; broker "
        f"{found['cpu_percent']['broker']:.0f} %; a page of the table in {1e3 * found['table_s']:.0f} ms"
    )
