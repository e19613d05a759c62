"""Many sensors through a real broker into one `fltea run -s mqtt:…`: what it costs, and what is lost.

`python -m tools.bench.bench_ingest DEVICES SECONDS` prints one JSON object. Broker and load have the same
processors as the program that is measured.
"""

import contextlib
import json
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from tools.bench.bench_daemon import Usage

ROOT = Path(__file__).resolve().parents[2]
SETTLE_S = 5.0
"""Until all devices have a line and the start-up windows are full."""


def free_port() -> int:
    """A port of this machine that nobody has."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def broker(folder: Path) -> Any:
    """Debian's mosquitto on the loopback; gives its process and address."""
    program, port = shutil.which("mosquitto", path="/usr/sbin:/usr/bin"), free_port()
    if program is None:
        raise SystemExit("mosquitto is not installed: sudo apt-get install mosquitto")
    settings = folder / "mosquitto.conf"
    settings.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\nmax_queued_messages 0\n")
    process = subprocess.Popen(
        [program, "-c", settings], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        while True:
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.05)
        yield process, f"mqtt://127.0.0.1:{port}"
    finally:
        process.terminate()
        process.wait(10)


def run_once(devices: int, seconds: int, *more: str) -> dict[str, Any]:
    """One run. more: arguments of the load, such as a flood."""
    with (
        tempfile.TemporaryDirectory() as name,
        broker(Path(name)) as (mosquitto, url),
        contextlib.ExitStack() as stack,
    ):
        out = stack.enter_context((Path(name) / "out").open("w+b"))
        command = [sys.executable, "-m", "fltea", "run", "-s", url, "--mqtt", url, "--every", "1000"]
        fltea = subprocess.Popen([*command, "--format", "ndjson"], stdout=out, stderr=subprocess.DEVNULL)
        stack.callback(fltea.wait)
        stack.callback(fltea.kill)
        time.sleep(3.0)
        load = [sys.executable, "-m", "tools.frames_load", "--broker", url, "--devices", str(devices)]
        begin_s = time.monotonic()
        sender = subprocess.Popen(
            [*load, "--seconds", str(seconds), *more], cwd=ROOT, stdout=subprocess.PIPE, text=True
        )
        time.sleep(SETTLE_S)
        first, first_broker, first_s = Usage.of(fltea.pid), Usage.of(mosquitto.pid), time.monotonic()
        time.sleep(max(1.0, begin_s + seconds - 0.5 - time.monotonic()))
        last, last_broker, last_s = Usage.of(fltea.pid), Usage.of(mosquitto.pid), time.monotonic()
        sent = json.loads(sender.communicate(timeout=60)[0])
        time.sleep(2.0)
        fltea.terminate()
        fltea.wait(60)
        out.seek(0)
        stats, fits, errors = {}, 0, []
        for line in out:
            if line.startswith(b'{"class":"stats"'):
                record = json.loads(line)
                stats[record["device"]] = record
            elif line.startswith(b'{"class":"fit"'):
                fits += 1
            elif line.startswith(b'{"class":"error"'):
                errors.append(json.loads(line)["message"])
        wall_s = last_s - first_s
        each = stats.values()
        return {
            **sent,
            "lines": len(stats),
            "delivered": sum(s["samples"]["delivered"] for s in each),
            "first_messages": devices * 100,  # a device is let in with its second message
            "lost": sum(s["samples"]["lost"] for s in each),
            "overflow_bytes": sum(s["link"]["overflow_bytes"] for s in each),
            "dropped": max((o["dropped"] for s in each for o in s["outputs"].values()), default=0),
            "fits": fits,
            "fit_period_s": max((s["fit_period_s"] or 0 for s in each), default=None),
            "cpu_percent": round(100 * (last.cpu_s - first.cpu_s) / wall_s, 1),
            "broker_cpu_percent": round(100 * (last_broker.cpu_s - first_broker.cpu_s) / wall_s, 1),
            "rss_mb": round(last.rss_mb, 1),
            "threads": last.threads,
            "errors": errors[:5],
        }


def main() -> None:
    """Read the arguments."""
    devices, seconds = (int(text) for text in sys.argv[1:3])
    print(json.dumps(run_once(devices, seconds, *sys.argv[3:]), indent=1, ensure_ascii=False))


if __name__ == "__main__":
    main()
