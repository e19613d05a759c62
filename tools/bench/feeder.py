"""Sends many devices' samples at 100 Hz to pseudo-terminals.

Usage: `python -m tools.bench.feeder FOLDER N SECONDS [coloured]`. The ports are FOLDER/d0, d1, …. The
devices' samples are spread evenly over the period, and their HELLO and STATUS over the second, as if the
devices had been switched on one after another. The program writes FOLDER/fed.npz: `times`, at which the last
byte of each sample's frame was written, of shape (devices, samples), in ns of the monotonic clock, 0 if the
port was full; `due`, the times at which the samples were due; and `bytes`, the number of bytes that each port
accepted. The program ends by itself.
"""

import os
import sys
import time
import tty
from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate, groupby
from pathlib import Path

import numpy as np
from fltea.wire import layout as wire
from numpy.typing import NDArray

from tools.made_up_board import HELLO, STATUS, MadeUpBoard, frames

RATE_HZ = 100
PERIOD_NS = 10**9 // RATE_HZ
FRAME_NS = 1_000_000
"""Duration of a frame of USB at full speed [ns]: bytes that many ports send within one frame arrive together.
"""
VOICES = 8
"""Number of different noises. Devices with the same noise differ in their HELLO."""


def hello_of(k: int) -> wire.Hello:
    """Return the HELLO of device `k`."""
    return HELLO._replace(boot_id=k + 1, device_id=k.to_bytes(16, "big"), firmware_version="bench")


def board(k: int) -> MadeUpBoard:
    """Return the simulated board of device `k`."""
    return MadeUpBoard(hello_of(k), status=STATUS)


def sent_by(one: MadeUpBoard, counts: Iterable[Sequence[int]]) -> Iterator[bytes]:
    """Yield the bytes that a board sends at each instant, from counts of three axes."""
    return (frames(one.tick(gyro)) for gyro in counts)


def relaxation(seed: int, samples: int, seconds: float = 0.5) -> NDArray[np.float64]:
    """Return AR(1) noise with the variance of white noise of 3 LSB, of shape (samples, 3).

    The coloured noise of the devices is the sum of this noise and white noise.
    """
    a = float(np.exp(-1 / (seconds * RATE_HZ)))
    noise = np.random.default_rng((seed, 1)).normal(0, 3 * np.sqrt(1 - a * a), (3, samples))
    return np.array([list(accumulate(axis.tolist(), lambda x, e: a * x + e)) for axis in noise]).T


def ports(folder: Path, n: int) -> tuple[list[int], list[int]]:
    """Make n pseudo-terminals; return the descriptors to which devices write, and those of the other ends.

    The other ends stay open, so that writing to a port that no program has opened yet is no error.
    """
    masters, slaves = [], []
    for k in range(n):
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        (folder / f"d{k}").symlink_to(os.ttyname(slave))
        masters.append(master)
        slaves.append(slave)
    return masters, slaves


def noises(n: int, samples: int, *, coloured: bool) -> list[list[bytes]]:
    """Return, for each noise (at most VOICES), a list of frames. Each frame has one sample of three axes."""
    found = []
    for k in range(min(n, VOICES)):
        noise = np.random.default_rng(k).normal(0, 3, (samples, 3))
        noise += relaxation(k, samples) if coloured else 0
        voice = board(k)
        found.append([voice.sample(gyro).frame for gyro in noise.round().astype(int).tolist()])
    return found


def offsets_ns(n: int) -> list[int]:
    """Return, for each device, when within a sampling period its samples are due [ns].

    The times are rounded down to whole frames of USB, so several devices may have the same time.
    """
    return [k * PERIOD_NS // n // FRAME_NS * FRAME_NS for k in range(n)]


def send(masters: list[int], samples: int, voices: list[list[bytes]]) -> tuple[NDArray[np.int64], ...]:
    """Write all samples when they are due; return `times`, `due` and `bytes` as FOLDER/fed.npz has them."""
    n, offsets = len(masters), offsets_ns(len(masters))
    boards = [board(k) for k in range(n)]
    together = [(at_ns, list(ks)) for at_ns, ks in groupby(range(n), offsets.__getitem__)]
    greets = [-(k * RATE_HZ // n) % RATE_HZ for k in range(n)]
    times, taken = np.zeros((n, samples), dtype=np.int64), [0] * n
    begin_ns = time.monotonic_ns()
    for i in range(samples):
        frames_now, of_second, ended_ns = [voice[i] for voice in voices], i % RATE_HZ, [0] * n
        for at_ns, ks in together:
            left_ns = begin_ns + i * PERIOD_NS + at_ns - time.monotonic_ns()
            if left_ns > 0:
                time.sleep(left_ns * 1e-9)
            for k in ks:
                data = frames_now[k % VOICES]
                if of_second == greets[k] or not i:
                    boards[k].instant = i
                    data = frames(boards[k].greets()) + data
                try:
                    count = os.write(masters[k], data)
                except BlockingIOError:
                    continue
                taken[k] += count
                if count == len(data):
                    ended_ns[k] = time.monotonic_ns()
        times[:, i] = ended_ns
    due = begin_ns + np.add.outer(np.array(offsets), np.arange(samples) * PERIOD_NS)
    return times, due, np.array(taken)


def main() -> None:
    """Run the command line: write samples until the time is over."""
    folder, n, seconds = Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    samples = int(seconds * RATE_HZ)
    masters, slaves = ports(folder, n)
    voices = noises(n, samples, coloured="coloured" in sys.argv[4:])
    print("ready", flush=True)
    sys.stdin.readline()
    times, due, taken = send(masters, samples, voices)
    np.savez(folder / "fed.tmp.npz", times=times, due=due, bytes=taken)
    (folder / "fed.tmp.npz").rename(folder / "fed.npz")
    sys.stdin.readline()  # The ports stay open until the daemon has read all bytes.
    for port in masters + slaves:
        os.close(port)


if __name__ == "__main__":
    main()
