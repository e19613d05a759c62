"""Many devices at 100 Hz on pseudo-terminals: `python -m tools.bench.feeder FOLDER N SECONDS`.

The ports are FOLDER/d0, d1, …; their samples are spread evenly over the period. It notes when the last byte
of each sample's frame was written, in FOLDER/times.npy: (devices, samples) in ns of the monotonic clock,
0 where the port took no more. It ends by itself.
"""

import os
import sys
import time
import tty
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from fltea.records.events import TIME_WRAP_US
from fltea.wire import layout as wire
from fltea.wire.messages import encode

from tools.board_voice import HELLO

RATE_HZ = 100
PERIOD_NS = 10**9 // RATE_HZ


def greeting(k: int, second: int, now_us: int, boot_id: int | None = None) -> bytes:
    """Return what device k says of itself once a second: HELLO and STATUS."""
    hello = HELLO._replace(
        boot_id=boot_id or k + 1, device_id=k.to_bytes(16, "big"), firmware_version="bench"
    )
    status = wire.Status(0, 0, 0, 0, 0, wire.ResetCause.USER, 0, 0)
    return b"".join(encode(one, second % 65536, now_us % TIME_WRAP_US) for one in (hello, status))


def sample(i: int, gyro: Sequence[int], now_us: int) -> bytes:
    """Return the frame of sample i of a device at rest."""
    x, y, z = gyro
    return encode(wire.Sample(x, y, z, 0, 0, 16384, 1335, 0), i % 65536, now_us % TIME_WRAP_US)


def frames(k: int, counts: Iterable[Sequence[int]]) -> Iterator[bytes]:
    """Yield what device k sends at each instant, of counts of three axes."""
    for i, gyro in enumerate(counts):
        now_us = i * PERIOD_NS // 1000
        said = greeting(k, i // RATE_HZ, now_us) if i % RATE_HZ == 0 else b""
        yield said + sample(i, gyro, now_us)


def main() -> None:
    """Write until the time is over."""
    folder, n, seconds = Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    samples = int(seconds * RATE_HZ)
    masters, keep = [], []
    for k in range(n):
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        (folder / f"d{k}").symlink_to(os.ttyname(slave))
        masters.append(master)
        keep.append(slave)  # open, so that a port that nobody listens to yet is no error
    noise = (np.random.default_rng(k).normal(0, 3, (samples, 3)).round().astype(int) for k in range(n))
    data = [list(frames(k, counts.tolist())) for k, counts in enumerate(noise)]
    times = np.zeros((n, samples), dtype=np.int64)
    print("ready", flush=True)
    sys.stdin.readline()
    begin_ns = time.monotonic_ns()
    for i in range(samples):
        for k, master in enumerate(masters):
            due_ns = begin_ns + i * PERIOD_NS + k * PERIOD_NS // n
            left_ns = due_ns - time.monotonic_ns()
            if left_ns > 0:
                time.sleep(left_ns * 1e-9)
            try:
                if os.write(master, data[k][i]) == len(data[k][i]):
                    times[k, i] = time.monotonic_ns()
            except BlockingIOError:
                pass
    np.save(folder / "times.npy", times)
    sys.stdin.readline()  # the ports stay until the daemon has read them


if __name__ == "__main__":
    main()
