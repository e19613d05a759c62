"""Many devices at 100 Hz on pseudo-terminals: `python -m tools.bench.feeder FOLDER N SECONDS [coloured]`.

The ports are FOLDER/d0, d1, …; their samples are spread evenly over the period, and what they say of
themselves over the second, as of devices that were switched on one after the other. In FOLDER/fed.npz it
notes when the last byte of each sample's frame was written (`times`, (devices, samples) in ns of the
monotonic clock, 0 where the port took no more), and the `bytes` that each port took. It ends by itself.
"""

import os
import sys
import time
import tty
from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate
from pathlib import Path

import numpy as np
from fltea.records.events import TIME_WRAP_US
from fltea.wire import layout as wire
from fltea.wire.messages import encode
from numpy.typing import NDArray

from tools.board_voice import HELLO

RATE_HZ = 100
PERIOD_NS = 10**9 // RATE_HZ
FRAME_NS = 1_000_000
"""Of USB (full speed, one frame a millisecond): what many ports say within it comes together."""
VOICES = 8
"""Different noises; devices of the same one differ in their HELLO."""


def hello_of(k: int, boot_id: int | None = None) -> wire.Hello:
    """Return what device k says of itself."""
    names = boot_id or k + 1, k.to_bytes(16, "big")
    return HELLO._replace(boot_id=names[0], device_id=names[1], firmware_version="bench")


def greeting(k: int, second: int, now_us: int, boot_id: int | None = None) -> bytes:
    """Return what device k sends once a second: HELLO and STATUS."""
    hello = hello_of(k, boot_id)
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


def relaxation(seed: int, samples: int, seconds: float = 0.5) -> NDArray[np.float64]:
    """Return what makes white noise of 3 LSB coloured: an AR(1) as strong, (samples, 3)."""
    a = float(np.exp(-1 / (seconds * RATE_HZ)))
    noise = np.random.default_rng((seed, 1)).normal(0, 3 * np.sqrt(1 - a * a), (3, samples))
    return np.array([list(accumulate(axis.tolist(), lambda x, e: a * x + e)) for axis in noise]).T


def main() -> None:
    """Write until the time is over."""
    folder, n, seconds = Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    samples, coloured = int(seconds * RATE_HZ), "coloured" in sys.argv[4:]
    masters, keep = [], []
    for k in range(n):
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        (folder / f"d{k}").symlink_to(os.ttyname(slave))
        masters.append(master)
        keep.append(slave)  # open, so that a port that nobody listens to yet is no error
    voices = []
    for k in range(min(n, VOICES)):
        noise = np.random.default_rng(k).normal(0, 3, (samples, 3))
        noise += relaxation(k, samples) if coloured else 0
        rows = enumerate(noise.round().astype(int).tolist())
        voices.append([sample(i, gyro, i * PERIOD_NS // 1000) for i, gyro in rows])
    times, taken = np.zeros((n, samples), dtype=np.int64), [0] * n
    print("ready", flush=True)
    sys.stdin.readline()
    begin_ns = time.monotonic_ns()
    for i in range(samples):
        for k, master in enumerate(masters):
            data = voices[k % VOICES][i]
            if i == 0 or (i + k * RATE_HZ // n) % RATE_HZ == 0:
                data = greeting(k, i // RATE_HZ, i * PERIOD_NS // 1000) + data
            due_ns = begin_ns + i * PERIOD_NS + k * PERIOD_NS // n // FRAME_NS * FRAME_NS
            left_ns = due_ns - time.monotonic_ns()
            if left_ns > 0:
                time.sleep(left_ns * 1e-9)
            try:
                count = os.write(master, data)
            except BlockingIOError:
                continue
            taken[k] += count
            if count == len(data):
                times[k, i] = time.monotonic_ns()
    np.savez(folder / "fed.tmp.npz", times=times, bytes=taken)
    (folder / "fed.tmp.npz").rename(folder / "fed.npz")
    sys.stdin.readline()  # the ports stay until the daemon has read them


if __name__ == "__main__":
    main()
