"""Measures `fltea fleet`: its processor time and losses, with the fits of many daemons.

The fits come through a real broker.

Broker and simulated daemons run on the same processors as the measured program.
"""

import contextlib
import json
import os
import statistics
import subprocess
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

from tools.bench.bench_ingest import broker
from tools.bench.measured import Watch, rounded, started
from tools.faults.program import wait_until

SENSORS, EVERY_S, ROUNDS = 500, 2.5, 6


def measure(devices: int = SENSORS, rounds: int = ROUNDS) -> dict[str, Any]:
    """Run `fltea fleet` once, and return its figures.

    Each of `devices` sensors sends a fit and statistics every 2.5 s, and now and then a status.
    """
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        mosquitto = broker(folder, stack)
        log = folder / "fleet.log"
        address = mosquitto.url.removeprefix("mqtt://")
        options = ("--mqtt", address, "--listen", "0", "--history", folder / "fleet.db")
        with log.open("wb") as output:
            fleet = started(stack, "fltea", "fleet", *options, stdout=output, stderr=output)
        wait_until(lambda: "the fleet is at" in log.read_text(), "the fleet")
        page = log.read_text().rpartition("the fleet is at ")[2].split()[0]
        wait_until(lambda: _asked(f"{page}api/summary")["connected"], "the connection")
        load_before = os.getloadavg()[0]
        load = ("--port", mosquitto.port, "--sensors", devices, "--every", EVERY_S, "--rounds", rounds)
        quiet = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
        sender = started(stack, "tools.fleet_load", *load, **quiet)
        wait_until(lambda: _asked(f"{page}api/summary")["fits"] > 0, "the first fit")
        watch, last_refit = Watch({"fleet": fleet.pid, "broker": mosquitto.process.pid}), []
        while sender.poll() is None:
            begin_s = time.monotonic()
            _asked(f"{page}api/table?count=50")
            last_refit.append(time.monotonic() - begin_s)
            time.sleep(1.0)
        shares = watch.end()
        sent = json.loads(sender.stdout.read())
        time.sleep(1.0)
        taken = _asked(f"{page}api/summary")["fits"]
    return {
        **sent,
        "taken": taken,
        "lost": sent["fits"] - taken,
        "messages_per_s": round(sent["published"] / sent["seconds"], 1),
        "table_s": round(statistics.median(last_refit), 4),
        **rounded(shares),
        "load_before": round(load_before, 2),
    }


def _asked(url: str) -> dict[str, Any]:
    with urllib.request.urlopen(url, timeout=30) as answer:
        found: dict[str, Any] = json.load(answer)
    return found


def text(found: dict[str, Any]) -> str:
    """Return the figures as lines for people."""
    return (
        f"{found['sensors']} sensors, {found['fits']} fits, {found['messages_per_s']:.0f} messages a second: "
        f"{found['lost']} fits lost\n"
        f"fleet {found['cpu_percent']['fleet']:.0f} % of a core, {found['rss_mb']['fleet']:.0f} MB; broker "
        f"{found['cpu_percent']['broker']:.0f} %; a page of the table in {1e3 * found['table_s']:.0f} ms"
    )
